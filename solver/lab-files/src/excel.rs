//! Sheets of Excel (.xlsx, .xlsm, .xlsb, .xls) and OpenDocument (.ods).

use std::io::Cursor;
use std::path::Path;

use calamine::{Data, Range, Reader as _, SheetVisible, open_workbook_auto_from_rs};
use cardiotwin_signals::Problem;

use crate::clock::{Clock, DAY_MS, stamp_ms};
use crate::delimited::refused;
use crate::grid::Grid;
use crate::headers::{KNOWN, Label, find, is_unit};
use crate::number::{Decimal, is_missing, number};
use crate::told::{Told, shown};
use crate::wanted::{TableReading, Wanted};
use crate::workbook_bounds::{Refused, check_parts, check_records, check_sheet};

/// First bytes of a packed file: all formats but `.xls`.
const PACKED: &[u8] = b"PK\x03\x04";
/// Number of rows among which a header is looked for.
const PROBE: usize = 200;

/// Whether bytes begin as a file of Excel or OpenDocument.
#[must_use]
pub fn is_sheet(bytes: &[u8]) -> bool {
    bytes.starts_with(PACKED) || bytes.starts_with(b"\xd0\xcf\x11\xe0")
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
    let too_much = |refusal: Refused| match refusal {
        Refused::Damaged(error) => damaged(error),
        Refused::TooLarge { found, expected } => refused(Problem::error(
            file,
            found,
            expected,
            "remove stray cells and formats, and save the sheet again, or export it as CSV",
        )),
    };
    let bounded = match bytes.starts_with(PACKED) {
        true => check_parts(bytes),
        false => check_records(bytes),
    };
    if let Err(refusal) = bounded {
        return too_much(refusal);
    }
    let mut book = match open_workbook_auto_from_rs(Cursor::new(bytes)) {
        Ok(book) => book,
        Err(error) => return damaged(error.to_string()),
    };
    let names = book.sheet_names();
    // Hidden sheets are not read, unless prepare.toml names them.
    let hidden: Vec<String> = book
        .sheets_metadata()
        .iter()
        .filter(|sheet| sheet.visible != SheetVisible::Visible)
        .map(|sheet| sheet.name.clone())
        .collect();
    if let Some(sheet) = sheet.filter(|sheet| !names.iter().any(|name| name == sheet)) {
        return refused(Problem::error(
            file,
            format!("no sheet `{sheet}`"),
            format!("one of `{}`", names.join("`, `")),
            "correct `sheet` in prepare.toml",
        ));
    }
    let mut first_problem = None;
    for name in names.iter().filter(|name| match sheet {
        Some(sheet) => sheet == *name,
        None => !hidden.contains(name),
    }) {
        if let Err(refusal) = check_sheet(&mut book, name) {
            return too_much(refusal);
        }
        let range = match book.worksheet_range(name) {
            Ok(range) => range,
            Err(error) => return damaged(error.to_string()),
        };
        match grid_of(&range, file, name, wanted) {
            Ok((grid, told)) => {
                let problems = told.problems();
                // Cells that are no numbers would be reported again as missing ones.
                if problems.iter().any(Problem::is_error) {
                    return TableReading {
                        table: None,
                        problems,
                    };
                }
                let columns = grid.columns.clone();
                let mut reading = grid.choose(file, wanted);
                if sheet.is_none() && reading.table.is_some() {
                    let others = names.iter().skip_while(|other| *other != name).skip(1);
                    let others: Vec<&String> =
                        others.filter(|other| !hidden.contains(other)).collect();
                    let other = others.into_iter().find(|other| {
                        check_sheet(&mut book, other).is_ok()
                            && book.worksheet_range(other).is_ok_and(|range| {
                                grid_of(&range, file, other, wanted)
                                    .is_ok_and(|(grid, _)| !same(&grid.columns, &columns))
                            })
                    });
                    reading
                        .problems
                        .extend(other.map(|other| second_sheet(file, name, other)));
                }
                if let Some(table) = &mut reading.table {
                    table.said.insert(0, format!("workbook, sheet `{name}`"));
                    if !hidden.is_empty() {
                        let hidden = hidden.join("`, `");
                        table
                            .said
                            .push(format!("hidden sheets that are not read: `{hidden}`"));
                    }
                }
                return reading;
            }
            Err(problem) => first_problem = first_problem.or(Some(problem)),
        }
    }
    if !hidden.is_empty() && sheet.is_none() {
        let hidden = hidden.join("`, `");
        let found = first_problem.map_or_else(
            || "no visible sheet".to_owned(),
            |problem: Problem| problem.found,
        );
        return refused(Problem::error(
            file,
            format!("{found}; hidden sheets, which are not read: `{hidden}`"),
            "a visible sheet with the table",
            "show the sheet, or name it with `sheet` in prepare.toml",
        ));
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

/// Whether a cell is a time of day, a date or a duration.
fn is_stamp(cell: &Data) -> bool {
    time_ms(cell).is_some()
}

fn text(cell: &Data) -> String {
    match cell {
        Data::Empty => String::new(),
        other => other.to_string().trim().to_owned(),
    }
}

/// A number of a cell. Times of day, dates and durations are in ms.
fn value(cell: &Data, commas: Commas) -> Option<f64> {
    match cell {
        Data::Float(value) => Some(*value),
        Data::Int(value) => Some(*value as f64),
        Data::String(text) => {
            let text = text.trim();
            number(text.as_bytes(), Decimal::Point)
                .or_else(|| match commas {
                    Commas::Decimal => number(text.as_bytes(), Decimal::Comma),
                    Commas::Thousands => is_grouped(text)
                        .then(|| number(text.replace(',', "").as_bytes(), Decimal::Point))
                        .flatten(),
                    Commas::Unknown => None,
                })
                .or_else(|| time_ms(cell))
        }
        other => time_ms(other),
    }
}

/// A time of day, a date or a duration \[ms\]; `None` for other cells.
fn time_ms(cell: &Data) -> Option<f64> {
    match cell {
        Data::DateTime(value) => Some(value.as_f64() * DAY_MS),
        Data::DateTimeIso(text) => stamp_ms(text, Decimal::Point),
        Data::DurationIso(text) => duration_ms(text),
        Data::String(text) => stamp_ms(text, Decimal::Point),
        _ => None,
    }
}

/// A duration of OpenDocument such as `PT09H00M00.004S` \[ms\].
fn duration_ms(text: &str) -> Option<f64> {
    let (hours, rest) = text.strip_prefix("PT")?.split_once('H')?;
    let (minutes, rest) = rest.split_once('M')?;
    let seconds = rest.strip_suffix('S')?.replace(',', ".");
    let [hours, minutes, seconds] = [hours, minutes, &seconds].map(|part| part.parse::<f64>().ok());
    Some(1e3 * (3600.0 * hours? + 60.0 * minutes? + seconds?))
}

/// Meaning of the commas in the texts of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Commas {
    /// They stand before the decimals.
    Decimal,
    /// They part thousands.
    Thousands,
    /// Each text may be either: `150,250` is 150250 or 150.25.
    Unknown,
}

/// Whether a text has groups of three digits behind commas: `1,234`, `1,234,567.8`.
fn is_grouped(text: &str) -> bool {
    let whole = text.split('.').next().unwrap_or_default();
    let mut groups = whole.trim_start_matches(['-', '+']).split(',');
    let first = groups.next().unwrap_or_default();
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let mut n = 0;
    let sound = groups.all(|group| {
        n += 1;
        group.len() == 3 && digits(group)
    });
    sound && n > 0 && (1..=3).contains(&first.len()) && digits(first)
}

/// Meaning of the commas in a column's texts, from all of them together.
fn commas_of<'a>(texts: impl Iterator<Item = &'a str>) -> Commas {
    let mut meaning = Commas::Decimal;
    for text in texts.map(str::trim).filter(|text| text.contains(',')) {
        let bare = text.trim_start_matches(['-', '+']);
        if !is_grouped(text) || bare.starts_with('0') {
            // A part of other than three digits, or a zero before it, is no thousand.
            return Commas::Decimal;
        }
        if text.matches(',').count() > 1 || text.contains('.') {
            meaning = Commas::Thousands;
        } else if meaning == Commas::Decimal {
            meaning = Commas::Unknown;
        }
    }
    meaning
}

/// Whether two tables have the same cells; a missing one is equal to another.
fn same(a: &[Vec<f64>], b: &[Vec<f64>]) -> bool {
    let alike = |x: &f64, y: &f64| x == y || x.is_nan() && y.is_nan();
    a.len() == b.len()
        && a.iter()
            .zip(b)
            .all(|(a, b)| a.len() == b.len() && a.iter().zip(b).all(|(x, y)| alike(x, y)))
}

/// A warning that a further sheet has the table, with other numbers.
fn second_sheet(file: &Path, read: &str, other: &str) -> Problem {
    Problem::warning(
        file,
        format!(
            "the table in the sheets `{read}`, which is read, and `{other}`, with other numbers"
        ),
        "one visible sheet with the table",
        "name the right one with `sheet` in prepare.toml",
    )
}

/// The table of a sheet. The header is the first row whose names fit all required quantities.
fn grid_of(
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
                let label = Label::with_unit(&text(cell), unit);
                let first = rows.get(i + 1 + usize::from(with_units));
                let stamped = first.and_then(|row| row.get(k)).is_some_and(is_stamp);
                if label.unit.is_none() && stamped {
                    return Label {
                        unit: Some("ms".to_owned()),
                        ..label
                    };
                }
                label
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
            "name the sheet with `sheet` and the columns with [catheter.columns] or [cine.columns] in prepare.toml",
        ));
    };
    let line = |i: usize| first_row as usize + i + 1;
    let mut told = Told::default();
    let mut columns = vec![Vec::new(); labels.len()];
    let body = header + 1 + usize::from(units_below);
    let commas: Vec<Commas> = (0..labels.len())
        .map(|k| {
            commas_of(
                rows[body.min(rows.len())..]
                    .iter()
                    .filter_map(|row| match row.get(k) {
                        Some(Data::String(text)) => Some(text.as_str()),
                        _ => None,
                    }),
            )
        })
        .collect();
    // Times of day count from the first one, past midnight.
    let stamped: Vec<bool> = (0..labels.len())
        .map(|k| {
            let unit = labels[k].unit.as_deref();
            unit.is_some_and(|unit| KNOWN[0].dimension.factor(unit).is_some())
                && rows
                    .get(body)
                    .and_then(|row| row.get(k))
                    .is_some_and(is_stamp)
        })
        .collect();
    let factors: Vec<f64> = labels
        .iter()
        .map(|label| {
            let unit = label.unit.as_deref();
            unit.and_then(|unit| KNOWN[0].dimension.factor(unit))
                .unwrap_or(1.0)
        })
        .collect();
    let mut clocks = vec![(Clock::default(), None::<f64>); labels.len()];
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
            let value = match value(cell, commas[k]) {
                Some(ms) if stamped[k] && time_ms(cell).is_some() => {
                    let (clock, first) = &mut clocks[k];
                    let ms = clock.count_on(ms).unwrap_or(ms);
                    Some((ms - *first.get_or_insert(ms)) / factors[k])
                }
                // A time in a column of other numbers is an error.
                Some(_) if !stamped[k] && time_ms(cell).is_some() => None,
                value => value,
            };
            let ambiguous = value.is_none()
                && commas[k] == Commas::Unknown
                && matches!(cell, Data::String(text) if is_grouped(text.trim()));
            if ambiguous && !labels[k].full.is_empty() {
                let found = text(cell);
                let (thousands, decimal) = (found.replace(',', ""), found.replacen(',', ".", 1));
                let problem = Problem::error(
                    file,
                    format!(
                        "the text `{}`, which may be {thousands} or {decimal}",
                        shown(found.as_bytes())
                    ),
                    "a number in the cell, or texts that tell thousands from decimals",
                    "turn the column into numbers in the sheet, without separators of thousands",
                );
                told.tell(
                    "thousands",
                    problem.at_line(line(i)).at_key(labels[k].full.clone()),
                );
            } else if value.is_none()
                && !is_missing(text(cell).as_bytes())
                && !labels[k].full.is_empty()
            {
                let problem = Problem::error(
                    file,
                    format!("`{}`", shown(text(cell).as_bytes())),
                    "a number, a time of day, or an empty cell",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_are_told_apart_by_the_whole_column_or_not_at_all() {
        let of = |texts: &[&str]| commas_of(texts.iter().copied());
        assert_eq!(of(&["150,250", "149,700"]), Commas::Unknown);
        assert_eq!(of(&["150,250", "1,234,567"]), Commas::Thousands);
        assert_eq!(of(&["150,250", "1,234.5"]), Commas::Thousands);
        assert_eq!(of(&["150,250", "98,1"]), Commas::Decimal);
        assert_eq!(of(&["0,004", "0,008"]), Commas::Decimal);
        assert_eq!(of(&["7", "8.5"]), Commas::Decimal);
        let texts = |text: &str| Data::String(text.to_owned());
        assert_eq!(value(&texts("150,250"), Commas::Unknown), None);
        assert_eq!(value(&texts("150,250"), Commas::Thousands), Some(150_250.0));
        assert_eq!(value(&texts("150,250"), Commas::Decimal), Some(150.25));
        assert_eq!(value(&texts("1,23"), Commas::Thousands), None);
    }

    #[test]
    fn durations_and_dates_are_times() {
        assert_eq!(duration_ms("PT09H00M00.004S"), Some(32_400_004.0));
        assert_eq!(duration_ms("9 h"), None);
        assert_eq!(
            time_ms(&Data::String("00:00:01.5".to_owned())),
            Some(1500.0)
        );
        assert_eq!(time_ms(&Data::Float(1.5)), None);
    }
}
