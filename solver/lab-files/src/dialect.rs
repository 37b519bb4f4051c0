//! Separator, decimal sign and header of a text table, seen from its lines.

use crate::headers::{Label, is_unit};
use crate::number::{Decimal, is_missing, number};

/// Number of lines that are examined.
const PROBE: usize = 4000;
/// Separators that are tried.
const SEPARATORS: [u8; 3] = [b'\t', b';', b','];
/// Fewest rows of numbers that make a table.
const FEWEST: usize = 2;

/// Form of a text table.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialect {
    /// Byte between the cells.
    pub separator: u8,
    /// Sign between the digits before and after the decimal place.
    pub decimal: Decimal,
    /// Index of the header's line, from 0; `None` where numbers have no header.
    pub header: Option<usize>,
    /// Whether the line below the header has the units.
    pub units_below: bool,
    /// Index of the first line of numbers, from 0.
    pub first: usize,
}

impl Dialect {
    /// Name of the separator in messages.
    #[must_use]
    pub fn separator_word(&self) -> &'static str {
        separator_word(self.separator)
    }

    /// Labels of the columns.
    #[must_use]
    pub fn labels(&self, lines: &[&str]) -> Vec<Label> {
        let Some(header) = self.header.and_then(|header| lines.get(header)) else {
            return Vec::new();
        };
        let names = cells(header, self.separator);
        if !self.units_below {
            return names.into_iter().map(Label::new).collect();
        }
        let units = lines
            .get(self.header.unwrap_or(0) + 1)
            .map(|line| cells(line, self.separator))
            .unwrap_or_default();
        names
            .into_iter()
            .enumerate()
            .map(|(i, name)| {
                let unit = units.get(i).map(|unit| {
                    unit.trim()
                        .trim_matches('"')
                        .trim_matches(['(', ')', '[', ']', '{', '}'])
                });
                Label::with_unit(name, unit.filter(|unit| !["*", "-"].contains(unit)))
            })
            .collect()
    }
}

fn separator_word(separator: u8) -> &'static str {
    match separator {
        b'\t' => "tab",
        b';' => "semicolon",
        _ => "comma",
    }
}

/// Cells of a line. A separator inside quotation marks does not count.
#[must_use]
pub(crate) fn cells(line: &str, separator: u8) -> Vec<&str> {
    let line = line.trim_end_matches(['\r', '\n']);
    let (mut cells, mut begin, mut quoted) = (Vec::new(), 0, false);
    for (i, byte) in line.bytes().enumerate() {
        if byte == b'"' {
            quoted = !quoted;
        } else if byte == separator && !quoted {
            cells.push(&line[begin..i]);
            begin = i + 1;
        }
    }
    cells.push(&line[begin..]);
    cells
}

/// Whether a line is a row of at least two cells that are numbers or empty, at least one of them a
/// number, and how many there are.
fn row(line: &str, separator: u8, decimal: Decimal) -> Option<usize> {
    let cells = cells(line, separator);
    let mut numbers = 0;
    for cell in &cells {
        let cell = cell.trim().trim_matches('"').as_bytes();
        if number(cell, decimal).is_some() {
            numbers += 1;
        } else if !is_missing(cell) {
            return None;
        }
    }
    (numbers >= 1 && cells.len() >= 2).then_some(cells.len())
}

/// Reasons why lines are no table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoDialect {
    /// There are no rows of numbers.
    NoNumbers,
    /// The same comma separates cells and decimals.
    SameSign {
        /// Line of the first row, from 1.
        line: usize,
    },
}

/// Finds the form of a table among lines, from the longest run of rows of numbers with the same
/// number of cells.
///
/// # Errors
/// [`NoDialect`] if there are no rows, or if separators and decimal signs look alike.
pub fn sniff(lines: &[&str]) -> Result<Dialect, NoDialect> {
    let probe = &lines[..lines.len().min(PROBE)];
    let mut best: Option<(usize, Dialect)> = None;
    for separator in SEPARATORS {
        for decimal in [Decimal::Point, Decimal::Comma] {
            if separator == decimal.byte() {
                continue;
            }
            let Some((rows, first)) = longest_run(probe, separator, decimal) else {
                continue;
            };
            // The first of equal forms stays: a tab before a semicolon, a point before a comma.
            if rows < FEWEST || best.as_ref().is_some_and(|(most, _)| rows <= *most) {
                continue;
            }
            let (header, units_below) = header_above(probe, first, separator);
            best = Some((
                rows,
                Dialect {
                    separator,
                    decimal,
                    header,
                    units_below,
                    first,
                },
            ));
        }
    }
    let Some((_, dialect)) = best else {
        return Err(NoDialect::NoNumbers);
    };
    // `0,001,7,5` under `t,p`: every comma would be both.
    if dialect.separator == b','
        && let Some(header) = dialect.header
    {
        let names = cells(probe[header], b',').len();
        let numbers = cells(probe[dialect.first], b',').len();
        if names > 1 && numbers == 2 * names && !probe[dialect.first].contains('.') {
            return Err(NoDialect::SameSign {
                line: dialect.first + 1,
            });
        }
    }
    Ok(dialect)
}

/// Most rows in a row with the same number of cells, and the index of the first of them. Empty
/// lines and comments do not end a run.
fn longest_run(lines: &[&str], separator: u8, decimal: Decimal) -> Option<(usize, usize)> {
    let mut best: Option<(usize, usize)> = None;
    let mut run: Option<(usize, usize, usize)> = None;
    for (i, line) in lines.iter().enumerate() {
        let trimmed = line.trim();
        if trimmed.is_empty() || trimmed.starts_with('#') {
            continue;
        }
        run = match (row(line, separator, decimal), run) {
            (Some(n), Some((width, rows, first))) if n == width => Some((width, rows + 1, first)),
            (Some(n), _) => Some((n, 1, i)),
            (None, _) => None,
        };
        if let Some((_, rows, first)) = run
            && best.is_none_or(|(most, _)| rows > most)
        {
            best = Some((rows, first));
        }
    }
    best
}

/// Index of the header above the first row of numbers, and whether units are below it.
fn header_above(lines: &[&str], first: usize, separator: u8) -> (Option<usize>, bool) {
    let above = |from: usize| {
        (0..from).rev().find(|i| {
            let line = lines[*i].trim();
            !line.is_empty() && !line.starts_with('#')
        })
    };
    let Some(last) = above(first) else {
        return (None, false);
    };
    let width = cells(lines[first], separator).len();
    let here = cells(lines[last], separator);
    if here.len() < 2 && width >= 2 {
        return (None, false);
    }
    let units =
        here.iter().all(|cell| is_unit(cell)) && here.iter().any(|cell| !cell.trim().is_empty());
    match above(last) {
        Some(names) if units && cells(lines[names], separator).len() >= 2 && names + 1 == last => {
            (Some(names), true)
        }
        _ => (Some(last), false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Dialect, NoDialect> {
        sniff(&text.lines().collect::<Vec<_>>())
    }

    #[test]
    fn separators_and_decimals_are_seen() {
        for (text, separator, decimal) in [
            ("t\tp\n0.1\t7.5\n0.2\t8\n", b'\t', Decimal::Point),
            ("t;p\n0,1;7,5\n0,2;8\n", b';', Decimal::Comma),
            ("t\tp\n0,1\t7,5\n0,2\t8\n", b'\t', Decimal::Comma),
            ("t,p\n0.1,7.5\n0.2,8\n", b',', Decimal::Point),
            ("t;p\n1;7.5\n2;8\n", b';', Decimal::Point),
            (
                "\"t, s\",\"p, mmHg\"\n0.1,7.5\n0.2,8\n",
                b',',
                Decimal::Point,
            ),
        ] {
            let dialect = of(text).unwrap();
            assert_eq!(
                (dialect.separator, dialect.decimal),
                (separator, decimal),
                "{text}"
            );
            assert_eq!((dialect.header, dialect.first), (Some(0), 1), "{text}");
        }
    }

    #[test]
    fn a_preamble_and_a_line_of_units_are_seen() {
        let text = "Name:\tX\n\n\nTime\tPressure\n(s)\t(mmHg)\n0\t7\n1\t8\n2\t9\n";
        let dialect = of(text).unwrap();
        assert_eq!(
            (dialect.header, dialect.units_below, dialect.first),
            (Some(3), true, 5)
        );
        let labels = dialect.labels(&text.lines().collect::<Vec<_>>());
        assert_eq!(labels[1].full, "Pressure (mmHg)");
        assert_eq!(of("0\t7\n1\t8\n").unwrap().header, None);
    }

    #[test]
    fn one_sign_for_both_is_refused() {
        assert_eq!(
            of("t,p\n0,001,7,5\n0,002,7,6\n"),
            Err(NoDialect::SameSign { line: 2 })
        );
        assert_eq!(of("no\nnumbers, here\n"), Err(NoDialect::NoNumbers));
        assert_eq!(of(""), Err(NoDialect::NoNumbers));
    }
}
