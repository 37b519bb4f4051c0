//! European Data Format: EDF and EDF+ with 16 bits a sample, and BDF of BioSemi with 24.
//!
//! A header of text with fixed widths (Kemp et al. 1992, Electroencephalogr Clin Neurophysiol
//! 82:391; Kemp and Olivan 2003, Clin Neurophysiol 114:1755) is followed by records of equal
//! duration. Each record holds the samples of one signal after the other. In EDF+ each record has the
//! time of its begin in its first annotation, which counts whatever the header says: an interrupted
//! recording has gaps.

use std::path::Path;

use cardiotwin_signals::Problem;

use crate::delimited::refused;
use crate::grid::Grid;
use crate::headers::{Label, NoMatch, find};
use crate::wanted::{TableReading, Wanted, times_of_the_file};

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
    /// Value of a sample: factor and offset; what is wrong with the stated ranges otherwise.
    scale: Result<(f64, f64), String>,
    samples: usize,
    annotation: bool,
}

/// Reads a file. Signals with fewer samples a second than the fastest wanted one are interpolated.
#[must_use]
pub fn parse(bytes: &[u8], file: &Path, wanted: &[Wanted]) -> TableReading {
    match grid(bytes, file, wanted) {
        Ok((grid, warnings)) => {
            let mut reading = grid.choose(file, &times_of_the_file(wanted));
            reading.problems.splice(0..0, warnings);
            reading
        }
        Err(problem) => refused(problem),
    }
}

/// The time of a record \[s\], from the first annotation of its signals of annotations: a sign, the
/// seconds, an optional duration after the byte 21, and the byte 20.
fn begin_s(annotations: &[u8]) -> Option<f64> {
    let end = annotations.iter().position(|b| *b == 20)?;
    let text = std::str::from_utf8(&annotations[..end]).ok()?;
    let onset = text.split('\u{15}').next()?;
    if !onset.starts_with(['+', '-']) {
        return None;
    }
    onset.parse::<f64>().ok().filter(|s| s.is_finite())
}

/// Times of all records \[s\], of which one without a time follows the one before it or precedes the one
/// after it; `None` where no record has one.
fn begins_of(told: &[Option<f64>], duration_s: f64) -> Option<Vec<f64>> {
    let first = told.iter().position(Option::is_some)?;
    let mut next = told[first]? - duration_s * first as f64;
    let begins = told.iter().map(|begin| {
        let begin = begin.unwrap_or(next);
        next = begin + duration_s;
        begin
    });
    Some(begins.collect())
}

fn grid(bytes: &[u8], file: &Path, wanted: &[Wanted]) -> Result<(Grid, Vec<Problem>), Problem> {
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
        // Fields are filled with spaces; some programs end them with a NUL and leave what was there.
        part.iter()
            .take_while(|b| **b != 0)
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
        let samples = integer(at(216, 8, i), 8, "the number of samples in a record")?;
        let annotation = name.ends_with("Annotations") || name == "Status";
        if !(1..=10_000_000).contains(&samples) {
            return Err(damaged(
                format!("signal `{name}` with {samples} samples a record"),
                "at least one sample",
            ));
        }
        // A signal that is not read may lack its ranges.
        let ranges = || -> Result<(f64, f64), String> {
            let number = |offset: usize, what: &str| {
                let place = at(offset, 8, i);
                real(place, 8, what).map_err(|problem| problem.found)
            };
            let physical = (
                number(104, "a physical minimum")?,
                number(112, "a physical maximum")?,
            );
            let digital = (
                number(120, "a digital minimum")?,
                number(128, "a digital maximum")?,
            );
            if digital.1 <= digital.0 {
                return Err(format!("digital values {} to {}", digital.0, digital.1));
            }
            if physical.0 == physical.1 {
                return Err(format!("physical values {} to {}", physical.0, physical.1));
            }
            let factor = (physical.1 - physical.0) / (digital.1 - digital.0);
            Ok((factor, physical.0 - factor * digital.0))
        };
        let scale = ranges();
        signals.push(Signal {
            label: Label::with_unit(&name, Some(&unit)),
            scale,
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
    let mut warnings = Vec::new();
    let records = if n_records < 0 {
        there
    } else {
        n_records as usize
    };
    if there == 0 {
        return Err(damaged(
            format!("no whole record in {} bytes", bytes.len()),
            &format!("{records} records, as the header states"),
        ));
    }
    if records > there {
        warnings.push(Problem::warning(
            file,
            format!("{there} whole records, but the header states {records}: the file is cut"),
            "the whole file",
            "copy or export the file again; what is there is read",
        ));
    } else if records < there {
        warnings.push(Problem::warning(
            file,
            format!("{there} records, but the header states {records}"),
            "as many records as the header states",
            "export the recording again if this is not all of it; all records are read",
        ));
    }
    // All whole records are read, whatever the header counts.
    let records = there;
    let record_begin = |record: usize| -> Option<f64> {
        let mut offset = record * record_bytes;
        for signal in &signals {
            let n = width * signal.samples;
            if signal.annotation {
                return begin_s(data.get(offset..offset + n)?);
            }
            offset += n;
        }
        None
    };
    // Times that records state count, whether or not the header says that there are any.
    let told: Vec<Option<f64>> = (0..records).map(record_begin).collect();
    let without: Vec<usize> = (0..records).filter(|r| told[*r].is_none()).collect();
    let begins = begins_of(&told, duration_s);
    if begins.is_some() && !without.is_empty() {
        let named: Vec<String> = (without.iter().take(5))
            .map(|record| (record + 1).to_string())
            .collect();
        warnings.push(Problem::warning(
            file,
            format!(
                "{} of {records} records without a time: number {}{}",
                without.len(),
                named.join(", "),
                if without.len() > named.len() {
                    ", …"
                } else {
                    ""
                }
            ),
            "the time of each record in its annotations",
            "check the export; a record without a time is taken to follow the one before it",
        ));
    }
    let upper = kind.to_ascii_uppercase();
    let interrupted = upper.starts_with("EDF+D") || upper.starts_with("BDF+D");
    if interrupted && begins.is_none() {
        return Err(Problem::error(
            file,
            format!("a recording with interruptions ({kind}) without times of its records"),
            "the time of each record in its annotations",
            "export each part as a file of its own",
        ));
    }
    // Begin of each record, counted from the first record's begin [ms].
    let begin_ms: Vec<f64> = match &begins {
        Some(begins) => begins.iter().map(|s| 1e3 * (s - begins[0])).collect(),
        None => (0..records).map(|r| 1e3 * duration_s * r as f64).collect(),
    };
    let gaps: Vec<f64> = begin_ms
        .windows(2)
        .map(|w| w[1] - w[0] - 1e3 * duration_s)
        .collect();
    if let Some(early) = gaps.iter().position(|gap| *gap < -1.0) {
        return Err(damaged(
            format!(
                "record {} begins {:.3} s after record {}, but a record lasts {duration_s} s",
                early + 2,
                1e-3 * (begin_ms[early + 1] - begin_ms[early]),
                early + 1
            ),
            "records that follow each other",
        ));
    }
    let n_gaps = gaps.iter().filter(|gap| **gap > 1.0).count();
    if n_gaps > 0 {
        let total: f64 = gaps.iter().filter(|gap| **gap > 1.0).sum();
        let gaps = if n_gaps == 1 { "gap" } else { "gaps" };
        let told = format!(
            "{n_gaps} {gaps} of {:.1} s in all between records, as their annotations say",
            1e-3 * total
        );
        if interrupted {
            said.push(told);
        } else {
            warnings.push(Problem::warning(
                file,
                format!(
                    "{told}, although the header calls it continuous ({})",
                    if kind.is_empty() { "EDF" } else { &kind }
                ),
                "records without gaps in a continuous file",
                "check the export; the records' own times count",
            ));
        }
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
    for i in &chosen {
        if let Err(found) = &signals[*i].scale {
            return Err(damaged(
                format!("signal `{}` with {found}", signals[*i].label.full),
                "the physical and digital range of a signal that is read",
            ));
        }
    }
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
        let (factor, offset) = *s.scale.as_ref().unwrap_or(&(f64::NAN, 0.0));
        factor * digital + offset
    };
    let mut grid = Grid {
        labels: vec![Label::new("time_ms")],
        columns: vec![
            (0..total)
                .map(|k| begin_ms[k / rate] + (k % rate) as f64 * step_ms)
                .collect(),
        ],
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
                    let after = (before + 1).min(last);
                    let (a, b) = (sample(i, before), sample(i, after));
                    // Behind a gap there is nothing to interpolate to.
                    let (record, next) = (before / s.samples, after / s.samples);
                    if next > record && gaps[record] > 1.0 {
                        return a;
                    }
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
            "signals {}: `{}`",
            crate::UNREAD,
            others.join("`, `")
        ));
    }
    if grid.labels.len() == 1 {
        let names: Vec<String> = signals
            .iter()
            .filter(|s| !s.annotation)
            .map(|s| s.label.full.clone())
            .collect();
        return Err(Problem::error(
            file,
            format!(
                "the signals `{}`, none of which has a known name",
                names.join("`, `")
            ),
            "a signal with a name such as LVP, AoP or ECG",
            "say which signal is which in [catheter.columns] of prepare.toml",
        ));
    }
    grid.said = said;
    Ok((grid, warnings))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_without_a_time_follows_its_neighbours() {
        let of = |told: &[Option<f64>]| begins_of(told, 2.0);
        assert_eq!(of(&[None, None]), None);
        assert_eq!(
            of(&[Some(1.0), None, Some(9.0), None]),
            Some(vec![1.0, 3.0, 9.0, 11.0])
        );
        assert_eq!(of(&[None, None, Some(9.0)]), Some(vec![5.0, 7.0, 9.0]));
    }

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
            (sound[..sound.len() - 50].to_vec(), "no whole record in"),
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
        let told = read(&other).problems[0].to_string();
        assert!(told.contains("the signals `Resp (L)`"), "{told}");
    }

    #[test]
    fn a_cut_file_and_a_wrong_count_are_read_with_a_warning() {
        let sound = made(&[("LVP", "mmHg", 10)], 3, |_, k| k as i16);
        let cut = read(&sound[..sound.len() - 5]);
        assert_eq!(cut.table.unwrap().columns["time"].len(), 20);
        let told = cut.problems[0].to_string();
        assert!(
            told.starts_with("warning") && told.contains("2 whole records"),
            "{told}"
        );
        let few = [&sound[..236], b"1       ", &sound[244..]].concat();
        let reading = read(&few);
        assert_eq!(reading.table.unwrap().columns["time"].len(), 30);
        let told = reading.problems[0].to_string();
        assert!(
            told.contains("3 records, but the header states 1"),
            "{told}"
        );
    }

    #[test]
    fn a_signal_without_a_range_matters_only_if_it_is_read() {
        let sound = made(&[("LVP", "mmHg", 10), ("Resp", "L", 10)], 3, |_, k| {
            k as i16
        });
        // Physical minima stand after labels, transducers and units of both signals.
        let minimum = |i: usize| HEADER + 104 * 2 + 8 * i;
        let mut unused = sound.clone();
        unused[minimum(1)..minimum(1) + 8].copy_from_slice(b"        ");
        let reading = read(&unused);
        assert_eq!(reading.table, read(&sound).table);
        let mut used = sound;
        used[minimum(0)..minimum(0) + 8].copy_from_slice(b"        ");
        let told = read(&used).problems[0].to_string();
        assert!(
            told.contains("signal `LVP (mmHg)` with `` as a physical minimum"),
            "{told}"
        );
    }

    #[test]
    fn records_begin_when_their_annotations_say_so() {
        for kind in ["EDF+C", "EDF+D"] {
            let mut bytes = made(
                &[("LVP", "mmHg", 10), ("EDF Annotations", "", 8)],
                3,
                |_, k| k as i16,
            );
            bytes[192..197].copy_from_slice(kind.as_bytes());
            let begin = HEADER * 3;
            for (record, onset) in ["+0\x14\x14", "+1\x14\x14", "+7.5\x14\x14"]
                .iter()
                .enumerate()
            {
                let at = begin + record * 36 + 20;
                bytes[at..at + 16].fill(0);
                bytes[at..at + onset.len()].copy_from_slice(onset.as_bytes());
            }
            let reading = read(&bytes);
            let table = reading
                .table
                .unwrap_or_else(|| panic!("{:#?}", reading.problems));
            let time = &table.columns["time"];
            assert_eq!((time[19], time[20], time[21]), (1900.0, 7500.0, 7600.0));
            let warned = reading
                .problems
                .iter()
                .any(|p| p.to_string().contains("1 gap of 5.5 s"));
            assert_eq!(warned, kind == "EDF+C");
        }
    }
}
