//! Numeric columns of a CSV artefact, by name.

use std::path::{Path, PathBuf};

/// A CSV file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ColumnsError {
    /// Absent, unreadable, or not CSV.
    #[error("cannot read {file}: {source}")]
    Read {
        /// The file.
        file: PathBuf,
        /// The cause.
        source: csv::Error,
    },
    /// A cell that is no number.
    #[error("{file}:{line}: column {column} holds `{found}`, expected a number")]
    NotANumber {
        /// The file.
        file: PathBuf,
        /// Line, 1 for the header.
        line: u64,
        /// Column name.
        column: String,
        /// The cell.
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
    /// Reads a file. An empty cell is NaN: a value that is not there.
    ///
    /// # Errors
    /// [`ColumnsError`] names file, line and column.
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

    /// A column by name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.names
            .iter()
            .position(|n| n == name)
            .map(|i| self.values[i].as_slice())
    }

    /// Two columns side by side, rows with a missing value left out; `None` where a column is absent or empty.
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
