//! Tables of numbers without the names and units of a laboratory: every column as it is, with what its
//! header says. The caller decides what the columns are.

use std::borrow::Cow;
use std::path::Path;

use cardiotwin_signals::Problem;

use crate::delimited::{binary, same_sign, too_few};
use crate::dialect::{Dialect, NoDialect, cells, sniff};
use crate::headers::{KNOWN, Label, plain_name};
use crate::number::{is_missing, number};
use crate::stamps::without_stamps;
use crate::text::{Decoded, decode};
use crate::told::shown;

/// A column of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct PlainColumn {
    /// Number of the column in the file, from 1.
    pub number: usize,
    /// Header of the column, for example `LVP (mmHg)`; `column 2` without a header.
    pub label: String,
    /// Quantity of that name or unit: `time`, `lv_pressure`, `aortic_pressure`, `flow`, `ecg` or
    /// `volume`; `None` where neither says so.
    pub quantity: Option<&'static str>,
    /// Unit in the header, as written.
    pub unit: Option<String>,
    /// Factor from that unit to ms, mmHg, mL/s, mV or mL; `None` without a unit of the quantity.
    pub factor: Option<f64>,
    /// Values as in the file; NaN for a missing one.
    pub values: Vec<f64>,
}

/// All columns of a text table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlainTable {
    /// Columns in the order of the file.
    pub columns: Vec<PlainColumn>,
    /// How the file was read, in words.
    pub said: String,
}

/// Reads all columns of a text table: cells between tabs, semicolons, commas or spaces, with or
/// without a header. Lines that begin with `#` are comments.
///
/// # Errors
/// [`Problem`] for a binary file, a text without rows of numbers, or a row that is none.
pub fn parse(bytes: &[u8], file: &Path) -> Result<PlainTable, Problem> {
    let decoded = decode(bytes).ok_or_else(|| binary(file))?;
    let decoded = match without_stamps(&decoded) {
        Some((decoded, _)) => decoded,
        None => decoded,
    };
    let text = between_tabs(&decoded);
    let lines: Vec<&str> = text.lines().collect();
    let dialect = match sniff(&lines) {
        Ok(dialect) => dialect,
        Err(NoDialect::SameSign { line }) => return Err(same_sign(file, &lines, line)),
        Err(NoDialect::NoNumbers) => {
            let first = lines.iter().find(|line| !line.trim().is_empty());
            return Err(Problem::error(
                file,
                first.map_or_else(
                    || "an empty file".to_owned(),
                    |line| {
                        format!(
                            "no rows of numbers; it begins with `{}`",
                            shown(line.as_bytes())
                        )
                    },
                ),
                "two columns of numbers or more: pressure, volume and, if it is known, time",
                "export the traces as text, one sample a line",
            ));
        }
    };
    let columns = rows(&lines, &dialect, file)?;
    // A line with a slip would be taken for the header of the rows below it.
    if let Some(line) = dialect.header {
        let header = cells(lines[line], dialect.separator);
        let is_number = |cell: &&str| {
            number(cell.trim().trim_matches('"').as_bytes(), dialect.decimal).is_some()
        };
        if header.iter().any(is_number) {
            let slip = header.iter().find(|cell| !is_number(cell));
            let found = slip.map_or_else(String::new, |cell| shown(cell.trim().as_bytes()));
            return Err(Problem::error(
                file,
                format!("`{found}` among numbers"),
                "a row of numbers, or a header of names",
                "correct or remove the line; a lost sample is an empty cell",
            )
            .at_line(line + 1));
        }
    }
    let said = format!(
        "{}, cells separated by a {}, decimal {}, {}",
        decoded.encoding,
        if text.contains('\t') && !decoded.text.contains('\t') {
            "space"
        } else {
            dialect.separator_word()
        },
        dialect.decimal.word(),
        dialect.header.map_or_else(
            || "no header".to_owned(),
            |line| format!("header in line {}", line + 1)
        ),
    );
    Ok(PlainTable { columns, said })
}

/// The text with tabs for runs of spaces, where rows have no other sign between their cells.
fn between_tabs<'a>(decoded: &'a Decoded<'_>) -> Cow<'a, str> {
    let text = decoded.text.as_ref();
    let is_row = |line: &&str| {
        let mut cells = line.split_whitespace();
        let all = cells.clone().count() > 1;
        all && cells.all(|cell| cell.parse::<f64>().is_ok())
    };
    let n_rows = text.lines().take(2000).filter(is_row).count();
    if n_rows < 2 || text.contains('\t') || text.contains(';') {
        return Cow::Borrowed(text);
    }
    let line = |line: &str| line.split_whitespace().collect::<Vec<_>>().join("\t") + "\n";
    Cow::Owned(text.lines().map(line).collect())
}

/// Columns with the values of all rows.
fn rows(lines: &[&str], dialect: &Dialect, file: &Path) -> Result<Vec<PlainColumn>, Problem> {
    let n_columns = cells(lines[dialect.first], dialect.separator).len();
    let labels = dialect.labels(lines);
    let mut columns: Vec<PlainColumn> = (0..n_columns)
        .map(|place| column(labels.get(place), place))
        .collect();
    for (idx, line) in lines.iter().enumerate().skip(dialect.first) {
        let trimmed = line.trim();
        if trimmed.is_empty() || trimmed.starts_with('#') {
            continue;
        }
        let row = cells(line, dialect.separator);
        let bad = |found: String| {
            Problem::error(
                file,
                found,
                format!("a row of {n_columns} numbers"),
                "correct or remove the line; a lost sample is an empty cell",
            )
            .at_line(idx + 1)
        };
        if row.len() != n_columns {
            return Err(bad(format!(
                "{} cells in `{}`",
                row.len(),
                shown(trimmed.as_bytes())
            )));
        }
        for (column, cell) in columns.iter_mut().zip(row) {
            let cell = cell.trim().trim_matches('"').trim().as_bytes();
            let value = match number(cell, dialect.decimal) {
                Some(value) => value,
                None if is_missing(cell) => f64::NAN,
                None => return Err(bad(format!("`{}`", shown(cell)))),
            };
            column.values.push(value);
        }
    }
    let n_rows = columns.first().map_or(0, |column| column.values.len());
    if n_rows < 2 {
        return Err(too_few(file, n_rows));
    }
    columns.retain(|column| column.values.iter().any(|value| value.is_finite()));
    Ok(columns)
}

fn column(label: Option<&Label>, place: usize) -> PlainColumn {
    let named = label.filter(|label| !label.full.is_empty());
    let quantity = named.and_then(quantity);
    let unit = named.and_then(|label| label.unit.clone());
    let factor = quantity
        .zip(unit.as_deref())
        .and_then(|(quantity, unit)| unit_factor(quantity, unit));
    PlainColumn {
        number: place + 1,
        label: named.map_or_else(
            || format!("column {}", place + 1),
            |label| label.full.clone(),
        ),
        quantity,
        unit,
        factor,
        values: Vec::new(),
    }
}

/// Quantity of a header: by its name, else by a unit that only one quantity has.
fn quantity(label: &Label) -> Option<&'static str> {
    let name = plain_name(&label.name);
    let by_name = KNOWN
        .iter()
        .find(|known| known.has_name(&name))
        .map(|known| known.quantity);
    let by_unit = || {
        let unit = label.unit.as_deref()?;
        let known = KNOWN
            .iter()
            .find(|known| known.dimension.factor(unit).is_some())?;
        // Two quantities are pressures: an unknown name does not say which one.
        (known.quantity != "lv_pressure").then_some(known.quantity)
    };
    // `V` is a volume next to a pressure. `V (V)` is a voltage.
    let is_volume = name == "v"
        && label
            .unit
            .as_deref()
            .is_none_or(|unit| unit_factor("volume", unit).is_some());
    by_name.or_else(|| if is_volume { Some("volume") } else { by_unit() })
}

/// Factor from a unit, as written, to ms, mmHg, mL/s, mV or mL; `None` if the quantity has no such
/// unit.
#[must_use]
pub fn unit_factor(quantity: &str, unit: &str) -> Option<f64> {
    let known = KNOWN.iter().find(|known| known.quantity == quantity)?;
    known.dimension.factor(unit)
}

/// Units of a quantity in lower case, for messages.
#[must_use]
pub fn units_of(quantity: &str) -> Vec<&'static str> {
    KNOWN
        .iter()
        .find(|known| known.quantity == quantity)
        .map_or_else(Vec::new, |known| known.dimension.names())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<PlainTable, Problem> {
        parse(text.as_bytes(), Path::new("own.csv"))
    }

    fn told(text: &str) -> Vec<(String, Option<&'static str>, Option<f64>)> {
        let columns = read(text).unwrap().columns.into_iter();
        columns.map(|c| (c.label, c.quantity, c.factor)).collect()
    }

    #[test]
    fn headers_tell_quantity_and_unit_as_far_as_they_do() {
        let of = |label: &str, quantity, factor| (label.to_owned(), quantity, factor);
        assert_eq!(
            told("t,LVP,V (mL)\n0,7,120\n1,8,121\n"),
            [
                of("t", Some("time"), None),
                of("LVP", Some("lv_pressure"), None),
                of("V (mL)", Some("volume"), Some(1.0))
            ]
        );
        assert_eq!(
            told("x;pressure [kPa];conductance (ml)\n0;1,0;120\n1;1,5;121\n"),
            [
                of("x", None, None),
                of(
                    "pressure [kPa]",
                    Some("lv_pressure"),
                    Some(cardiotwin_units::MMHG_PER_KPA)
                ),
                of("conductance (ml)", Some("volume"), Some(1.0))
            ]
        );
        assert_eq!(
            told("a (mmHg),ecg (mV)\n0,7\n1,8\n")[0].1,
            None,
            "either of two pressures"
        );
    }

    #[test]
    fn a_table_needs_no_header_and_may_have_spaces() {
        let table = read("# by numpy\n0.0 7.1\n 4.0   8.5\n8.0 9\n").unwrap();
        assert_eq!(
            table.said,
            "UTF-8, cells separated by a space, decimal point, no header"
        );
        assert_eq!(table.columns[1].values, [7.1, 8.5, 9.0]);
        assert_eq!(table.columns[1].label, "column 2");
        assert_eq!(
            read("p,v\n7,1\n,2\n9,3\n").unwrap().columns[0].values.len(),
            3
        );
    }

    #[test]
    fn a_bad_row_is_told_with_its_line() {
        let problem = read("p,v\n7,1\n8,2\nlow,3\n").unwrap_err();
        assert_eq!((problem.line, problem.found.as_str()), (Some(4), "`low`"));
        assert_eq!(read("p,v\n7,1\n8,2\n9\n").unwrap_err().line, Some(4));
        let early = read("p,v\n7,1\nx,2\n8,2\n9,3\n10,4\n").unwrap_err();
        assert_eq!(
            (early.line, early.found.as_str()),
            (Some(3), "`x` among numbers")
        );
        assert!(
            read("nothing here\n")
                .unwrap_err()
                .found
                .starts_with("no rows of numbers")
        );
        assert!(
            parse(b"\x00\x00\xff\x00", Path::new("x"))
                .unwrap_err()
                .found
                .contains("binary")
        );
    }
}
