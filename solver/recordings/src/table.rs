//! Fast parser for columns of a CSV file. Half an hour at 1 kHz has two million lines, and reading
//! them must not take longer than all following steps.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_signals::Problem;

/// Number of lines that are reported individually for each kind of problem; further ones are
/// counted.
const MAX_TOLD: usize = 5;
/// Number of decimal digits that the mantissa of a float represents exactly.
const EXACT_DIGITS: u32 = 15;

/// A quantity to read.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// Name of the quantity in messages, for example `lv_pressure`.
    pub quantity: &'static str,
    /// Accepted column names with their factors to our unit, for example `lv_pressure_mmHg` with 1.
    pub names: Vec<(String, f64)>,
    /// Whether the file must have it.
    pub required: bool,
    /// Whether samples may be missing: an empty cell, `nan` or `NA`.
    pub may_lack: bool,
}

/// Columns that were read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Values of the quantities in our units; NaN for a missing sample.
    pub columns: BTreeMap<&'static str, Vec<f64>>,
    /// Name of the column for each quantity.
    pub names: BTreeMap<&'static str, String>,
    /// Line numbers, from 1, as pairs of the first row in a run of consecutive lines and the line
    /// of that row. Comments end a run.
    lines: Vec<(usize, usize)>,
}

impl Table {
    /// Line number of a row, from 1.
    #[must_use]
    pub fn line(&self, row: usize) -> usize {
        let run = self.lines.partition_point(|(first, _)| *first <= row);
        run.checked_sub(1)
            .map_or(1, |run| self.lines[run].1 + row - self.lines[run].0)
    }
}

/// The table if it could be read, and all problems.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TableReading {
    /// The table; `None` if the problems include an error.
    pub table: Option<Table>,
    /// Problems in the order of their lines.
    pub problems: Vec<Problem>,
}

/// Parses the columns for `wanted` from the content of `file`: a header, then numbers separated by
/// commas. Lines that begin with `#` are comments. The first quantity is time and must increase.
#[must_use]
pub fn parse(bytes: &[u8], file: &Path, wanted: &[Wanted]) -> TableReading {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut parser = Parser {
        file,
        wanted,
        problems: Vec::new(),
        told: BTreeMap::new(),
    };
    let table = parser.table(bytes);
    parser.count_the_rest();
    let Parser { problems, .. } = parser;
    let sound = !problems.iter().any(Problem::is_error);
    TableReading {
        table: table.filter(|_| sound),
        problems,
    }
}

struct Parser<'a> {
    file: &'a Path,
    wanted: &'a [Wanted],
    problems: Vec<Problem>,
    told: BTreeMap<&'static str, (usize, Option<Problem>)>,
}

/// A column to read: its position in a line, its index in `wanted`, and its factor.
struct Column {
    place: usize,
    wanted: usize,
    factor: f64,
}

impl Parser<'_> {
    fn table(&mut self, bytes: &[u8]) -> Option<Table> {
        let mut lines = bytes
            .split(|b| *b == b'\n')
            .enumerate()
            .filter(|(_, line)| {
                let line = line.trim_ascii();
                !line.is_empty() && line[0] != b'#'
            });
        let Some((header_idx, header)) = lines.next() else {
            let expected = format!("a header with {}", self.names_of(0));
            self.problems.push(Problem::error(
                self.file,
                "an empty file",
                expected,
                "export the recording again",
            ));
            return None;
        };
        let header = String::from_utf8_lossy(header);
        let names: Vec<&str> = header
            .trim()
            .split(',')
            .map(|name| name.trim().trim_matches('"'))
            .collect();
        let columns = self.columns(header_idx + 1, &names)?;
        let mut values: Vec<Vec<f64>> = columns
            .iter()
            .map(|_| Vec::with_capacity(bytes.len() / 24))
            .collect();
        let mut runs: Vec<(usize, usize)> = Vec::new();
        let mut expected_line = 0;
        let mut cells: Vec<&[u8]> = Vec::with_capacity(names.len() + 1);
        for (idx, line) in lines {
            let number = idx + 1;
            if number != expected_line {
                runs.push((values[0].len(), number));
            }
            expected_line = number + 1;
            cells.clear();
            cells.extend(line.split(|b| *b == b','));
            if cells.len() != names.len() {
                let problem = Problem::error(
                    self.file,
                    format!("{} fields in `{}`", cells.len(), shown(line)),
                    names.len().to_string(),
                    "fill in what is missing, leave a cell empty where a sample was lost; write decimals with a point",
                );
                self.tell("fields", problem.at_line(number));
                runs.push((values[0].len(), number + 1));
                continue;
            }
            for (column, out) in columns.iter().zip(&mut values) {
                let value = self.value(cells[column.place].trim_ascii(), column, number);
                let value = value * column.factor;
                if column.wanted == 0
                    && let Some(before) = out.last().copied()
                    && value <= before
                {
                    let found = format!("{value} ms after {before} ms");
                    let remedy = "sort the samples, keep one for each time, and give each recording a file of its own";
                    let problem = Problem::error(self.file, found, "increasing times", remedy);
                    self.tell("times", problem.at_line(number).at_key(names[column.place]));
                }
                out.push(value);
            }
        }
        if values[0].len() < 2 && self.problems.is_empty() {
            let found = format!("{} samples", values[0].len());
            self.problems.push(Problem::error(
                self.file,
                found,
                "a recording",
                "export the recording again",
            ));
        }
        let mut table = Table {
            lines: runs,
            ..Table::default()
        };
        for (column, values) in columns.into_iter().zip(values) {
            let quantity = self.wanted[column.wanted].quantity;
            table.columns.insert(quantity, values);
            table.names.insert(quantity, names[column.place].to_owned());
        }
        Some(table)
    }

    /// Finds the columns for the wanted quantities.
    fn columns(&mut self, line: usize, names: &[&str]) -> Option<Vec<Column>> {
        let n_before = self.problems.len();
        if names.iter().all(|name| number(name.as_bytes()).is_some()) {
            let found = format!("the numbers `{}` and no header", names.join(","));
            let remedy =
                "put names above the numbers, with the units in them: units are never guessed";
            let expected = format!("a header with {}", self.names_of(0));
            self.problems
                .push(Problem::error(self.file, found, expected, remedy).at_line(line));
            return None;
        }
        let mut columns = Vec::new();
        for (idx, wanted) in self.wanted.iter().enumerate() {
            let found: Vec<(usize, f64)> = names
                .iter()
                .enumerate()
                .filter_map(|(place, name)| {
                    let (_, factor) = wanted.names.iter().find(|(known, _)| known == name)?;
                    Some((place, *factor))
                })
                .collect();
            match found[..] {
                [(place, factor)] => columns.push(Column {
                    place,
                    wanted: idx,
                    factor,
                }),
                [] if wanted.required || self.without_unit(wanted, names) => {
                    let alike = names.iter().find(|name| {
                        name.to_lowercase()
                            .starts_with(wanted.quantity.split('_').next().unwrap_or_default())
                    });
                    let found = alike.map_or_else(
                        || format!("`{}`", names.join(",")),
                        |name| format!("column `{name}`"),
                    );
                    let remedy = "name the column so, or say in prepare.toml which column it is; the name carries the unit";
                    let problem = Problem::error(
                        self.file,
                        found,
                        format!("a column {}", self.names_of(idx)),
                        remedy,
                    );
                    self.problems
                        .push(problem.at_line(line).at_key(wanted.names[0].0.clone()));
                }
                [] => {}
                _ => {
                    let found = format!("{} columns of it", found.len());
                    let problem = Problem::error(
                        self.file,
                        found,
                        format!("one column {}", self.names_of(idx)),
                        "remove or rename the others",
                    );
                    self.problems
                        .push(problem.at_line(line).at_key(wanted.names[0].0.clone()));
                }
            }
        }
        let known = |name: &str| {
            self.wanted
                .iter()
                .flat_map(|w| &w.names)
                .any(|(known, _)| known == name)
        };
        let others: Vec<&str> = names.iter().copied().filter(|name| !known(name)).collect();
        if !others.is_empty() {
            let all: Vec<String> = (0..self.wanted.len())
                .map(|idx| self.names_of(idx))
                .collect();
            let found = format!("columns that are not read: `{}`", others.join("`, `"));
            let remedy =
                "remove them, or say in prepare.toml what they are, if they should be read";
            self.problems
                .push(Problem::warning(self.file, found, all.join("; "), remedy).at_line(line));
        }
        (!self.problems[n_before..].iter().any(Problem::is_error)).then_some(columns)
    }

    /// Whether a column has the name of a quantity but no unit or an unknown one. It must not be
    /// ignored silently.
    fn without_unit(&self, wanted: &Wanted, names: &[&str]) -> bool {
        let known = |name: &str| {
            self.wanted
                .iter()
                .flat_map(|w| &w.names)
                .any(|(known, _)| known == name)
        };
        names
            .iter()
            .any(|name| name.to_lowercase().starts_with(wanted.quantity) && !known(name))
    }

    fn names_of(&self, idx: usize) -> String {
        let names: Vec<String> = self.wanted[idx]
            .names
            .iter()
            .map(|(name, _)| format!("`{name}`"))
            .collect();
        names.join(" or ")
    }

    fn value(&mut self, cell: &[u8], column: &Column, line: usize) -> f64 {
        if let Some(value) = number(cell) {
            return value;
        }
        let wanted = &self.wanted[column.wanted];
        let missing = cell.is_empty()
            || [&b"nan"[..], b"na"]
                .iter()
                .any(|word| cell.eq_ignore_ascii_case(word));
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
        let remedy =
            "leave the cell empty where a sample was lost, and write decimals with a point";
        let key = wanted.names[0].0.clone();
        let kind = if missing { "missing" } else { "number" };
        self.tell(
            kind,
            Problem::error(self.file, found, expected, remedy)
                .at_line(line)
                .at_key(key),
        );
        f64::NAN
    }

    fn tell(&mut self, kind: &'static str, problem: Problem) {
        let (n, last) = self.told.entry(kind).or_default();
        *n += 1;
        if *n <= MAX_TOLD {
            self.problems.push(problem);
        } else {
            *last = Some(problem);
        }
    }

    fn count_the_rest(&mut self) {
        for (n, last) in std::mem::take(&mut self.told).into_values() {
            let Some(last) = last else { continue };
            let found = format!(
                "{} more lines like those before, the last one with {}",
                n - MAX_TOLD,
                last.found
            );
            self.problems.push(Problem { found, ..last });
        }
        self.problems.sort_by_key(|p| p.line);
    }
}

fn shown(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(text);
    let text = text.trim();
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).chain("...".chars()).collect()
    }
}

/// Parses a finite decimal number. With up to 15 digits and powers of ten up to 22, mantissa and
/// power are exact, so that one division rounds correctly (Clinger 1990, PLDI, section 3). All
/// other numbers use the general parser.
fn number(text: &[u8]) -> Option<f64> {
    let (negative, digits) = match text.first()? {
        b'-' => (true, &text[1..]),
        b'+' => (false, &text[1..]),
        _ => (false, text),
    };
    let (mut mantissa, mut n_digits, mut n_decimals, mut point) = (0_u64, 0_u32, 0_usize, false);
    for byte in digits {
        match byte {
            b'0'..=b'9' => {
                mantissa = mantissa
                    .wrapping_mul(10)
                    .wrapping_add(u64::from(byte - b'0'));
                n_digits += u32::from(mantissa > 0);
                n_decimals += usize::from(point);
            }
            b'.' if !point => point = true,
            _ => return slow(text),
        }
    }
    if n_digits > EXACT_DIGITS || n_decimals >= POWERS.len() || digits.len() == usize::from(point) {
        return slow(text);
    }
    let value = mantissa as f64 / POWERS[n_decimals];
    Some(if negative { -value } else { value })
}

const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

fn slow(text: &[u8]) -> Option<f64> {
    std::str::from_utf8(text)
        .ok()?
        .parse::<f64>()
        .ok()
        .filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted() -> Vec<Wanted> {
        let column = |quantity, names: &[(&str, f64)], required, may_lack| Wanted {
            quantity,
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
    fn numbers_are_read_as_the_standard_library_reads_them() {
        for text in [
            "0",
            "-0.0",
            "12.345",
            "0.1",
            "3.",
            ".5",
            "123456789012345",
            "1234567890123456789",
            "1e-3",
            "-7.25E2",
            "0.000001",
            "99.99999999999999",
            "+4",
        ] {
            assert_eq!(
                number(text.as_bytes()),
                Some(text.parse().unwrap()),
                "{text}"
            );
        }
        for text in ["", "-", ".", "1,5", "1.2.3", "abc", "inf", "nan", "--1"] {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
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
        assert!(
            text("time_ms,lv_pressure_mmHg,ecg\n0,7,0\n1,8,0\n")
                .contains("ecg_mV: found column `ecg`")
        );
        let more = read("time_ms,lv_pressure_mmHg,temperature\n0,7,36\n1,7,36\n");
        assert!(more.table.is_some() && more.problems.len() == 1 && !more.problems[0].is_error());
    }

    #[test]
    fn a_thousand_bad_lines_are_counted() {
        let body: String = (0..1000).map(|i| format!("{i},bad\n")).collect();
        let reading = read(&format!("time_ms,lv_pressure_mmHg\n{body}"));
        assert_eq!(reading.problems.len(), MAX_TOLD + 1);
        assert!(
            reading.problems[MAX_TOLD]
                .found
                .starts_with("995 more lines")
        );
    }
}
