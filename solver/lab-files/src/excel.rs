//! Sheets of Excel (.xlsx, .xlsm, .xlsb, .xls) and OpenDocument (.ods).

use std::io::Cursor;
use std::path::Path;

use calamine::{Data, Range, Reader as _, open_workbook_auto_from_rs};
use cardiotwin_signals::Problem;

use crate::delimited::refused;
use crate::grid::Grid;
use crate::headers::{Label, find, is_unit};
use crate::number::{Decimal, is_missing, number};
use crate::told::{Told, shown};
use crate::wanted::{TableReading, Wanted};

/// Number of rows among which a header is looked for.
const PROBE: usize = 200;

/// Whether bytes begin as a file of Excel or OpenDocument.
#[must_use]
pub fn is_sheet(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"\xd0\xcf\x11\xe0")
}

/// Reads a sheet: the named one, or the first one with all required quantities.
#[must_use]
pub fn parse(bytes: &[u8], file: &Path, wanted: &[Wanted], sheet: Option<&str>) -> TableReading {
    let damaged = |error: String| {
        refused(Problem::error(
            file,
            format!("a file that is no workbook ({error})"),
            "a workbook of Excel or OpenDocument",
            "save the sheet again, or export it as CSV",
        ))
    };
    let mut book = match open_workbook_auto_from_rs(Cursor::new(bytes)) {
        Ok(book) => book,
        Err(error) => return damaged(error.to_string()),
    };
    let names = book.sheet_names();
    if let Some(sheet) = sheet.filter(|sheet| !names.iter().any(|name| name == sheet)) {
        return refused(Problem::error(
            file,
            format!("no sheet `{sheet}`"),
            format!("one of `{}`", names.join("`, `")),
            "correct `sheet` in prepare.toml",
        ));
    }
    let mut first_problem = None;
    for name in names
        .iter()
        .filter(|name| sheet.is_none_or(|sheet| sheet == *name))
    {
        let range = match book.worksheet_range(name) {
            Ok(range) => range,
            Err(error) => return damaged(error.to_string()),
        };
        match grid(&range, file, name, wanted) {
            Ok((grid, told)) => {
                let mut reading = grid.choose(file, wanted);
                let mut problems = told.problems();
                if problems.iter().any(Problem::is_error) {
                    reading.table = None;
                }
                problems.append(&mut reading.problems);
                problems.sort_by_key(|problem| problem.line);
                reading.problems = problems;
                if let Some(table) = &mut reading.table {
                    table.said.insert(0, format!("workbook, sheet `{name}`"));
                }
                return reading;
            }
            Err(problem) => first_problem = first_problem.or(Some(problem)),
        }
    }
    refused(first_problem.unwrap_or_else(|| {
        Problem::error(
            file,
            "a workbook without sheets",
            "a sheet with a table",
            "export the recording again",
        )
    }))
}

fn text(cell: &Data) -> String {
    match cell {
        Data::Empty => String::new(),
        other => other.to_string().trim().to_owned(),
    }
}

/// A number of a cell. Numbers that were stored as text may have a decimal comma.
fn value(cell: &Data) -> Option<f64> {
    match cell {
        Data::Float(value) => Some(*value),
        Data::Int(value) => Some(*value as f64),
        Data::String(text) => {
            let text = text.trim().as_bytes();
            number(text, Decimal::Point).or_else(|| number(text, Decimal::Comma))
        }
        _ => None,
    }
}

/// The table of a sheet. The header is the first row whose names fit all required quantities.
fn grid(
    range: &Range<Data>,
    file: &Path,
    sheet: &str,
    wanted: &[Wanted],
) -> Result<(Grid, Told), Problem> {
    let (first_row, _) = range.start().unwrap_or((0, 0));
    let rows: Vec<&[Data]> = range.rows().collect();
    let labels_of = |i: usize, with_units: bool| -> Vec<Label> {
        let units = rows.get(i + 1).filter(|_| with_units);
        rows[i]
            .iter()
            .enumerate()
            .map(|(k, cell)| {
                let unit = units.and_then(|units| units.get(k)).map(text);
                let unit = unit
                    .as_deref()
                    .map(|unit| unit.trim_matches(['(', ')', '[', ']', '{', '}']));
                Label::with_unit(&text(cell), unit)
            })
            .collect()
    };
    let fits = |labels: &[Label]| {
        wanted.iter().filter(|one| one.required).all(|one| {
            let exact = |label: &Label| {
                one.names
                    .iter()
                    .any(|(name, _)| *name == label.full || (one.given && *name == label.name))
            };
            labels.iter().any(exact) || (!one.given && find(labels, one).is_ok())
        })
    };
    let header = (0..rows.len().min(PROBE)).find_map(|i| {
        let below = rows.get(i + 1);
        let units_below = below.is_some_and(|row| {
            row.iter().all(|cell| is_unit(&text(cell)))
                && row.iter().any(|cell| !text(cell).is_empty())
        });
        let labels = labels_of(i, units_below);
        fits(&labels).then_some((i, units_below, labels))
    });
    let Some((header, units_below, labels)) = header else {
        let names = rows
            .iter()
            .find(|row| {
                row.iter()
                    .filter(|cell| matches!(cell, Data::String(_)))
                    .count()
                    > 1
            })
            .map(|row| row.iter().map(text).collect::<Vec<_>>().join(", "))
            .unwrap_or_default();
        return Err(Problem::error(
            file,
            format!(
                "sheet `{sheet}` with the names `{}`",
                shown(names.as_bytes())
            ),
            format!(
                "a row of names with units for {}",
                wanted
                    .iter()
                    .filter(|one| one.required)
                    .map(|one| one.quantity)
                    .collect::<Vec<_>>()
                    .join(" and ")
            ),
            "name the sheet with `sheet` and the columns with [columns] in prepare.toml",
        ));
    };
    let line = |i: usize| first_row as usize + i + 1;
    let mut told = Told::default();
    let mut columns = vec![Vec::new(); labels.len()];
    let mut lines: Vec<(usize, usize)> = Vec::new();
    for (i, row) in rows
        .iter()
        .enumerate()
        .skip(header + 1 + usize::from(units_below))
    {
        // An empty row ends the table; further text below it is another one.
        if row.iter().all(|cell| text(cell).is_empty()) {
            if columns[0].is_empty() {
                continue;
            }
            break;
        }
        let n = columns[0].len();
        if lines.last().is_none_or(|(row, at)| at + n - row != line(i)) {
            lines.push((n, line(i)));
        }
        for (k, (cell, column)) in row.iter().zip(&mut columns).enumerate() {
            let value = value(cell);
            if value.is_none() && !is_missing(text(cell).as_bytes()) && !labels[k].full.is_empty() {
                let problem = Problem::error(
                    file,
                    format!("`{}`", shown(text(cell).as_bytes())),
                    "a number, or an empty cell",
                    "correct the cell; the line is that of the sheet",
                );
                told.tell(
                    "number",
                    problem.at_line(line(i)).at_key(labels[k].full.clone()),
                );
            }
            column.push(value.unwrap_or(f64::NAN));
        }
    }
    let grid = Grid {
        labels,
        columns,
        header_line: Some(line(header)),
        lines,
        said: Vec::new(),
    };
    Ok((grid, told))
}
