//! Are the values those of a left ventricle, in the unit that the header names?

use super::measured::{Measured, Source, extremes};
use crate::Problem;

/// Peak pressures of a left ventricle, mmHg.
const PEAK_MMHG: std::ops::Range<f64> = 50.0..350.0;
/// Largest volumes of a left ventricle, mL: from a newborn's to a failing one's.
pub const LARGEST_ML: std::ops::Range<f64> = 4.0..900.0;
/// A ventricle relaxes below this fraction of its peak pressure, dimensionless.
const RELAXED: f64 = 0.35;
/// A ventricle keeps more than this fraction of its largest volume, dimensionless.
const KEPT: f64 = 0.08;
/// A pressure below this, mmHg, is a shifted zero or a ringing catheter.
const OFFSET_MMHG: f64 = -20.0;
/// No catheter that is worth reading undershoots by more than this fraction of the peak pressure,
/// dimensionless: a damping ratio of 0.15 gives 0.62 for the sharpest fall.
const UNDERSHOOT: f64 = 0.7;
/// A diastolic pressure below this is worth a word, mmHg.
const LOW_MMHG: f64 = -6.0;
/// Least stroke volume, mL and as a fraction of the largest volume, that counts as ejection.
const LEAST_STROKE: (f64, f64) = (1.0, 0.05);

/// Whether values can be trusted by further checks.
pub(super) fn check(measured: &Measured, problems: &mut Vec<Problem>) -> bool {
    let n_before = problems.iter().filter(|p| p.is_error()).count();
    let never_relaxes = measured.pressure.is_some_and(|s| {
        let (max, min) = extremes(s.trace);
        max > 0.0 && min > RELAXED * max
    });
    let empties = measured.volume.is_some_and(|s| {
        let (max, min) = extremes(s.trace);
        max > 0.0 && min < KEPT * max
    });
    match (measured.pressure, measured.volume) {
        (Some(p), Some(v)) if never_relaxes && empties => {
            let (low, high) = (extremes(p.trace), extremes(v.trace));
            problems.push(Problem::error(
                p.file,
                format!(
                    "a pressure that stays between {:.0} and {:.0} mmHg, and a volume in {} that goes from {:.0} to {:.0} mL",
                    low.1, low.0, v.file.display(), high.1, high.0
                ),
                "a pressure that relaxes and a volume that does not empty",
                "the two files or their columns look swapped: exchange them",
            ));
        }
        _ => {
            if let Some(p) = measured.pressure {
                pressure(p, never_relaxes, problems);
            }
            if let Some(v) = measured.volume {
                volume(v, problems);
            }
        }
    }
    problems.iter().filter(|p| p.is_error()).count() == n_before
}

fn pressure(source: Source, never_relaxes: bool, problems: &mut Vec<Problem>) {
    let Source { file, trace } = source;
    let (max, min) = extremes(trace);
    let key = "pressure_mmHg";
    let units = [
        (7.50062, "kPa"),
        (7.50062e-3, "Pa"),
        (7.50062e-4, "dyn/cm2"),
        (750.062, "bar"),
    ];
    if !PEAK_MMHG.contains(&max) {
        let guess = units
            .iter()
            .find(|(factor, _)| (60.0..300.0).contains(&(max * factor)));
        let remedy = match guess {
            Some((factor, unit)) => {
                format!(
                    "this looks like {unit} (the peak would be {:.0} mmHg): multiply by {factor}",
                    max * factor
                )
            }
            None => "check that this is the left ventricle's pressure, in mmHg".into(),
        };
        let expected = format!("a peak of {} to {} mmHg", PEAK_MMHG.start, PEAK_MMHG.end);
        problems
            .push(Problem::error(file, format!("a peak of {max}"), expected, remedy).at_key(key));
        return;
    }
    if never_relaxes {
        let found = format!(
            "a pressure that never falls below {min:.1} mmHg, with a peak of {max:.1} mmHg"
        );
        let remedy =
            "this looks like a volume or an arterial pressure: give the left ventricle's pressure";
        problems.push(
            Problem::error(file, found, "a pressure that relaxes in diastole", remedy).at_key(key),
        );
    }
    let least = OFFSET_MMHG.min(-UNDERSHOOT * max);
    if min < least {
        let found = format!("a smallest pressure of {min:.1} mmHg");
        let remedy = "the transducer's zero looks shifted: subtract its offset";
        problems.push(
            Problem::error(file, found, format!("not below {least:.0} mmHg"), remedy).at_key(key),
        );
    } else if min < OFFSET_MMHG {
        let found = format!("a smallest pressure of {min:.1} mmHg");
        let remedy = "the transducer's zero is shifted (pressure_offset) or the catheter rings (catheter_response): `discover` can tell";
        problems.push(
            Problem::warning(file, found, format!("not below {OFFSET_MMHG} mmHg"), remedy)
                .at_key(key),
        );
    } else if min < LOW_MMHG {
        let found = format!("a smallest pressure of {min:.1} mmHg");
        let remedy = "check the transducer's zero; an offset moves end-diastolic pressure and the passive fit";
        problems.push(
            Problem::warning(
                file,
                found,
                format!("about 0 mmHg, not below {LOW_MMHG}"),
                remedy,
            )
            .at_key(key),
        );
    }
}

fn volume(source: Source, problems: &mut Vec<Problem>) {
    let Source { file, trace } = source;
    let (max, min) = extremes(trace);
    let key = "volume_mL";
    let n_negative = trace.values().iter().filter(|v| **v <= 0.0).count();
    if n_negative > 0 {
        let found = format!("{n_negative} volumes at or below zero, the smallest {min} mL");
        let remedy = "give the cavity's absolute volume, not a change of volume";
        problems.push(Problem::error(file, found, "positive volumes", remedy).at_key(key));
        return;
    }
    if !LARGEST_ML.contains(&max) {
        let units = [(1000.0, "litres"), (1e-3, "mm3"), (1e6, "m3")];
        let guess = units
            .iter()
            .find(|(factor, _)| (15.0..600.0).contains(&(max * factor)));
        let remedy = match guess {
            Some((factor, unit)) => {
                format!(
                    "this looks like {unit} (the largest would be {:.0} mL): multiply by {factor}",
                    max * factor
                )
            }
            None => "check that this is the left ventricle's cavity volume, in mL".into(),
        };
        let expected = format!(
            "a largest volume of {} to {} mL",
            LARGEST_ML.start, LARGEST_ML.end
        );
        problems.push(
            Problem::error(file, format!("a largest volume of {max}"), expected, remedy)
                .at_key(key),
        );
        return;
    }
    if min < KEPT * max {
        let found = format!("volumes from {min:.1} to {max:.1} mL");
        let remedy = "this looks like a pressure: give the left ventricle's cavity volume";
        problems
            .push(Problem::error(file, found, "a cavity that does not empty", remedy).at_key(key));
    }
    let stroke = max - min;
    if stroke < LEAST_STROKE.0.max(LEAST_STROKE.1 * max) {
        let found = format!(
            "a volume that changes by {stroke:.2} mL only, between {min:.1} and {max:.1} mL"
        );
        let expected = format!(
            "ejection of at least {:.0} % of the largest volume",
            100.0 * LEAST_STROKE.1
        );
        let remedy =
            "this volume never ejects: check that all frames of the cine series were segmented";
        problems.push(Problem::error(file, found, expected, remedy).at_key(key));
    }
}
