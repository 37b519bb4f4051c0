//! Text that AcqKnowledge (BIOPAC) exports.
//!
//! First come the file's name, the interval (`4 msec/sample`) or the rate (`250 samples/sec`) and the
//! number of channels (`3 channels`), then two lines for each channel: its name and its unit. A header follows (`msec CH1
//! CH2 …`, or without times), a row with each channel's number of samples, and rows of numbers.
//! Cells are separated by tabs or commas.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::clock::other_interval;
use crate::delimited::refused;
use crate::dialect::cells;
use crate::grid::Grid;
use crate::headers::{KNOWN, Label};
use crate::number::{Decimal, is_missing, number};
use crate::text::Decoded;
use crate::told::{Told, shown};
use crate::wanted::{TableReading, Wanted, times_of_the_file};

/// Most lines before the interval: the file's name, and empty ones.
const PROBE: usize = 4;

/// Whether a text has the header of AcqKnowledge.
#[must_use]
pub fn is_acqknowledge(text: &str) -> bool {
    begin(&text.lines().take(PROBE + 2).collect::<Vec<&str>>()).is_some()
}

/// Index of the line with the interval, the interval in ms, and the number of channels.
fn begin(lines: &[&str]) -> Option<(usize, f64, usize)> {
    (0..lines.len().min(PROBE)).find_map(|i| {
        let (value, unit) = lines[i].trim().split_once(' ')?;
        let value = number(value.as_bytes(), Decimal::Point)
            .or_else(|| number(value.as_bytes(), Decimal::Comma))?;
        let unit = unit.trim();
        let interval_ms = match unit.strip_suffix("/sample") {
            Some(time) => value * KNOWN[0].dimension.factor(time)?,
            None => 1e3 / (value * per_second(unit)?),
        };
        let n = lines.get(i + 1)?.trim().strip_suffix("channels");
        let n = n.or_else(|| lines[i + 1].trim().strip_suffix("channel"))?;
        let n: usize = n.trim().parse().ok()?;
        (value > 0.0 && (1..=4096).contains(&n)).then_some((i, interval_ms, n))
    })
}

/// Factor of a rate to samples per second.
fn per_second(unit: &str) -> Option<f64> {
    const RATES: [(&str, f64); 7] = [
        ("hz", 1.0),
        ("khz", 1e3),
        ("samples/sec", 1.0),
        ("samples/second", 1.0),
        ("samples/s", 1.0),
        ("ksamples/sec", 1e3),
        ("samples/min", 1.0 / 60.0),
    ];
    let unit = unit.to_lowercase();
    let found = RATES.iter().find(|(name, _)| *name == unit)?;
    Some(found.1)
}

/// Reads an export.
#[must_use]
pub fn parse(decoded: &Decoded<'_>, file: &Path, wanted: &[Wanted]) -> TableReading {
    match grid(decoded, file) {
        Ok((grid, told, interval_ms)) => {
            let problems = told.problems();
            if problems.iter().any(Problem::is_error) {
                return TableReading {
                    table: None,
                    problems,
                };
            }
            let contradiction = other_interval(file, Some(interval_ms), &grid.columns[0]);
            let mut reading = grid.choose(file, &times_of_the_file(wanted));
            reading.problems.extend(contradiction);
            reading
        }
        Err(problem) => refused(problem),
    }
}

/// The table, problems of its lines, and the interval that the header states \[ms\].
fn grid(decoded: &Decoded<'_>, file: &Path) -> Result<(Grid, Told, f64), Problem> {
    let lines: Vec<&str> = decoded.text.lines().collect();
    let damaged = |line: usize, found: String, expected: &str| {
        Problem::error(
            file,
            found,
            expected,
            "save the recording as text in AcqKnowledge again, with its header",
        )
        .at_line(line)
    };
    let Some((at, interval_ms, n)) = begin(&lines) else {
        return Err(damaged(
            1,
            format!(
                "`{}`",
                shown(lines.first().copied().unwrap_or_default().as_bytes())
            ),
            "the header of AcqKnowledge: name, interval (`4 msec/sample`), number of channels",
        ));
    };
    let header = at + 2 + 2 * n;
    if lines.len() < header + 2 {
        return Err(damaged(
            lines.len(),
            format!("{} lines", lines.len()),
            "a name and a unit for each channel, and rows of numbers",
        ));
    }
    let named = &lines[at + 2..header];
    let mut first = header;
    let separator = [b'\t', b',', b';']
        .into_iter()
        .find(|separator| cells(lines[header + 1], *separator).len() >= n.max(2))
        .unwrap_or(b'\t');
    let decimal = if separator != b',' && lines[header..].iter().take(200).any(|l| l.contains(','))
    {
        Decimal::Comma
    } else {
        Decimal::Point
    };
    let cells_of = |line: &'_ str| -> Vec<String> {
        cells(line, separator)
            .into_iter()
            .map(|cell| cell.trim().to_owned())
            .collect()
    };
    let names = cells_of(lines[header]);
    let is_number = |cell: &String| number(cell.as_bytes(), decimal).is_some();
    let mut time_factor = None;
    if !names.iter().any(is_number) {
        time_factor = names
            .first()
            .and_then(|name| KNOWN[0].dimension.factor(name));
        first += 1;
        // The row below has each channel's number of samples.
        let counts = cells_of(lines[first]);
        let is_count = |cell: &String| cell.is_empty() || cell.parse::<usize>().is_ok();
        let no_time = time_factor.is_some() && counts.first().is_some_and(String::is_empty);
        let repeated = counts.iter().filter(|cell| !cell.is_empty()).count() == n
            && counts
                .iter()
                .filter_map(|cell| cell.parse::<usize>().ok())
                .min()
                >= Some(lines.len() - first - 1);
        if counts.iter().all(is_count) && (no_time || repeated) {
            first += 1;
        }
    }
    let skip = usize::from(time_factor.is_some());
    let mut told = Told::default();
    let (mut times, mut columns) = (Vec::new(), vec![Vec::new(); n]);
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (i, line) in lines.iter().enumerate().skip(first) {
        if line.trim().is_empty() {
            continue;
        }
        let mut row = cells_of(line);
        if row.len() == n + skip + 1 && row[n + skip].is_empty() {
            row.pop();
        }
        if row.len() != n + skip {
            let problem = damaged(
                i + 1,
                format!("{} fields in `{}`", row.len(), shown(line.as_bytes())),
                &format!("{} for {n} channels", n + skip),
            );
            told.tell("fields", problem);
            continue;
        }
        let expected = runs.last().map(|(row, line)| line + times.len() - row);
        if expected != Some(i + 1) {
            runs.push((times.len(), i + 1));
        }
        let mut value = |cell: &str, key: &str| {
            let value = number(cell.as_bytes(), decimal);
            if value.is_none() && !is_missing(cell.as_bytes()) {
                let found = format!("`{}`", shown(cell.as_bytes()));
                told.tell("number", damaged(i + 1, found, "a number").at_key(key));
            }
            value.unwrap_or(f64::NAN)
        };
        times.push(match time_factor {
            Some(factor) => factor * value(&row[0], "time"),
            None => times.len() as f64 * interval_ms,
        });
        for (k, column) in columns.iter_mut().enumerate() {
            column.push(value(&row[k + skip], named[2 * k].trim()));
        }
    }
    let label = |k: usize| Label::with_unit(named[2 * k], Some(named[2 * k + 1]));
    let grid = Grid {
        labels: std::iter::once(Label::new("time_ms"))
            .chain((0..n).map(label))
            .collect(),
        columns: std::iter::once(times).chain(columns).collect(),
        header_line: Some(header + 1),
        lines: runs,
        said: vec![format!(
            "text of AcqKnowledge, {}, {n} channels every {interval_ms} ms",
            decoded.encoding
        )],
    };
    Ok((grid, told, interval_ms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::decode;

    const HEADER: &str = "run.acq\n4 msec/sample\n2 channels\nLVP\nmmHg\nECG\nmV\n";

    fn read(text: &str) -> TableReading {
        let wanted = [
            Wanted::required("time"),
            Wanted::new("lv_pressure"),
            Wanted::new("ecg"),
        ];
        parse(
            &decode(text.as_bytes()).unwrap(),
            Path::new("c.txt"),
            &wanted,
        )
    }

    #[test]
    fn names_units_and_times_are_those_of_the_header() {
        for (header, separator) in [
            ("msec\tCH1\tCH2\n\t3\t3\n", "\t"),
            ("sec,CH1,CH2\n,3,3,\n", ","),
            ("CH1\tCH2\n3\t3\n", "\t"),
            ("msec\tCH1\tCH2\n", "\t"),
        ] {
            let rows = ["98.1", "98.3", "98.5"].iter().enumerate().map(|(i, p)| {
                let time = match header.split(['\t', ',']).next() {
                    Some("msec") => format!("{}{separator}", 4 * i),
                    Some("sec") => format!("{}{separator}", 0.004 * i as f64),
                    _ => String::new(),
                };
                format!("{time}{p}{separator}0.1\n")
            });
            let text = format!("{HEADER}{header}{}", rows.collect::<String>());
            assert!(is_acqknowledge(&text), "{text}");
            let reading = read(&text);
            assert_eq!(reading.problems, [], "{text}");
            let table = reading.table.unwrap();
            assert_eq!(table.columns["lv_pressure"], [98.1, 98.3, 98.5], "{text}");
            assert!(
                table.columns["time"]
                    .iter()
                    .zip([0.0, 4.0, 8.0])
                    .all(|(a, b)| (a - b).abs() < 1e-9)
            );
        }
    }

    #[test]
    fn damage_is_told_with_its_line() {
        for (text, parts) in [
            (
                format!("{HEADER}msec\tCH1\tCH2\n\t2\t2\n0\t1\t1\n4\tx\t1\n"),
                ["c.txt:11: LVP", "`x`"],
            ),
            (
                format!("{HEADER}msec\tCH1\tCH2\n\t2\t2\n0\t1\t1\n4\t1\n"),
                ["c.txt:11", "2 fields"],
            ),
            (HEADER.to_owned(), ["c.txt:7", "7 lines"]),
        ] {
            let told: Vec<String> = read(&text)
                .problems
                .iter()
                .map(ToString::to_string)
                .collect();
            let told = told.join("\n");
            assert!(parts.iter().all(|part| told.contains(part)), "{told}");
        }
        assert!(!is_acqknowledge("time_ms,lv_pressure_mmHg\n0,7\n"));
    }
}
