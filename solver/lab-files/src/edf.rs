//! European Data Format: EDF and EDF+ with 16 bits a sample, and BDF of BioSemi with 24.
//!
//! A header of text with fixed widths (Kemp et al. 1992, Electroencephalogr Clin Neurophysiol
//! 82:391; Kemp and Olivan 2003, Clin Neurophysiol 114:1755) is followed by records of equal
//! duration. Each record holds the samples of one signal after the other.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::delimited::refused;
use crate::grid::Grid;
use crate::headers::{Label, NoMatch, find};
use crate::wanted::{TableReading, Wanted};

/// Bytes of the header for the whole file, and of that for each signal.
const HEADER: usize = 256;
/// Most samples of all signals.
const MOST: usize = 400_000_000;

/// Whether bytes begin as EDF or BDF.
#[must_use]
pub fn is_edf(bytes: &[u8]) -> bool {
    bytes.starts_with(b"0       ") || bytes.starts_with(b"\xffBIOSEMI")
}

struct Signal {
    label: Label,
    /// Value of a sample: factor and offset.
    scale: (f64, f64),
    samples: usize,
    annotation: bool,
}

/// Reads a file. Signals with fewer samples a second than the fastest wanted one are interpolated.
#[must_use]
pub fn parse(bytes: &[u8], file: &Path, wanted: &[Wanted]) -> TableReading {
    match grid(bytes, file, wanted) {
        Ok(grid) => {
            let wanted: Vec<Wanted> = wanted
                .iter()
                .map(|one| match one.quantity {
                    "time" => Wanted {
                        names: vec![("time_ms".to_owned(), 1.0)],
                        given: false,
                        ..one.clone()
                    },
                    _ => one.clone(),
                })
                .collect();
            grid.choose(file, &wanted)
        }
        Err(problem) => refused(problem),
    }
}

fn grid(bytes: &[u8], file: &Path, wanted: &[Wanted]) -> Result<Grid, Problem> {
    let damaged = |found: String, expected: &str| {
        Problem::error(
            file,
            found,
            expected,
            "export the recording again; the header of the file is damaged",
        )
    };
    let field = |from: usize, n: usize| -> String {
        let part = bytes.get(from..from + n).unwrap_or_default();
        part.iter()
            .map(|b| char::from(*b))
            .collect::<String>()
            .trim()
            .to_owned()
    };
    let integer = |from: usize, n: usize, what: &str| -> Result<i64, Problem> {
        let text = field(from, n);
        text.parse::<i64>().map_err(|_| {
            damaged(
                format!("`{text}` as {what} at byte {from}"),
                "a whole number",
            )
        })
    };
    let real = |from: usize, n: usize, what: &str| -> Result<f64, Problem> {
        let text = field(from, n);
        let value = text
            .replace(',', ".")
            .parse::<f64>()
            .ok()
            .filter(|v| v.is_finite());
        value.ok_or_else(|| damaged(format!("`{text}` as {what} at byte {from}"), "a number"))
    };
    let biosemi = bytes.first() == Some(&0xff);
    let width = if biosemi { 3 } else { 2 };
    let header_bytes = integer(184, 8, "the length of the header")?;
    let n_records = integer(236, 8, "the number of records")?;
    let duration_s = real(244, 8, "the duration of a record")?;
    let n_signals = integer(252, 4, "the number of signals")?;
    let kind = field(192, 44);
    if !(1..=4096).contains(&n_signals) || header_bytes != 256 * (n_signals + 1) {
        return Err(damaged(
            format!("{n_signals} signals and a header of {header_bytes} bytes"),
            "256 bytes, and 256 more for each signal",
        ));
    }
    if duration_s <= 0.0 {
        return Err(damaged(
            format!("records of {duration_s} s"),
            "a positive duration",
        ));
    }
    let n = n_signals as usize;
    let at = |offset: usize, width: usize, i: usize| HEADER + offset * n + width * i;
    let mut signals = Vec::with_capacity(n);
    for i in 0..n {
        let name = field(at(0, 16, i), 16);
        let unit = field(at(96, 8, i), 8);
        let physical = (
            real(at(104, 8, i), 8, "a physical minimum")?,
            real(at(112, 8, i), 8, "a physical maximum")?,
        );
        let digital = (
            real(at(120, 8, i), 8, "a digital minimum")?,
            real(at(128, 8, i), 8, "a digital maximum")?,
        );
        let samples = integer(at(216, 8, i), 8, "the number of samples in a record")?;
        let annotation = name.ends_with("Annotations") || name == "Status";
        if digital.1 <= digital.0 || !(1..=10_000_000).contains(&samples) {
            return Err(damaged(
                format!(
                    "signal `{name}` with digital values {} to {} and {samples} samples a record",
                    digital.0, digital.1
                ),
                "a rising range and at least one sample",
            ));
        }
        let factor = (physical.1 - physical.0) / (digital.1 - digital.0);
        signals.push(Signal {
            label: Label::with_unit(&name, Some(&unit)),
            scale: (factor, physical.0 - factor * digital.0),
            samples: samples as usize,
            annotation,
        });
    }
    let record_bytes = width * signals.iter().map(|s| s.samples).sum::<usize>();
    let data = bytes.get(header_bytes as usize..).unwrap_or_default();
    let there = data.len() / record_bytes;
    let mut said = vec![format!(
        "{}, {n} signals, records of {duration_s} s",
        if biosemi {
            "BDF"
        } else if kind.starts_with("EDF+") {
            "EDF+"
        } else {
            "EDF"
        }
    )];
    let records = if n_records < 0 {
        there
    } else {
        n_records as usize
    };
    if records > there {
        return Err(damaged(
            format!("{there} records in {} bytes", bytes.len()),
            &format!("{records} records, as the header states"),
        ));
    }
    if kind.starts_with("EDF+D") || kind.starts_with("BDF+D") {
        return Err(Problem::error(
            file,
            format!("a recording with interruptions ({kind})"),
            "one without (EDF+C)",
            "export each part as a file of its own",
        ));
    }
    let labels: Vec<Label> = signals.iter().map(|s| s.label.clone()).collect();
    // Only the wanted signals are converted, at the rate of the fastest one.
    let named = |label: &Label, one: &Wanted| {
        one.names
            .iter()
            .any(|(name, _)| *name == label.full || (one.given && *name == label.name))
    };
    let mut chosen: Vec<usize> = (0..n)
        .filter(|i| wanted.iter().any(|one| named(&labels[*i], one)))
        .collect();
    for one in wanted
        .iter()
        .filter(|one| one.quantity != "time" && !one.given)
    {
        match find(&labels, one) {
            Ok(found) => chosen.push(found.place),
            Err(NoMatch::NoUnit(place) | NoMatch::OtherUnit(place, _)) => chosen.push(place),
            Err(NoMatch::Several(places)) => chosen.extend(places),
            Err(NoMatch::None) => {}
        }
    }
    chosen.retain(|i| !signals[*i].annotation);
    chosen.sort_unstable();
    chosen.dedup();
    let rate = chosen
        .iter()
        .map(|i| signals[*i].samples)
        .max()
        .unwrap_or(1);
    let total = records.saturating_mul(rate);
    if total.saturating_mul(chosen.len().max(1)) > MOST {
        return Err(damaged(
            format!("{total} samples of each signal"),
            "a recording that fits the memory",
        ));
    }
    let step_ms = 1e3 * duration_s / rate as f64;
    let offsets: Vec<usize> = signals
        .iter()
        .scan(0, |sum, s| {
            let here = *sum;
            *sum += width * s.samples;
            Some(here)
        })
        .collect();
    let sample = |signal: usize, k: usize| -> f64 {
        let s = &signals[signal];
        let at = (k / s.samples) * record_bytes + offsets[signal] + width * (k % s.samples);
        let digital = match data[at..at + width] {
            [a, b] => f64::from(i16::from_le_bytes([a, b])),
            [a, b, c] => f64::from(i32::from_le_bytes([0, a, b, c]) >> 8),
            _ => f64::NAN,
        };
        s.scale.0 * digital + s.scale.1
    };
    let mut grid = Grid {
        labels: vec![Label::new("time_ms")],
        columns: vec![(0..total).map(|k| k as f64 * step_ms).collect()],
        ..Grid::default()
    };
    for i in chosen {
        let s = &signals[i];
        let last = records * s.samples - 1;
        let values = if s.samples == rate {
            (0..total).map(|k| sample(i, k)).collect()
        } else {
            let ratio = s.samples as f64 / rate as f64;
            said.push(format!(
                "signal `{}` at {:.0} Hz, interpolated to {:.0} Hz",
                s.label.full,
                s.samples as f64 / duration_s,
                rate as f64 / duration_s
            ));
            (0..total)
                .map(|k| {
                    let place = (k as f64 * ratio).min(last as f64);
                    let before = place as usize;
                    let (a, b) = (sample(i, before), sample(i, (before + 1).min(last)));
                    a + (place - before as f64) * (b - a)
                })
                .collect()
        };
        grid.labels.push(s.label.clone());
        grid.columns.push(values);
    }
    let others: Vec<&str> = signals
        .iter()
        .filter(|s| !s.annotation && !grid.labels.contains(&s.label))
        .map(|s| s.label.full.as_str())
        .collect();
    if !others.is_empty() {
        said.push(format!(
            "signals that are not read: `{}`",
            others.join("`, `")
        ));
    }
    if grid.labels.len() == 1 {
        // Every label is shown in the error that follows.
        grid.labels
            .extend(labels.into_iter().filter(|label| !label.full.is_empty()));
        grid.columns.resize(grid.labels.len(), Vec::new());
    }
    grid.said = said;
    Ok(grid)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file with the given signals: label, unit, samples of each record.
    fn made(
        signals: &[(&str, &str, usize)],
        records: usize,
        value: impl Fn(usize, usize) -> i16,
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let put = |bytes: &mut Vec<u8>, text: &str, n: usize| {
            bytes.extend(format!("{text:<n$}").bytes().take(n))
        };
        for (text, n) in [
            ("0", 8),
            ("X", 80),
            ("X", 80),
            ("01.01.26", 8),
            ("10.00.00", 8),
        ] {
            put(&mut bytes, text, n);
        }
        put(&mut bytes, &(256 * (signals.len() + 1)).to_string(), 8);
        put(&mut bytes, "", 44);
        put(&mut bytes, &records.to_string(), 8);
        put(&mut bytes, "1", 8);
        put(&mut bytes, &signals.len().to_string(), 4);
        signals.iter().for_each(|s| put(&mut bytes, s.0, 16));
        signals.iter().for_each(|_| put(&mut bytes, "", 80));
        signals.iter().for_each(|s| put(&mut bytes, s.1, 8));
        for text in ["-100", "300", "-32768", "32767"] {
            signals.iter().for_each(|_| put(&mut bytes, text, 8));
        }
        signals.iter().for_each(|_| put(&mut bytes, "", 80));
        signals
            .iter()
            .for_each(|s| put(&mut bytes, &s.2.to_string(), 8));
        signals.iter().for_each(|_| put(&mut bytes, "", 32));
        for record in 0..records {
            for (i, s) in signals.iter().enumerate() {
                (0..s.2).for_each(|k| bytes.extend(value(i, record * s.2 + k).to_le_bytes()));
            }
        }
        bytes
    }

    fn wanted() -> [Wanted; 3] {
        let time = Wanted::required("time");
        [time, Wanted::new("lv_pressure"), Wanted::new("ecg")]
    }

    fn read(bytes: &[u8]) -> TableReading {
        parse(bytes, Path::new("raw/catheter.edf"), &wanted())
    }

    #[test]
    fn signals_come_in_their_units_at_one_rate() {
        let bytes = made(
            &[("LVP", "mmHg", 10), ("ECG II", "mV", 5), ("Resp", "", 2)],
            3,
            |i, k| if i == 0 { k as i16 * 100 } else { 7 * k as i16 },
        );
        assert!(is_edf(&bytes));
        let table = read(&bytes).table.unwrap();
        assert_eq!(table.columns["time"].len(), 30);
        assert_eq!(table.columns["time"][1], 100.0);
        let physical = |digital: f64| -100.0 + (digital + 32768.0) * 400.0 / 65535.0;
        assert!((table.columns["lv_pressure"][13] - physical(1300.0)).abs() < 1e-9);
        assert!((table.columns["ecg"][3] - physical(7.0 * 1.5)).abs() < 1e-9);
        let said = table.said.join("\n");
        assert!(
            said.contains("`Resp`") && said.contains("interpolated to 10 Hz"),
            "{said}"
        );
    }

    #[test]
    fn a_damaged_file_is_refused_in_words() {
        let sound = made(&[("LVP", "mmHg", 10)], 3, |_, k| k as i16);
        for (bytes, part) in [
            (sound[..sound.len() - 30].to_vec(), "1 records in"),
            (sound[..100].to_vec(), "as the length of the header"),
            (
                [&sound[..236], b"x       ", &sound[244..]].concat(),
                "`x` as the number of records",
            ),
            (
                [&sound[..252], b"0   ", &sound[256..]].concat(),
                "0 signals",
            ),
        ] {
            let told = read(&bytes).problems[0].to_string();
            assert!(told.contains(part), "{told}");
        }
        let other = made(&[("Resp", "L", 10)], 3, |_, k| k as i16);
        assert!(
            !read(&other)
                .table
                .unwrap()
                .columns
                .contains_key("lv_pressure")
        );
    }
}
