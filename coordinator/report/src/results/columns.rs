//! Numeric columns of a CSV artefact, by name.

use std::path::{Path, PathBuf};

/// Errors in reading a CSV file of numbers.
#[derive(Debug, thiserror::Error)]
pub enum ColumnsError {
    /// The file is absent or unreadable, or is not CSV.
    #[error("cannot read {file}: {source}")]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// Error of the CSV reader.
        source: csv::Error,
    },
    /// A cell is not a number.
    #[error("{file}:{line}: column {column} holds `{found}`, expected a number")]
    NotANumber {
        /// Path of the file.
        file: PathBuf,
        /// Line of the cell; the header is line 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// Content of the cell.
        found: String,
    },
}

/// All columns of a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    names: Vec<String>,
    values: Vec<Vec<f64>>,
}

impl Columns {
    /// Reads a file. An empty cell stands for a missing value and becomes NaN.
    ///
    /// # Errors
    /// [`ColumnsError`] with the file and, for a cell, its line and column.
    pub fn read(file: &Path) -> Result<Self, ColumnsError> {
        let failed = |source| ColumnsError::Read {
            file: file.to_owned(),
            source,
        };
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_path(file)
            .map_err(failed)?;
        let names: Vec<String> = reader
            .headers()
            .map_err(failed)?
            .iter()
            .map(str::to_owned)
            .collect();
        let mut values = vec![Vec::new(); names.len()];
        for record in reader.records() {
            let record = record.map_err(failed)?;
            for ((cell, name), column) in record.iter().zip(&names).zip(&mut values) {
                let number = if cell.is_empty() {
                    Some(f64::NAN)
                } else {
                    cell.parse().ok()
                };
                column.push(number.ok_or_else(|| ColumnsError::NotANumber {
                    file: file.to_owned(),
                    line: record.position().map_or(0, csv::Position::line),
                    column: name.clone(),
                    found: cell.to_owned(),
                })?);
            }
        }
        Ok(Self { names, values })
    }

    /// Values of a column by name; NaN for missing ones. `None` if the file lacks the column.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.names
            .iter()
            .position(|n| n == name)
            .map(|i| self.values[i].as_slice())
    }

    /// Pairs of values of two columns, without rows in which one is missing. `None` if a column is
    /// absent or no pair is complete.
    #[must_use]
    pub fn pairs(&self, x: &str, y: &str) -> Option<Vec<(f64, f64)>> {
        let pairs: Vec<_> = std::iter::zip(self.get(x)?, self.get(y)?)
            .map(|(x, y)| (*x, *y))
            .filter(|(x, y)| x.is_finite() && y.is_finite())
            .collect();
        (!pairs.is_empty()).then_some(pairs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Columns, ColumnsError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Columns::read(file.path())
    }

    #[test]
    fn absent_columns_and_empty_cells_are_left_out() {
        let columns = read("time_ms,Sa_kPa\n0,1\n1,\n2,3.5\n").unwrap();
        assert_eq!(
            columns.pairs("time_ms", "Sa_kPa"),
            Some(vec![(0.0, 1.0), (2.0, 3.5)])
        );
        assert_eq!(columns.pairs("time_ms", "Ca_uM"), None);
    }

    #[test]
    fn a_word_among_numbers_is_named_with_its_line() {
        let message = read("time_ms,Sa_kPa\n0,1\n1,high\n")
            .unwrap_err()
            .to_string();
        assert!(
            message.ends_with(":3: column Sa_kPa holds `high`, expected a number"),
            "{message}"
        );
    }
}
