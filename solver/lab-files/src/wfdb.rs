//! Records of PhysioNet's WFDB: a header (.hea) and signal files.
//!
//! The header's record line gives the name, the number of signals, the frequency and the number of
//! samples; a line for each signal gives its file, format, gain, baseline and unit, resolution,
//! zero, first value, checksum, block size and description (WFDB Applications Guide, header(5)).
//! The formats 8, 16, 24, 32, 61, 80, 160, 212, 310 and 311 come from signal(5).

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::delimited::refused;
use crate::grid::Grid;
use crate::headers::Label;
use crate::samples::{Format, decode};
use crate::wanted::{TableReading, Wanted, times_of_the_file};

/// Reader of a file next to the header, by its name there. Errors come in words.
pub type Beside<'a> = dyn FnMut(&str) -> Result<Vec<u8>, String> + 'a;

/// Samples a second where the header states none (header(5)).
const USUAL_HZ: f64 = 250.0;
/// Units per millivolt where the header states none (header(5)).
const USUAL_GAIN: f64 = 200.0;

#[derive(Debug)]
struct Signal {
    line: usize,
    file: String,
    format: Format,
    samples_per_frame: usize,
    skew: usize,
    offset: usize,
    gain: f64,
    baseline: f64,
    label: Label,
    first: i32,
    /// First sample that the header states.
    stated_first: Option<i32>,
    /// Sum of all samples that the header states, in 16 bits.
    checksum: Option<i32>,
}

/// Whether a text is the header of a WFDB record.
#[must_use]
pub fn is_header(text: &str, file: &Path) -> bool {
    let named = file
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("hea"));
    named
        || (record_line(text).is_some_and(|(_, line)| record(line).is_ok())
            && text.contains(".dat "))
}

fn record_line(text: &str) -> Option<(usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .find(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Number of signals, frames a second and, if stated, frames.
fn record(line: &str) -> Result<(usize, f64, Option<usize>), String> {
    let fields: Vec<&str> = line.split_whitespace().collect();
    let name = fields.first().copied().unwrap_or_default();
    if name.contains('/') {
        return Err("a record of several segments".to_owned());
    }
    let n = fields
        .get(1)
        .and_then(|field| field.parse::<usize>().ok())
        .filter(|n| (1..=4096).contains(n))
        .ok_or_else(|| format!("`{line}`"))?;
    let frequency = match fields.get(2) {
        None => USUAL_HZ,
        Some(field) => field
            .split(['/', '('])
            .next()
            .and_then(|text| text.parse::<f64>().ok())
            .filter(|hz| hz.is_finite() && *hz > 0.0)
            .ok_or_else(|| format!("the frequency `{field}`"))?,
    };
    let frames = fields
        .get(3)
        .and_then(|field| field.parse::<usize>().ok())
        .filter(|n| *n > 0);
    Ok((n, frequency, frames))
}

/// Reads a record.
#[must_use]
pub fn parse(text: &str, file: &Path, wanted: &[Wanted], beside: &mut Beside<'_>) -> TableReading {
    match grid(text, file, beside) {
        Ok((grid, warnings)) => {
            let mut reading = grid.choose(file, &times_of_the_file(wanted));
            reading.problems.splice(0..0, warnings);
            reading
        }
        Err(problem) => refused(problem),
    }
}

fn grid(text: &str, file: &Path, beside: &mut Beside<'_>) -> Result<(Grid, Vec<Problem>), Problem> {
    let wrong = |line: usize, found: String, expected: &str| {
        Problem::error(
            file,
            found,
            expected,
            "correct the header, or export the record again",
        )
        .at_line(line)
    };
    let Some((line_of_record, line)) = record_line(text) else {
        return Err(Problem::error(
            file,
            "an empty header",
            "a record line",
            "export the record again",
        ));
    };
    let (n, frequency, frames) = record(line).map_err(|found| {
        wrong(
            line_of_record,
            found,
            "a record line of one segment: name, number of signals, samples a second",
        )
    })?;
    let lines = text
        .lines()
        .enumerate()
        .skip(line_of_record)
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let mut signals = Vec::with_capacity(n);
    for (number, line) in lines.take(n) {
        signals.push(signal(number, line).map_err(|found| {
            wrong(
                number,
                found,
                "a signal's file, format (8, 16, 24, 32, 61, 80, 160, 212, 310 or 311), gain(baseline)/unit and description",
            )
        })?);
    }
    if signals.len() < n {
        return Err(wrong(
            line_of_record,
            format!("{} lines of signals", signals.len()),
            &format!("{n}, as the record line states"),
        ));
    }
    let mut grid = Grid {
        header_line: Some(line_of_record),
        said: vec![format!(
            "WFDB record of {n} signals, {frequency} frames a second"
        )],
        ..Grid::default()
    };
    let per_frame = signals
        .iter()
        .map(|s| s.samples_per_frame)
        .max()
        .unwrap_or(1);
    let mut warnings = Vec::new();
    let mut begin = 0;
    let mut most = 0;
    while begin < n {
        let end = (begin..n)
            .find(|i| signals[*i].file != signals[begin].file)
            .unwrap_or(n);
        let group = &signals[begin..end];
        let first = &group[0];
        if let Some(other) = group.iter().find(|s| s.format != first.format) {
            return Err(wrong(
                other.line,
                format!(
                    "format {} in a file of format {}",
                    other.format.number(),
                    first.format.number()
                ),
                "one format for each file",
            ));
        }
        let bytes = beside(&first.file).map_err(|error| {
            wrong(
                first.line,
                format!("signal file `{}` ({error})", first.file),
                "the signal file beside the header",
            )
        })?;
        let each: Vec<usize> = group.iter().map(|s| s.samples_per_frame).collect();
        let firsts: Vec<i32> = group
            .iter()
            .flat_map(|s| std::iter::repeat_n(s.first, s.samples_per_frame))
            .collect();
        let data = bytes.get(first.offset..).unwrap_or_default();
        let flat = decode(data, first.format, &firsts);
        let width: usize = each.iter().sum();
        let there = flat.len() / width;
        let n_frames = frames.unwrap_or(there);
        if n_frames > there {
            return Err(wrong(
                first.line,
                format!("{there} frames in `{}`", first.file),
                &format!("{n_frames}, as the record line states"),
            ));
        }
        // Packed formats fill up their last bytes.
        if there > n_frames + 1 {
            let problem = Problem::warning(
                file,
                format!("{there} frames in `{}`", first.file),
                format!("{n_frames}, as the record line states"),
                "copy the record again if the rest belongs to it: it is not read",
            );
            warnings.push(problem.at_line(first.line));
        }
        let mut offset = 0;
        for (signal, count) in group.iter().zip(each) {
            let begin = flat.get(offset).copied().flatten();
            if let (Some(stated), Some(begin)) = (signal.stated_first, begin)
                && stated != begin
                && signal.format != Format::Differences
            {
                let problem = Problem::warning(
                    file,
                    format!(
                        "signal `{}` whose first sample is {begin}",
                        signal.label.full
                    ),
                    format!("{stated}, as the header states"),
                    "copy the record again: samples may be lost or in another order",
                );
                warnings.push(problem.at_line(signal.line));
            }
            let samples = (0..n_frames).flat_map(|frame| {
                let at = frame * width + offset;
                &flat[at..at + count]
            });
            let sum = samples.fold(0_i64, |sum, sample| {
                // A lost sample has the format's lowest value.
                sum + i64::from(sample.or(signal.format.lost()).unwrap_or(0))
            });
            if let Some(stated) = signal.checksum
                && (sum - i64::from(stated)).rem_euclid(1 << 16) != 0
            {
                let seen = (sum + (1 << 15)).rem_euclid(1 << 16) - (1 << 15);
                // Some programs write no checksum but a zero.
                let new = if stated == 0 {
                    Problem::warning
                } else {
                    Problem::error
                };
                let problem = new(
                    file,
                    format!(
                        "signal `{}` whose samples have the checksum {seen}",
                        signal.label.full
                    ),
                    format!("{stated}, as the header states"),
                    "copy the record again: samples were lost or changed; if they are right, set the checksum in the header",
                )
                .at_line(signal.line);
                if stated != 0 {
                    return Err(problem);
                }
                warnings.push(problem);
            }
            let value = |k: usize| -> f64 {
                // A skew of k samples means that the signal's samples come k frames late.
                let frame = k / count + signal.skew;
                flat.get(frame * width + offset + k % count)
                    .filter(|_| frame < there)
                    .and_then(|sample| *sample)
                    .map_or(f64::NAN, |sample| {
                        (f64::from(sample) - signal.baseline) / signal.gain
                    })
            };
            let total = n_frames * count;
            let values: Vec<f64> = if count == per_frame {
                (0..total).map(value).collect()
            } else {
                let ratio = count as f64 / per_frame as f64;
                (0..n_frames * per_frame)
                    .map(|k| {
                        let place = k as f64 * ratio;
                        let before = place as usize;
                        let (a, b) = (
                            value(before),
                            value((before + 1).min(total.saturating_sub(1))),
                        );
                        a + (place - before as f64) * (b - a)
                    })
                    .collect()
            };
            most = most.max(values.len());
            grid.labels.push(signal.label.clone());
            grid.columns.push(values);
            offset += count;
        }
        begin = end;
    }
    for column in &mut grid.columns {
        column.resize(most, f64::NAN);
    }
    let step_ms = 1e3 / (frequency * per_frame as f64);
    grid.labels.insert(0, Label::new("time_ms"));
    grid.columns
        .insert(0, (0..most).map(|k| k as f64 * step_ms).collect());
    Ok((grid, warnings))
}

fn signal(line_number: usize, line: &str) -> Result<Signal, String> {
    let mut fields = line.split_whitespace();
    let file = fields.next().unwrap_or_default().to_owned();
    let format_field = fields.next().ok_or_else(|| format!("`{line}`"))?;
    if file.contains(['/', '\\']) || file.starts_with("..") || file == "-" || file == "~" {
        return Err(format!("signal file `{file}`"));
    }
    let digits = |text: &str| -> usize {
        text.find(|c: char| !c.is_ascii_digit())
            .unwrap_or(text.len())
    };
    let end = digits(format_field);
    let format = format_field[..end]
        .parse::<u16>()
        .ok()
        .and_then(Format::of)
        .ok_or_else(|| format!("format `{format_field}`"))?;
    let (mut samples_per_frame, mut skew, mut offset) = (1, 0, 0);
    let mut rest = &format_field[end..];
    while let Some(mark) = rest.chars().next() {
        let text = &rest[mark.len_utf8()..];
        let end = digits(text);
        let value: usize = text[..end]
            .parse()
            .map_err(|_| format!("format `{format_field}`"))?;
        match mark {
            'x' if (1..=1000).contains(&value) => samples_per_frame = value,
            ':' => skew = value,
            '+' => offset = value,
            _ => return Err(format!("format `{format_field}`")),
        }
        rest = &text[end..];
    }
    let gain_field = fields.next().unwrap_or_default();
    let (numbers, unit) = gain_field.split_once('/').unwrap_or((gain_field, "mV"));
    let (gain, baseline) = match numbers.split_once('(') {
        Some((gain, baseline)) => (gain, Some(baseline.trim_end_matches(')'))),
        None => (numbers, None),
    };
    let real = |text: &str| -> Result<f64, String> {
        text.parse::<f64>()
            .ok()
            .filter(|value| value.is_finite())
            .ok_or_else(|| format!("gain `{gain_field}`"))
    };
    let gain = if gain.is_empty() { 0.0 } else { real(gain)? };
    let baseline = baseline.map(real).transpose()?;
    let mut integer = || fields.next().and_then(|field| field.parse::<i32>().ok());
    let (_resolution, zero, first, checksum, _block) =
        (integer(), integer(), integer(), integer(), integer());
    let description = fields.collect::<Vec<&str>>().join(" ");
    let zero = zero.unwrap_or(0);
    let uncalibrated = gain == 0.0;
    Ok(Signal {
        line: line_number,
        file,
        format,
        samples_per_frame,
        skew,
        offset,
        gain: if gain == 0.0 { USUAL_GAIN } else { gain },
        baseline: baseline.unwrap_or_else(|| f64::from(zero)),
        label: if uncalibrated && unit.trim() != "mV" {
            // Raw numbers have no unit, whatever the header calls it.
            Label::with_unit(&description, Some("gain 0: not calibrated"))
        } else {
            Label::with_unit(&description, Some(unit))
        },
        first: first.unwrap_or(zero),
        stated_first: first,
        checksum,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(header: &str, data: &[u8]) -> TableReading {
        let wanted = [
            Wanted::required("time"),
            Wanted::new("lv_pressure"),
            Wanted::new("ecg"),
        ];
        let mut beside = |name: &str| {
            if name == "r.dat" {
                Ok(data.to_vec())
            } else {
                Err("no such file".to_owned())
            }
        };
        parse(header, Path::new("raw/r.hea"), &wanted, &mut beside)
    }

    #[test]
    fn a_record_of_format_16_has_its_units() {
        let header = "# made\nr 2 500 3\nr.dat 16 10(-5)/mmHg 16 0 0 0 0 LVP\nr.dat 16 200/mV 16 0 0 0 0 ECG lead II\n";
        let samples: [i16; 6] = [95, 200, 995, -200, -32768, 0];
        let bytes: Vec<u8> = samples.iter().flat_map(|s| s.to_le_bytes()).collect();
        let table = read(header, &bytes).table.unwrap();
        assert_eq!(table.columns["time"], [0.0, 2.0, 4.0]);
        assert_eq!(table.columns["lv_pressure"][..2], [10.0, 100.0]);
        assert!(
            table.columns["lv_pressure"][2].is_nan(),
            "the lowest value marks a lost sample"
        );
        assert_eq!(table.columns["ecg"], [1.0, -1.0, 0.0]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let line = "r.dat 16 10/mmHg 16 0 0 0 0 LVP\n";
        for (header, parts) in [
            (format!("r 1 fast\n{line}"), ["r.hea:1", "`fast`"]),
            (
                format!("r/3 1 500\n{line}"),
                ["r.hea:1", "several segments"],
            ),
            (
                format!("r 2 500\n{line}"),
                ["r.hea:1", "1 lines of signals"],
            ),
            (
                format!("r 1 500 90\n{line}"),
                ["r.hea:2", "2 frames in `r.dat`"],
            ),
            (
                "r 1 500\nq.dat 16 10/mmHg 16 0 0 0 0 LVP\n".to_owned(),
                ["r.hea:2", "no such file"],
            ),
            (
                "r 1 500\nr.dat 99 10/mmHg\n".to_owned(),
                ["r.hea:2", "format `99`"],
            ),
            (
                "r 1 500\n../r.dat 16 10/mmHg\n".to_owned(),
                ["r.hea:2", "`../r.dat`"],
            ),
            (
                "r 1 500\nr.dat 16 x/mmHg\n".to_owned(),
                ["r.hea:2", "gain `x/mmHg`"],
            ),
            (String::new(), ["r.hea", "an empty header"]),
        ] {
            let told = read(&header, &[1, 0, 2, 0]).problems[0].to_string();
            assert!(parts.iter().all(|part| told.contains(part)), "{told}");
        }
    }

    #[test]
    fn a_lost_sample_is_seen_by_the_checksum() {
        let bytes: Vec<u8> = [95_i16, 995, 3, -7]
            .iter()
            .flat_map(|s| s.to_le_bytes())
            .collect();
        let header = |sum: i32| format!("r 1 500\nr.dat 16 10/mmHg 16 0 95 {sum} 0 LVP\n");
        assert_eq!(read(&header(1086), &bytes).problems, []);
        // In 16 bits, with and without a sign.
        assert_eq!(read(&header(1086 + 65536), &bytes).problems, []);
        let told = read(&header(1086), &bytes[..6]).problems[0].to_string();
        assert!(
            told.contains("r.hea:2")
                && told.contains("`LVP (mmHg)`")
                && told.contains("1086, as the header states"),
            "{told}"
        );
        let warned = read(&header(0), &bytes);
        assert!(warned.table.is_some() && !warned.problems[0].is_error());
    }

    #[test]
    fn frames_in_another_order_and_too_many_are_told() {
        let header = "r 1 500 4\nr.dat 16 10/mmHg 16 0 95 1086 0 LVP\n";
        let bytes =
            |samples: &[i16]| -> Vec<u8> { samples.iter().flat_map(|s| s.to_le_bytes()).collect() };
        assert_eq!(read(header, &bytes(&[95, 995, 3, -7])).problems, []);
        let turned = read(header, &bytes(&[3, -7, 95, 995]));
        let told = turned.problems[0].to_string();
        assert!(
            turned.table.is_some()
                && told.contains("r.hea:2")
                && told.contains("first sample is 3; expected 95"),
            "{told}"
        );
        let more = read(header, &bytes(&[95, 995, 3, -7, 1, 2, 3]));
        let told = more.problems[0].to_string();
        assert!(told.contains("7 frames in `r.dat`; expected 4"), "{told}");
        assert_eq!(more.table.unwrap().columns["time"].len(), 4);
    }

    #[test]
    fn a_gain_of_zero_is_no_calibration() {
        let header = "r 2 500\nr.dat 16 0/mmHg 16 0 0 8 0 LVP\nr.dat 16 0/mV 16 0 0 4 0 ECG\n";
        let bytes: Vec<u8> = [5_i16, 1, 3, 3]
            .iter()
            .flat_map(|s| s.to_le_bytes())
            .collect();
        let told = read(header, &bytes).problems[0].to_string();
        assert!(told.contains("`LVP (gain 0: not calibrated)`"), "{told}");
        // Of an electrocardiogram 200 units for a millivolt are usual (header(5)).
        let only = header.replace("LVP", "Resp").replace("0/mmHg", "10/L");
        let table = read(&only, &bytes).table.unwrap();
        assert_eq!(table.columns["ecg"], [0.005, 0.015]);
    }
}
