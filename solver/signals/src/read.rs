//! Reading traces: `pressure.csv` (`time_ms,pressure_mmHg`) and `volume.csv` (`time_ms,volume_mL`) of a patient, a calcium
//! transient (`time_ms,calcium_uM`).
//!
//! A number without a unit is refused, never guessed. All problems of a file are returned at once; a kind of problem
//! that strikes many lines is told for the first few and then counted.

use crate::told::{Kind, Told};
use crate::{Problem, Quantity, Trace};
use cardiotwin_input_files::MaxBytes;
use std::path::Path;

/// An interval that is so many times the usual one is a gap.
const GAP_FACTOR: f64 = 1.75;
/// A gap of so many usual intervals, or of [`SEVERE_GAP_MS`], is an error: nothing honest can be put in its place.
const SEVERE_GAP_FACTOR: f64 = 4.0;
const SEVERE_GAP_MS: f64 = 20.0;

/// What a file gave: a trace unless an error stands in its way, and every problem found.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The trace, if all its samples could be read and lie in order.
    pub trace: Option<Trace>,
    /// All problems, in the order of their lines.
    pub problems: Vec<Problem>,
}

/// Who names a trace's file, and what the trace is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// A patient's file: the trace is resampled, so that gaps count.
    Patient,
    /// The command line: the trace is fitted, with samples of any spacing.
    CommandLine,
}

/// Reads a patient's trace file; a file that cannot be opened is a problem among others.
#[must_use]
pub fn read_trace(file: &Path, quantity: Quantity) -> Reading {
    read_trace_from(Origin::Patient, file, quantity)
}

/// Reads a trace file; one that cannot be opened is a problem among others.
#[must_use]
pub fn read_trace_from(origin: Origin, file: &Path, quantity: Quantity) -> Reading {
    let read = match origin {
        Origin::Patient => cardiotwin_input_files::read(file, MaxBytes::TRACE),
        // A shell's `<(command)` is a pipe.
        Origin::CommandLine => std::fs::read(file),
    };
    match read {
        Ok(bytes) => parse_trace_from(origin, &bytes, file, quantity),
        Err(cause) => Reading {
            trace: None,
            problems: vec![Problem::error(
                file,
                format!("no readable file ({cause})"),
                format!(
                    "a CSV file with the columns {}",
                    header(default_column(origin, quantity))
                ),
                match origin {
                    Origin::Patient => "check the name in patient.toml and the file's permissions",
                    Origin::CommandLine => "check the name and the file's permissions",
                },
            )],
        },
    }
}

/// Reads a patient's trace from a file's contents; `file` names it in problems.
#[must_use]
pub fn parse_trace(bytes: &[u8], file: &Path, quantity: Quantity) -> Reading {
    parse_trace_from(Origin::Patient, bytes, file, quantity)
}

/// Reads a trace from a file's contents; `file` names it in problems.
#[must_use]
pub fn parse_trace_from(origin: Origin, bytes: &[u8], file: &Path, quantity: Quantity) -> Reading {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut parser = Parser {
        file,
        bytes,
        quantity,
        origin,
        column: default_column(origin, quantity),
        problems: Vec::new(),
    };
    let samples = parser.samples();
    let trace = samples.and_then(|s| parser.trace(&s));
    let mut problems = parser.problems;
    problems.sort_by_key(|p| p.line);
    Reading { trace, problems }
}

/// What to do about a file without samples.
fn export_again(origin: Origin) -> &'static str {
    match origin {
        Origin::Patient => "export the trace again, or remove it from patient.toml",
        Origin::CommandLine => "export the trace again",
    }
}

/// The column that a file should have which has none of the quantity's.
fn default_column(origin: Origin, quantity: Quantity) -> &'static str {
    match origin {
        Origin::Patient => quantity.column(),
        Origin::CommandLine => quantity.other_column().unwrap_or(quantity.column()),
    }
}

fn header(column: &str) -> String {
    format!("`time_ms,{column}`")
}

/// A sample and the line that it stands in.
struct Sample {
    line: usize,
    time_ms: f64,
    value: f64,
}

struct Parser<'a> {
    file: &'a Path,
    bytes: &'a [u8],
    quantity: Quantity,
    origin: Origin,
    /// Name of the value's column.
    column: &'static str,
    problems: Vec<Problem>,
}

impl Parser<'_> {
    fn error(&mut self, found: String, expected: String, remedy: &str) {
        self.problems
            .push(Problem::error(self.file, found, expected, remedy));
    }

    /// All samples; none if the header or any line is wrong.
    fn samples(&mut self) -> Option<Vec<Sample>> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .comment(Some(b'#'))
            .from_reader(self.bytes);
        // One record serves all lines: cohorts have thousands of traces.
        let mut record = csv::StringRecord::new();
        let columns = match reader.read_record(&mut record) {
            Ok(true) => self.columns(&record)?,
            Err(cause) => {
                self.error(
                    format!("text that is not CSV ({cause})"),
                    header(self.column),
                    "save the file as UTF-8 text with commas",
                );
                return None;
            }
            Ok(false) => {
                self.error(
                    "an empty file".into(),
                    header(self.column),
                    export_again(self.origin),
                );
                return None;
            }
        };
        let mut told = Told::default();
        let mut samples = Vec::new();
        let mut sound = true;
        loop {
            match reader.read_record(&mut record) {
                Ok(false) => break,
                Ok(true) => match self.sample(&record, &columns, &mut told) {
                    Some(sample) => samples.push(sample),
                    None => sound = false,
                },
                Err(cause) => {
                    let line = self.line(cause.position());
                    let problem = Problem::error(
                        self.file,
                        format!("text that is not CSV ({cause})"),
                        "numbers separated by commas",
                        "save the file as UTF-8 text with commas",
                    );
                    told.push(Kind::Text, problem.at_line(line), &mut self.problems);
                    sound = false;
                }
            }
        }
        told.finish(self.file, &mut self.problems);
        if samples.len() < 2 && sound {
            let found = format!("{} samples", samples.len());
            self.error(
                found,
                "one beat's samples".into(),
                export_again(self.origin),
            );
            return None;
        }
        sound.then_some(samples)
    }

    /// The line of a record, from 1: its position is that of the comments and empty lines before it.
    fn line(&self, position: Option<&csv::Position>) -> usize {
        let Some(position) = position else { return 1 };
        let rest = self
            .bytes
            .get(position.byte() as usize..)
            .unwrap_or_default();
        let skipped = rest
            .split(|b| *b == b'\n')
            .take_while(|line| line.starts_with(b"#") || line.trim_ascii().is_empty());
        position.line() as usize + skipped.count()
    }

    /// Positions of time and value in a line.
    fn columns(&mut self, first: &csv::StringRecord) -> Option<Columns> {
        let names: Vec<&str> = first.iter().map(str::trim).collect();
        let shown = names.join(",");
        let expected = format!("the header {}", header(self.column));
        let line = self.line(first.position());
        if names.iter().all(|n| n.parse::<f64>().is_ok()) {
            self.header_error(line, None, format!("the numbers `{shown}` and no header"), expected, format!(
                "put {} above the numbers if these are their units, and convert them if not: units are never guessed",
                header(self.column)
            ));
            return None;
        }
        if names.len() == 1 && shown.contains([';', '\t', ' ']) {
            let found = format!("`{shown}`");
            let remedy = "separate columns by commas, and write decimals with a point".to_owned();
            self.header_error(line, None, found, expected, remedy);
            return None;
        }
        let known = [Some(self.quantity.column()), self.quantity.other_column()];
        let known = known
            .into_iter()
            .flatten()
            .find(|column| names.contains(column));
        self.column = known.unwrap_or(self.column);
        let time = self.column(line, &names, "time_ms", time_like);
        let value = self.column(line, &names, self.column, |n| !time_like(n));
        let (time, value) = (time?, value?);
        for (i, name) in names
            .iter()
            .enumerate()
            .filter(|(i, _)| *i != time && *i != value)
        {
            let problem = Problem::warning(
                self.file,
                format!("column {} `{name}`", i + 1),
                format!("only {}", header(self.column)),
                "it is not read; remove it if that is meant",
            );
            self.problems.push(problem.at_line(line).at_key(*name));
        }
        Some(Columns {
            time,
            value,
            n: names.len(),
        })
    }

    /// Position of one column; if it is missing, says what stands in its place.
    fn column(
        &mut self,
        line: usize,
        names: &[&str],
        wanted: &str,
        alike: impl Fn(&str) -> bool,
    ) -> Option<usize> {
        let positions: Vec<usize> = names
            .iter()
            .enumerate()
            .filter(|(_, n)| **n == wanted)
            .map(|(i, _)| i)
            .collect();
        match positions[..] {
            [position] => return Some(position),
            [] => {}
            _ => {
                self.header_error(
                    line,
                    Some(wanted),
                    format!("{} columns of this name", positions.len()),
                    "one".into(),
                    "remove or rename the others".into(),
                );
                return None;
            }
        }
        let other = match self.quantity {
            Quantity::Pressure if self.origin == Origin::CommandLine => Some(Quantity::Flow),
            Quantity::Pressure => Some(Quantity::Volume),
            Quantity::Volume | Quantity::Flow => Some(Quantity::Pressure),
            _ => None,
        };
        let stand_in = names.iter().find(|n| alike(n));
        let found = stand_in.map_or_else(
            || format!("`{}`", names.join(",")),
            |n| format!("column `{n}`"),
        );
        let remedy = match (stand_in, other) {
            (Some(n), Some(other)) if *n == other.column() && wanted != "time_ms" => {
                let place = if self.origin == Origin::Patient {
                    "in patient.toml"
                } else {
                    "on the command line"
                };
                format!("this is a {other} file: are the two files swapped {place}?")
            }
            (Some(n), _) => unit_remedy(n, wanted),
            (None, _) => format!("add the column; the header must be {}", header(self.column)),
        };
        self.header_error(
            line,
            Some(wanted),
            found,
            format!("the column `{wanted}`"),
            remedy,
        );
        None
    }

    fn header_error(
        &mut self,
        line: usize,
        key: Option<&str>,
        found: String,
        expected: String,
        remedy: String,
    ) {
        let mut problem = Problem::error(self.file, found, expected, remedy).at_line(line);
        problem.key = key.map(str::to_owned);
        self.problems.push(problem);
    }

    fn sample(
        &mut self,
        record: &csv::StringRecord,
        columns: &Columns,
        told: &mut Told,
    ) -> Option<Sample> {
        let line = self.line(record.position());
        if record.len() != columns.n {
            let shown: Vec<&str> = record.iter().map(str::trim).collect();
            let problem = Problem::error(
                self.file,
                format!("{} fields in `{}`", record.len(), shown.join(",")),
                format!("{}", columns.n),
                "fill in what is missing; write decimals with a point, not a comma",
            );
            told.push(Kind::Fields, problem.at_line(line), &mut self.problems);
            return None;
        }
        let (value_column, unit) = (self.column, self.quantity.unit());
        let time_ms = self.number(line, record[columns.time].trim(), "time_ms", "ms", told);
        let value = self.number(line, record[columns.value].trim(), value_column, unit, told);
        let (time_ms, value) = (time_ms?, value?);
        if self.quantity == Quantity::Calcium && value < 0.0 {
            let problem = Problem::error(
                self.file,
                format!("`{value}`"),
                format!("a concentration in {unit}, 0 or more"),
                "calibrate the signal to concentrations: a background that was subtracted belongs to the resting calcium",
            );
            told.push(
                Kind::Negative,
                problem.at_line(line).at_key(value_column),
                &mut self.problems,
            );
            return None;
        }
        Some(Sample {
            line,
            time_ms,
            value,
        })
    }

    fn number(
        &mut self,
        line: usize,
        cell: &str,
        column: &str,
        unit: &str,
        told: &mut Told,
    ) -> Option<f64> {
        let parsed = cell.parse::<f64>();
        if let Ok(number) = parsed
            && number.is_finite()
        {
            return Some(number);
        }
        let (kind, found) = match parsed {
            _ if cell.is_empty() => (Kind::Empty, "an empty cell".to_owned()),
            Ok(_) => (Kind::NotFinite, format!("`{cell}`")),
            Err(_) => (Kind::NotANumber, format!("`{cell}`")),
        };
        let is_grouped = cell.contains(|c: char| ",'’ \u{a0}\u{202f}".contains(c))
            && cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
        let problem = Problem::error(
            self.file,
            found,
            format!("a finite number in {unit}"),
            if is_grouped {
                "write the number with a decimal point and without thousands separators"
            } else if self.origin == Origin::Patient {
                "remove the line or fill in what was measured; a few lost samples are bridged, a longer gap is reported"
            } else {
                "remove the line or fill in what was measured"
            },
        );
        told.push(
            kind,
            problem.at_line(line).at_key(column),
            &mut self.problems,
        );
        None
    }

    fn trace(&mut self, samples: &[Sample]) -> Option<Trace> {
        let rising = |f: fn(&Sample) -> f64| samples.windows(2).all(|w| f(&w[1]) > f(&w[0]));
        if !rising(|s| s.time_ms) {
            if rising(|s| s.value) {
                let problem = Problem::error(
                    self.file,
                    "values that increase throughout and times that do not",
                    format!(
                        "increasing times under `time_ms` and {}s under `{}`",
                        self.quantity, self.column
                    ),
                    "the two columns look swapped: exchange their names in the header",
                );
                self.problems.push(problem.at_line(samples[0].line));
            } else {
                self.order(samples);
            }
            return None;
        }
        // A fit takes samples of any spacing.
        if self.origin == Origin::Patient {
            self.gaps(samples);
        }
        let time_ms = samples.iter().map(|s| s.time_ms).collect();
        Trace::new(
            self.quantity,
            time_ms,
            samples.iter().map(|s| s.value).collect(),
        )
        .ok()
    }

    fn order(&mut self, samples: &[Sample]) {
        let mut told = Told::default();
        for w in samples.windows(2).filter(|w| w[1].time_ms <= w[0].time_ms) {
            let doubled = w[1].time_ms == w[0].time_ms;
            let (kind, found, remedy) = if doubled {
                (
                    Kind::Doubled,
                    format!("{} ms a second time", w[1].time_ms),
                    "keep one sample for each time",
                )
            } else {
                (
                    Kind::Backwards,
                    format!("{} ms after {} ms", w[1].time_ms, w[0].time_ms),
                    "sort the samples, and keep one beat only",
                )
            };
            let problem = Problem::error(self.file, found, "increasing times", remedy);
            told.push(
                kind,
                problem.at_line(w[1].line).at_key("time_ms"),
                &mut self.problems,
            );
        }
        told.finish(self.file, &mut self.problems);
    }

    fn gaps(&mut self, samples: &[Sample]) {
        let step = median_step_ms(samples.iter().map(|s| s.time_ms));
        let mut told = Told::default();
        for w in samples.windows(2) {
            let gap = w[1].time_ms - w[0].time_ms;
            if gap <= GAP_FACTOR * step {
                continue;
            }
            let found = format!("no sample between {} and {} ms", w[0].time_ms, w[1].time_ms);
            let expected = format!("one every {step} ms");
            let (kind, problem) = if gap > SEVERE_GAP_FACTOR * step && gap > SEVERE_GAP_MS {
                let remedy = "fill in what was measured, or take another beat";
                (
                    Kind::SevereGap,
                    Problem::error(self.file, found, expected, remedy),
                )
            } else {
                (
                    Kind::Gap,
                    Problem::warning(
                        self.file,
                        found,
                        expected,
                        "the gap is bridged by interpolation",
                    ),
                )
            };
            told.push(
                kind,
                problem.at_line(w[1].line).at_key("time_ms"),
                &mut self.problems,
            );
        }
        told.finish(self.file, &mut self.problems);
    }
}

struct Columns {
    time: usize,
    value: usize,
    n: usize,
}

fn time_like(name: &str) -> bool {
    let name = name.to_lowercase();
    name.starts_with("time") || name == "t" || name.starts_with("t_") || name.starts_with("t (")
}

/// What to do about a column whose name lacks its unit or carries another one.
fn unit_remedy(found: &str, wanted: &str) -> String {
    let lower = found.to_lowercase();
    let factor = match wanted {
        "time_ms" if lower.ends_with("_s") || lower.contains("sec") => Some("1 s = 1000 ms"),
        "pressure_mmHg" if lower.contains("kpa") => Some("1 kPa = 7.50062 mmHg"),
        "pressure_mmHg" if lower.contains("pa") => Some("1 Pa = 0.00750062 mmHg"),
        "volume_mL"
            if lower == "volume_l" || lower.contains("litre") || lower.contains("liter") =>
        {
            Some("1 L = 1000 mL")
        }
        "calcium_uM" | "Ca_uM" if lower.ends_with("_nm") || lower.contains("nmol") => {
            Some("1000 nM = 1 µM")
        }
        "calcium_uM" | "Ca_uM" if lower.contains("mmol") || found.ends_with("_mM") => {
            Some("1 mM = 1000 µM")
        }
        "flow_mL_per_s" if lower.contains("l_per_min") || lower.contains("l/min") => {
            Some("1 L/min = 16.6667 mL/s")
        }
        "flow_mL_per_s" if lower.contains("l_per_s") || lower.contains("l/s") => {
            Some("1 L/s = 1000 mL/s")
        }
        "volume_mL" if lower.contains("mm3") || lower.contains("ul") => Some("1000 mm3 = 1 mL"),
        _ => None,
    };
    match factor {
        Some(factor) => {
            format!("convert the numbers ({factor}) and rename the column to `{wanted}`")
        }
        None => format!(
            "rename it to `{wanted}` if its numbers have that unit, convert them if not: units are never guessed"
        ),
    }
}

/// Usual interval of increasing times: their median difference, ms.
pub(crate) fn median_step_ms(time_ms: impl Iterator<Item = f64>) -> f64 {
    let times: Vec<f64> = time_ms.collect();
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
#[path = "read_tests.rs"]
mod tests;
