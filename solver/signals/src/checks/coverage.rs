//! Do the traces cover the cycle, one and the same, with enough samples?

use super::measured::{Measured, Source};
use crate::Problem;
use crate::read::median_step_ms;

/// Cycle lengths that a living heart has, ms.
const CYCLE_MS: std::ops::RangeInclusive<f64> = 200.0..=3000.0;
/// Fraction of the cycle by which a trace may be longer or shorter, dimensionless; one and a half samples always are.
const TOLERANCE: f64 = 0.01;
/// Fewest samples with which anything can be computed, and below which values get coarse.
const PRESSURE_SAMPLES: [usize; 2] = [30, 150];
const VOLUME_SAMPLES: [usize; 2] = [8, 20];

/// Whether times can be trusted by further checks.
pub(super) fn check(measured: &Measured, problems: &mut Vec<Problem>) -> bool {
    let n_before = problems.iter().filter(|p| p.is_error()).count();
    let cycle_length = measured.cycle_length.0;
    if !CYCLE_MS.contains(&cycle_length) {
        let seconds = CYCLE_MS.contains(&(cycle_length * 1000.0));
        let remedy = if seconds {
            "this looks like seconds: multiply by 1000"
        } else {
            "give the length of one cycle in ms"
        };
        let problem = Problem::error(
            measured.patient_file,
            format!("{cycle_length} ms"),
            format!("{} to {} ms", CYCLE_MS.start(), CYCLE_MS.end()),
            remedy,
        );
        problems.push(problem.at_key("cycle_length_ms"));
        return false;
    }
    let pressure = measured
        .pressure
        .and_then(|s| cover(s, PRESSURE_SAMPLES, cycle_length, problems));
    let volume = measured
        .volume
        .and_then(|s| cover(s, VOLUME_SAMPLES, cycle_length, problems));
    if let (Some(p), Some(v), Some(volume_file)) = (pressure, volume, measured.volume) {
        let tolerance = (TOLERANCE * cycle_length).max(1.5 * p.step_ms.max(v.step_ms));
        if (p.length_ms - v.length_ms).abs() > tolerance {
            problems.push(Problem::error(
                volume_file.file,
                format!("{:.0} ms of volume against {:.0} ms of pressure", v.length_ms, p.length_ms),
                format!("both over the same cycle, to {tolerance:.0} ms (their sampling may differ)"),
                "they come from beats of different length: scale systole and diastole of one to the other's, or take other beats",
            ));
        }
    }
    problems.iter().filter(|p| p.is_error()).count() == n_before
}

/// Whether a pressure trace other than the left ventricle's covers the cycle.
pub(super) fn of_pressure(source: Source, cycle_length: f64, problems: &mut Vec<Problem>) {
    cover(source, PRESSURE_SAMPLES, cycle_length, problems);
}

/// Whether a trace of frames other than the volume covers the cycle.
pub(super) fn of_frames(source: Source, cycle_length: f64, problems: &mut Vec<Problem>) {
    cover(source, VOLUME_SAMPLES, cycle_length, problems);
}

struct Cover {
    /// Time covered: from the first sample to one step after the last, or to the last if that closes the cycle, ms.
    length_ms: f64,
    step_ms: f64,
}

fn cover(
    source: Source,
    n_samples: [usize; 2],
    cycle_length: f64,
    problems: &mut Vec<Problem>,
) -> Option<Cover> {
    let Source { file, trace } = source;
    let step_ms = median_step_ms(trace.time_ms().iter().copied());
    let begin = trace.time_ms()[0];
    let span = trace.end_ms() - begin;
    // A trace may repeat its first sample at the end or not: take the reading that is nearer to the cycle.
    let length_ms = if (span - cycle_length).abs() < (span + step_ms - cycle_length).abs() {
        span
    } else {
        span + step_ms
    };
    if (length_ms * 1000.0 / cycle_length - 1.0).abs() < 0.1 {
        let problem = Problem::error(
            file,
            format!("times up to {}", trace.end_ms()),
            format!("times over the cycle of {cycle_length} ms"),
            "these look like seconds: multiply the times by 1000",
        );
        problems.push(problem.at_key("time_ms"));
        return None;
    }
    let [fewest, few] = n_samples;
    let n = trace.n_samples();
    if n < few {
        let found = format!("{n} samples");
        let quantity = trace.quantity();
        problems.push(if n < fewest {
            Problem::error(
                file,
                found,
                format!("at least {fewest} in a cycle"),
                format!("export the {quantity} with finer steps"),
            )
        } else {
            Problem::warning(
                file,
                found,
                format!("{few} or more in a cycle"),
                format!("biomarkers of so coarse a {quantity} are uncertain"),
            )
        });
    }
    let tolerance = (TOLERANCE * cycle_length).max(1.5 * step_ms);
    if (length_ms - cycle_length).abs() > tolerance {
        let problem = Problem::error(
            file,
            format!("{length_ms:.1} ms from the first sample to the end of the last"),
            format!("one cycle of {cycle_length} ms, to {tolerance:.0} ms"),
            "give one whole beat, or mend cycle_length_ms in patient.toml",
        );
        problems.push(problem.at_key("time_ms"));
    } else if begin.abs() > tolerance || begin < -1e-9 {
        let problem = Problem::warning(
            file,
            format!("a first sample at {begin} ms"),
            "time 0 at the beat's beginning, in diastole",
            "times count from the R wave: subtract the beginning if the trace begins there",
        );
        problems.push(problem.at_key("time_ms"));
    }
    Some(Cover { length_ms, step_ms })
}
