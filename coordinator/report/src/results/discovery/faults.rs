//! Attribution of a patient's differences from the measured traces to the organ's model or to the
//! cell.

use cardiotwin_schemas::discover::{RunMisses, TraceMisses};
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::samples::BeatSamples;

/// Misses of a personalised patient's beats; `None` before the verification beat, or if no trace
/// was measured.
#[must_use]
pub fn of_run(record: &PatientRecord) -> Option<RunMisses> {
    let measured = &record.step0.as_ref()?.result.samples;
    let best = record.step1.as_ref()?.best_iteration;
    let step1 = record
        .iterations
        .iter()
        .find(|iteration| iteration.number == best)?
        .run
        .as_ref()?;
    let verification = record.verification.as_ref()?;
    let twin = record.twin()?;
    let of = |trace: fn(&BeatSamples) -> &[f64]| {
        let miss = |beat: &BeatSamples| root_mean_square(trace(beat), trace(measured));
        Some(TraceMisses {
            step1: miss(&step1.result.samples)?,
            verification: miss(&verification.result.samples)?,
            twin: miss(&twin.result.samples)?,
        })
    };
    let misses = RunMisses {
        pressure_mmhg: of(|beat| &beat.pressure_mmhg),
        volume_ml: of(|beat| &beat.volume_ml),
    };
    (misses.pressure_mmhg.is_some() || misses.volume_ml.is_some()).then_some(misses)
}

fn root_mean_square(simulated: &[f64], measured: &[f64]) -> Option<f64> {
    let n = simulated.len();
    (n > 0 && n == measured.len()).then(|| {
        let square: f64 = simulated
            .iter()
            .zip(measured)
            .map(|(a, b)| (a - b).powi(2))
            .sum();
        (square / n as f64).sqrt()
    })
}

/// The larger cause of a trace's misses: the cell or the organ's model.
#[must_use]
pub fn whose(misses: &TraceMisses) -> &'static str {
    if misses.of_cell() > misses.of_organ() {
        "the cell"
    } else {
        "the organ's model"
    }
}

/// The measured traces of a patient: name, unit and misses.
#[must_use]
pub fn traces(run: &RunMisses) -> Vec<(&'static str, &'static str, TraceMisses)> {
    let named = [
        ("pressure", "mmHg", run.pressure_mmhg),
        ("volume", "mL", run.volume_ml),
    ];
    named
        .into_iter()
        .filter_map(|(name, unit, misses)| Some((name, unit, misses?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_misses_more_is_at_fault_and_squares_add_up() {
        let misses = TraceMisses {
            step1: 3.0,
            verification: 5.0,
            twin: 6.0,
        };
        assert_eq!(
            (misses.of_organ(), misses.of_cell(), whose(&misses)),
            (3.0, 4.0, "the cell")
        );
        let better = TraceMisses {
            step1: 3.0,
            verification: 2.0,
            twin: 2.5,
        };
        assert_eq!(
            (better.of_organ(), better.of_cell(), whose(&better)),
            (2.5, 0.0, "the organ's model")
        );
        assert_eq!(root_mean_square(&[1.0, 2.0], &[1.0]), None);
    }
}
