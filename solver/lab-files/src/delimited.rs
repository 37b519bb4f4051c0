//! Fast parser for columns of a text table. Half an hour at 1 kHz has two million lines, and reading
//! them must not take longer than all following steps.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::columns::{Column, Header, names_of};
use crate::dialect::{Dialect, NoDialect, cells, sniff};
use crate::number::{Decimal, is_missing, number};
use crate::stamps::without_stamps;
use crate::text::{Decoded, decode};
use crate::told::{Told, shown};
use crate::wanted::{Table, TableReading, Wanted};

/// Part of a file that holds a table.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    pub(crate) dialect: Dialect,
    /// Whether the table ends before the first line that is not a row of numbers. Otherwise such a
    /// line is an error.
    pub(crate) ends: bool,
    /// Whether columns that are not read get a warning.
    pub(crate) warn_of_others: bool,
    /// Whether the form is the program's own, so that no message names it.
    pub(crate) own: bool,
}

/// Parses the columns for `wanted` from the content of `file`: a header, then numbers, with any
/// separator, decimal sign and encoding. Lines that begin with `#` are comments. The first quantity
/// is time and must increase.
#[must_use]
pub fn parse(bytes: &[u8], file: &Path, wanted: &[Wanted]) -> TableReading {
    let Some(decoded) = decode(bytes) else {
        return refused(binary(file));
    };
    if let Some((decoded, said)) = without_stamps(&decoded) {
        let mut reading = match layout(&decoded.text, file, wanted) {
            Ok(layout) => parse_layout(&decoded, file, wanted, &layout),
            Err(problem) => refused(problem),
        };
        if let Some(table) = &mut reading.table {
            table.said.push(said);
        }
        return reading;
    }
    match layout(&decoded.text, file, wanted) {
        Ok(layout) => parse_layout(&decoded, file, wanted, &layout),
        Err(problem) => refused(problem),
    }
}

pub(crate) fn refused(problem: Problem) -> TableReading {
    TableReading {
        table: None,
        problems: vec![problem],
    }
}

/// The problem of a table whose cells and decimals are separated by the same sign.
///
/// - `line`: the first row, from 1
pub(crate) fn same_sign(file: &Path, lines: &[&str], line: usize) -> Problem {
    Problem::error(
        file,
        format!(
            "commas both between cells and in the numbers of `{}`",
            lines[line - 1].trim()
        ),
        "different signs for the two",
        "export with semicolons or tabs between the cells, or with decimal points",
    )
    .at_line(line)
}

pub(crate) fn binary(file: &Path) -> Problem {
    Problem::error(
        file,
        "a binary file of an unknown format",
        "a text table, an Excel or OpenDocument sheet, EDF or BDF, or the header (.hea) of a WFDB \
         record",
        "export the recording as text; docs/prepare.md lists the formats",
    )
}

/// Form of the table in a text.
pub(crate) fn layout(text: &str, file: &Path, wanted: &[Wanted]) -> Result<Layout, Problem> {
    let lines: Vec<&str> = text.lines().take(4000).collect();
    let first = lines.iter().position(|line| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    let Some(first) = first else {
        return Err(Problem::error(
            file,
            "an empty file",
            format!("a header with {}", names_of(&wanted[0])),
            "export the recording again",
        ));
    };
    // A header with the program's own names has the program's own form, whatever follows.
    let own = cells(lines[first], b',').into_iter().any(|cell| {
        let cell = cell.trim().trim_matches('"');
        wanted
            .iter()
            .filter(|w| !w.given)
            .any(|w| w.names.iter().any(|(name, _)| name == cell))
    });
    if own {
        return Ok(Layout {
            dialect: Dialect {
                separator: b',',
                decimal: Decimal::Point,
                header: Some(first),
                units_below: false,
                first: first + 1,
            },
            ends: false,
            warn_of_others: true,
            own: true,
        });
    }
    match sniff(&lines) {
        Ok(dialect) if dialect.header.is_some() => Ok(Layout {
            dialect,
            ends: false,
            warn_of_others: true,
            own: false,
        }),
        Ok(dialect) => Err(Problem::error(
            file,
            format!(
                "the numbers `{}` and no header",
                shown(lines[dialect.first].as_bytes())
            ),
            format!("a header with {}", names_of(&wanted[0])),
            "put names above the numbers, with the units in them: units are never guessed",
        )
        .at_line(dialect.first + 1)),
        Err(NoDialect::SameSign { line }) => Err(same_sign(file, &lines, line)),
        Err(NoDialect::NoNumbers) => Err(Problem::error(
            file,
            format!(
                "no rows of numbers; the first line is `{}`",
                shown(lines[first].as_bytes())
            ),
            "a header with names and units, and rows of numbers below it",
            "export the recording again; docs/prepare.md lists the formats",
        )
        .at_line(first + 1)),
    }
}

/// Parses the table in a known part of a text.
pub(crate) fn parse_layout(
    decoded: &Decoded<'_>,
    file: &Path,
    wanted: &[Wanted],
    layout: &Layout,
) -> TableReading {
    let mut parser = Parser {
        file,
        wanted,
        layout,
        told: Told::default(),
    };
    let mut table = parser.table(&decoded.text);
    if let Some(table) = &mut table
        && !layout.own
    {
        table.said.insert(
            0,
            format!(
                "{}, cells separated by a {}, decimal {}, header in line {}",
                decoded.encoding,
                layout.dialect.separator_word(),
                layout.dialect.decimal.word(),
                layout.dialect.header.map_or(0, |h| h + 1),
            ),
        );
    } else if let Some(table) = &mut table
        && !decoded.encoding.starts_with("UTF-8")
    {
        table.said.insert(0, decoded.encoding.to_owned());
    }
    let problems = parser.told.problems();
    let sound = !problems.iter().any(Problem::is_error);
    TableReading {
        table: table.filter(|_| sound),
        problems,
    }
}

struct Parser<'a> {
    file: &'a Path,
    wanted: &'a [Wanted],
    layout: &'a Layout,
    told: Told,
}

impl Parser<'_> {
    fn table(&mut self, text: &str) -> Option<Table> {
        let dialect = &self.layout.dialect;
        let header = dialect.header?;
        let probe: Vec<&str> = text.lines().take(header + 2).collect();
        let mut labels = dialect.labels(&probe);
        while labels.len() > 1 && labels.last().is_some_and(|label| label.full.is_empty()) {
            labels.pop();
        }
        let chosen = Header {
            file: self.file,
            line: Some(header + 1),
            labels: &labels,
            warn_of_others: self.layout.warn_of_others,
        }
        .choose(self.wanted);
        let sound = !chosen.problems.iter().any(Problem::is_error);
        chosen
            .problems
            .into_iter()
            .for_each(|problem| self.told.add(problem));
        if !sound || chosen.columns.is_empty() {
            return None;
        }
        let columns = chosen.columns;
        let mut values: Vec<Vec<f64>> = columns
            .iter()
            .map(|_| Vec::with_capacity(text.len() / 24))
            .collect();
        let mut runs: Vec<(usize, usize)> = Vec::new();
        let mut expected_line = 0;
        let mut fields: Vec<&[u8]> = Vec::with_capacity(labels.len() + 1);
        let begin = header + 1 + usize::from(dialect.units_below);
        for (idx, line) in text
            .as_bytes()
            .split(|b| *b == b'\n')
            .enumerate()
            .skip(begin)
        {
            let trimmed = line.trim_ascii();
            if trimmed.is_empty() || trimmed[0] == b'#' {
                if self.layout.ends && !values[0].is_empty() {
                    break;
                }
                continue;
            }
            let number_of_line = idx + 1;
            fields.clear();
            if trimmed.contains(&b'"') {
                // The bytes are a part of a text that was decoded.
                let line = std::str::from_utf8(line).unwrap_or_default();
                fields.extend(
                    cells(line, dialect.separator)
                        .into_iter()
                        .map(str::as_bytes),
                );
            } else {
                fields.extend(line.split(|b| *b == dialect.separator));
            }
            if fields.len() == labels.len() + 1 && fields[labels.len()].trim_ascii().is_empty() {
                fields.pop();
            }
            if self.layout.ends && !self.is_row(&fields) {
                if values[0].is_empty() {
                    continue;
                }
                break;
            }
            if number_of_line != expected_line {
                runs.push((values[0].len(), number_of_line));
            }
            expected_line = number_of_line + 1;
            if fields.len() != labels.len() {
                let problem = Problem::error(
                    self.file,
                    format!("{} fields in `{}`", fields.len(), shown(line)),
                    labels.len().to_string(),
                    self.remedy_of_fields(),
                );
                self.told.tell("fields", problem.at_line(number_of_line));
                runs.push((values[0].len(), number_of_line + 1));
                continue;
            }
            for (column, out) in columns.iter().zip(&mut values) {
                let value = self.value(fields[column.place].trim_ascii(), column, number_of_line);
                let value = value * column.factor;
                if column.wanted == 0
                    && let Some(before) = out.last().copied()
                    && value <= before
                {
                    let problem = not_increasing(self.file, value, before);
                    let key = labels[column.place].full.clone();
                    self.told
                        .tell("times", problem.at_line(number_of_line).at_key(key));
                }
                out.push(value);
            }
        }
        if values[0].len() < 2 && self.told.is_empty() {
            self.told.add(too_few(self.file, values[0].len()));
        }
        let mut table = Table {
            lines: runs,
            said: chosen.said,
            ..Table::default()
        };
        for (column, values) in columns.into_iter().zip(values) {
            let quantity = self.wanted[column.wanted].quantity;
            table.columns.insert(quantity, values);
            table
                .names
                .insert(quantity, labels[column.place].full.clone());
        }
        Some(table)
    }

    fn is_row(&self, fields: &[&[u8]]) -> bool {
        let decimal = self.layout.dialect.decimal;
        fields.len() > 1
            && fields.iter().all(|cell| {
                is_missing(cell.trim_ascii()) || number(cell.trim_ascii(), decimal).is_some()
            })
    }

    fn remedy_of_fields(&self) -> String {
        let decimal = match self.layout.dialect.decimal {
            Decimal::Point => "write decimals with a point",
            Decimal::Comma => "write decimals with a comma",
        };
        format!("fill in what is missing, leave a cell empty where a sample was lost; {decimal}")
    }

    fn value(&mut self, cell: &[u8], column: &Column, line: usize) -> f64 {
        let decimal = self.layout.dialect.decimal;
        if let Some(value) = number(cell, decimal) {
            return value;
        }
        let cell = match cell {
            [b'"', inner @ .., b'"'] => inner.trim_ascii(),
            _ => cell,
        };
        if let Some(value) = number(cell, decimal) {
            return value;
        }
        let wanted = &self.wanted[column.wanted];
        let missing = is_missing(cell);
        if missing && wanted.may_lack {
            return f64::NAN;
        }
        let found = if cell.is_empty() {
            "an empty cell".to_owned()
        } else {
            format!("`{}`", shown(cell))
        };
        let expected = if wanted.may_lack {
            "a number, or an empty cell"
        } else {
            "a number"
        };
        let remedy = format!(
            "leave the cell empty where a sample was lost, and write decimals with a {}",
            decimal.word()
        );
        let key = wanted
            .names
            .first()
            .map_or(wanted.quantity, |(name, _)| name);
        let kind = if missing { "missing" } else { "number" };
        let problem = Problem::error(self.file, found, expected, remedy);
        self.told.tell(kind, problem.at_line(line).at_key(key));
        f64::NAN
    }
}

/// Error for a time that is not after the one before it.
pub(crate) fn not_increasing(file: &Path, value: f64, before: f64) -> Problem {
    // A point between thousands: 1.000 after 996.
    let thousandfold = 1e3 * value - before;
    let remedy = if value == before {
        "export the times with more decimals: rounded ones are equal (a sheet's cells as numbers, or as hh:mm:ss.000)"
    } else if thousandfold > 0.0 && thousandfold < 0.05 * before {
        "export the times without separators of thousands: this one may be a thousand times as long"
    } else {
        "sort the samples, keep one for each time, and give each recording a file of its own"
    };
    Problem::error(
        file,
        format!("{value} ms after {before} ms"),
        "increasing times",
        remedy,
    )
}

/// Error for a table without rows.
pub(crate) fn too_few(file: &Path, n: usize) -> Problem {
    Problem::error(
        file,
        format!("{n} samples"),
        "a recording",
        "export the recording again",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted() -> Vec<Wanted> {
        let column = |quantity, names: &[(&str, f64)], required, may_lack| Wanted {
            quantity,
            given: false,
            names: names
                .iter()
                .map(|(name, factor)| ((*name).to_owned(), *factor))
                .collect(),
            required,
            may_lack,
        };
        vec![
            column("time", &[("time_ms", 1.0), ("time_s", 1000.0)], true, false),
            column(
                "lv_pressure",
                &[("lv_pressure_mmHg", 1.0), ("lv_pressure_kPa", 7.5)],
                true,
                true,
            ),
            column("ecg", &[("ecg_mV", 1.0)], false, true),
        ]
    }

    fn read(text: &str) -> TableReading {
        parse(text.as_bytes(), Path::new("raw/catheter.csv"), &wanted())
    }

    #[test]
    fn columns_are_found_by_name_in_any_order_and_unit() {
        let reading = read(
            "# a lab\necg_mV, lv_pressure_kPa ,time_s\r\n0.1,1.0,0.000\r\n,2,0.001\r\n# x\n0.3,nan,0.002\n",
        );
        assert_eq!(reading.problems, []);
        let table = reading.table.unwrap();
        assert_eq!(table.columns["time"], [0.0, 1.0, 2.0]);
        assert_eq!(table.columns["lv_pressure"][..2], [7.5, 15.0]);
        assert!(table.columns["lv_pressure"][2].is_nan() && table.columns["ecg"][1].is_nan());
        assert_eq!(table.names["time"], "time_s");
        assert_eq!([table.line(0), table.line(1), table.line(2)], [3, 4, 6]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let reading = read("time_ms,lv_pressure_mmHg\n0,7\n1,x\n1,8\n2\n3,\n");
        let told: Vec<String> = reading.problems.iter().map(ToString::to_string).collect();
        assert!(reading.table.is_none());
        assert_eq!(told.len(), 3, "{told:#?}");
        assert!(
            told[0].starts_with("error: raw/catheter.csv:3: lv_pressure_mmHg: found `x`"),
            "{}",
            told[0]
        );
        assert!(
            told[1].starts_with("error: raw/catheter.csv:4: time_ms: found 1 ms after 1 ms"),
            "{}",
            told[1]
        );
        assert!(
            told[2].contains("catheter.csv:5: found 1 fields in `2`"),
            "{}",
            told[2]
        );
    }

    #[test]
    fn headers_are_never_guessed() {
        let text = |text: &str| {
            read(text)
                .problems
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join("\n")
        };
        assert!(text("0,7\n1,8\n").contains("no header"));
        assert!(text("time_ms,lv_pressure\n0,7\n").contains("found column `lv_pressure`"));
        assert!(text("").contains("an empty file"));
        assert!(
            text("time_ms,time_s,lv_pressure_mmHg\n0,0,7\n1,1,8\n").contains("2 columns of it")
        );
        // Only the times of an electrocardiogram count.
        assert_eq!(text("time_ms,lv_pressure_mmHg,ecg\n0,7,0\n1,8,0\n"), "");
        let more = read("time_ms,lv_pressure_mmHg,temperature\n0,7,36\n1,7,36\n");
        assert!(more.table.is_some() && more.problems.len() == 1 && !more.problems[0].is_error());
    }

    #[test]
    fn a_thousand_bad_lines_are_counted() {
        let body: String = (0..1000).map(|i| format!("{i},bad\n")).collect();
        let reading = read(&format!("time_ms,lv_pressure_mmHg\n{body}"));
        assert_eq!(reading.problems.len(), crate::told::MOST + 1);
        assert!(
            reading.problems[crate::told::MOST]
                .found
                .starts_with("995 more lines")
        );
    }
}
