//! Step 3 as tasks: comparison of the beats so far, and the criteria for another simulation. Pure
//! functions.

use std::collections::BTreeMap;

use cardiotwin_calibrate::fixed_point::Weights;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ_law::LawSamples;
use cardiotwin_schemas::outcome::{OrganBeatResult, PassiveStateResult};
use cardiotwin_schemas::samples::BeatSamples;
use cardiotwin_schemas::step3::Step3Settings;
use cardiotwin_schemas::task::{ProposalRun, Step3Run};
use cardiotwin_schemas::verdict::Verdict;

/// Relative reduction of the misfit that a proposal must promise if the best beat is already
/// personalised.
const PROMISED_SHARE: f64 = 0.2;
/// The same if the best beat is not personalised.
const LEAST_SHARE: f64 = 0.02;

/// A beat of the organ with a cell: the verification beat, or one of step 3.
#[derive(Debug, Clone)]
pub struct Beat {
    /// Values of the parameters that step 3 may change.
    pub parameters: BTreeMap<String, f64>,
    /// Simulated biomarkers; `None` if the simulation failed.
    pub biomarkers: Option<Biomarkers>,
    /// Simulated pressure and volume; `None` if the simulation failed.
    pub samples: Option<BeatSamples>,
    /// Samples for the organ's law; `None` if the simulation failed or the organ is reduced.
    pub law: Option<LawSamples>,
    /// Name of a valve that did not open and close; `None` if both did.
    pub shut: Option<String>,
    /// Misfit that the proposal of this beat predicted; `None` for the verification beat.
    pub predicted_misfit: Option<f64>,
    /// Sum of squared differences over the measurements' variances; `None` if the simulation
    /// failed.
    pub misfit: Option<f64>,
    /// Verdict on the twin; `None` if the simulation failed.
    pub verdict: Option<Verdict>,
}

impl Beat {
    /// A simulation that failed.
    pub fn failed(parameters: BTreeMap<String, f64>) -> Self {
        let (biomarkers, samples, shut) = (None, None, None);
        Self {
            parameters,
            biomarkers,
            samples,
            law: None,
            shut,
            predicted_misfit: None,
            misfit: None,
            verdict: None,
        }
    }

    /// Whether the simulation succeeded and both valves opened and closed.
    pub fn is_whole(&self) -> bool {
        self.biomarkers.is_some() && self.shut.is_none()
    }

    /// Verdict of a whole beat on the twin.
    pub fn whole_verdict(&self) -> Option<Verdict> {
        self.verdict.clone().filter(|_| self.is_whole())
    }

    /// The beat as input of a proposal.
    pub fn told(&self) -> Step3Run {
        let run = ProposalRun {
            parameters: self.parameters.clone(),
            biomarkers: self.biomarkers,
            whole_beat: self.is_whole(),
            predicted_misfit: self.predicted_misfit,
        };
        Step3Run {
            run,
            samples: self.samples.clone(),
        }
    }
}

/// Sum of squared differences of biomarkers and traces over the measurements' variances.
pub fn misfit(
    settings: &Step3Settings,
    step0: &PassiveStateResult,
    cycle_length_ms: f64,
    simulated: &OrganBeatResult,
) -> f64 {
    let weights = Weights::of_uncertainty_percent(&settings.uncertainty_percent);
    let of_biomarkers = weights.misfit(&step0.measured, &simulated.biomarkers);
    let traces = settings.traces(step0, cycle_length_ms);
    let of_traces = traces
        .iter()
        .flat_map(|traces| traces.residuals(Some(&simulated.samples)))
        .map(|r| r * r);
    of_biomarkers + of_traces.sum::<f64>()
}

/// Index of the whole beat with the lowest misfit; `None` if there is no whole beat.
pub fn best(beats: &[Beat]) -> Option<usize> {
    let whole = beats.iter().enumerate().filter(|(_, beat)| beat.is_whole());
    let misfits = whole.filter_map(|(i, beat)| Some((i, beat.misfit?)));
    misfits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
}

/// Whether another beat with this predicted misfit is worth its simulation.
pub fn worth_it(beats: &[Beat], promised: f64) -> bool {
    let Some(beat) = best(beats).map(|i| &beats[i]) else {
        return true;
    };
    let share = if is_personalised(beat) {
        PROMISED_SHARE
    } else {
        LEAST_SHARE
    };
    beat.misfit
        .is_none_or(|misfit| promised < (1.0 - share) * misfit)
}

/// Whether the best beat agrees with the measurements to within their uncertainty, so that no
/// improvement is left.
pub fn content(beats: &[Beat], n_measured: f64) -> bool {
    let within = |beat: &Beat| beat.misfit.is_some_and(|misfit| misfit <= n_measured);
    best(beats).is_some_and(|i| is_personalised(&beats[i]) && within(&beats[i]))
}

fn is_personalised(beat: &Beat) -> bool {
    beat.verdict
        .as_ref()
        .is_some_and(|verdict| verdict.personalised)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beat(whole: bool, misfit: f64, personalised: bool) -> Beat {
        let verdict = Some(Verdict {
            personalised,
            off_percent: BTreeMap::new(),
        });
        let (parameters, biomarkers) = (BTreeMap::new(), Some(Biomarkers::default()));
        let shut = (!whole).then(|| "aortic valve".to_owned());
        Beat {
            parameters,
            biomarkers,
            samples: None,
            law: None,
            shut,
            predicted_misfit: None,
            misfit: Some(misfit),
            verdict,
        }
    }

    #[test]
    fn the_best_beat_is_a_whole_one() {
        assert_eq!(
            best(&[
                beat(true, 90.0, false),
                beat(false, 1.0, true),
                beat(true, 40.0, false)
            ]),
            Some(2)
        );
        assert_eq!(best(&[beat(false, 1.0, false)]), None);
    }

    #[test]
    fn a_personalised_beat_asks_for_a_larger_promise() {
        assert!(worth_it(&[beat(true, 100.0, false)], 90.0));
        assert!(!worth_it(&[beat(true, 100.0, true)], 90.0));
        assert!(worth_it(&[beat(true, 100.0, true)], 70.0));
        assert!(worth_it(&[], 1e9), "without any beat");
    }

    #[test]
    fn a_beat_within_the_uncertainty_is_enough() {
        assert!(content(&[beat(true, 6.9, true)], 7.0));
        assert!(!content(&[beat(true, 7.1, true)], 7.0));
        assert!(!content(&[beat(true, 1.0, false)], 7.0));
    }
}
