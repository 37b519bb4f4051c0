//! Calcium transients as fixed input. The file has the columns `time_ms` (from activation on) and
//! `Ca_uM`; its trace is measured, or the median over an organ's nodes.

use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::Quantity;

use crate::error::TaskError;
use crate::inputs::read_trace;

/// Interval between samples \[ms\].
pub const INTERVAL_MS: f64 = 1.0;
/// Latest time of the first sample \[ms\]; later ones would miss the foot of the transient.
const LATEST_START_MS: f64 = 5.0;
/// Share of the cycle that the file must cover. After its last sample the value is held.
const COVERED: f64 = 0.8;

/// Samples \[µM\] at 0, [`INTERVAL_MS`], … up to the end of the cycle, interpolated linearly
/// between those of the file and held after the last one.
///
/// # Errors
/// [`TaskError`] when the file is not the planned one or not a trace, when it begins too late or
/// ends too early, or when a sample is not positive.
pub fn samples(file: &InputFile, cycle_length_ms: f64) -> Result<Vec<f64>, TaskError> {
    let trace = read_trace(file, Quantity::Calcium)?;
    let refused = |message: String| TaskError::Measured {
        role: file.name.clone(),
        message,
    };
    let (name, begin) = (file.path.display(), trace.time_ms()[0]);
    if !(0.0..=LATEST_START_MS).contains(&begin) {
        let message = format!(
            "{name}: begins at {begin} ms, expected 0 ms, which is the activation: shift its times"
        );
        return Err(refused(message));
    }
    let end = trace.end_ms();
    if end < COVERED * cycle_length_ms {
        let expected = COVERED * cycle_length_ms;
        let message = format!(
            "{name}: ends at {end} ms, expected at least {expected:.0} ms, 80 % of the cycle"
        );
        return Err(refused(message));
    }
    if let Some((time, value)) = trace
        .time_ms()
        .iter()
        .zip(trace.values())
        .find(|(_, value)| **value <= 0.0)
    {
        return Err(refused(format!(
            "{name}: {value} uM at {time} ms, expected a positive concentration"
        )));
    }
    let n = (cycle_length_ms / INTERVAL_MS).ceil() as usize + 1;
    Ok((0..n)
        .map(|k| trace.at((k as f64 * INTERVAL_MS).clamp(begin, end)))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::hash::sha256_hex;

    fn read(text: &str, cycle_length_ms: f64) -> Result<Vec<f64>, String> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("calcium.csv");
        std::fs::write(&path, text).unwrap();
        let file = InputFile {
            name: "calcium".into(),
            path,
            sha256: sha256_hex(text.as_bytes()),
        };
        samples(&file, cycle_length_ms).map_err(|error| error.to_string())
    }

    fn rows(times: impl Iterator<Item = f64>) -> String {
        times.fold("time_ms,Ca_uM\n".to_owned(), |text, t| {
            text + &format!("{t},{}\n", 0.1 + 0.001 * t)
        })
    }

    #[test]
    fn samples_are_interpolated_and_held_at_the_end() {
        let samples = read(&rows((0..=45).map(|k| f64::from(2 * k))), 100.0).unwrap();
        assert_eq!(samples.len(), 101);
        assert!((samples[31] - 0.131).abs() < 1e-12);
        assert_eq!((samples[90], samples[100]), (0.19, 0.19));
    }

    #[test]
    fn a_late_short_or_negative_transient_is_refused_with_what_was_found() {
        let late = read(&rows((20..=100).map(f64::from)), 100.0).unwrap_err();
        assert!(late.contains("begins at 20 ms"), "{late}");
        let short = read(&rows((0..=50).map(f64::from)), 100.0).unwrap_err();
        assert!(
            short.contains("ends at 50 ms, expected at least 80 ms"),
            "{short}"
        );
        let negative = read("time_ms,Ca_uM\n0,0.1\n1,-0.2\n2,0.1\n", 2.0).unwrap_err();
        assert!(
            negative.contains("calcium.csv:3: Ca_uM: found `-0.2`"),
            "{negative}"
        );
        let zero = read("time_ms,Ca_uM\n0,0.1\n1,0\n2,0.1\n", 2.0).unwrap_err();
        assert!(zero.contains("0 uM at 1 ms"), "{zero}");
    }
}
