//! What to simulate next in step 3: the cell whose one-fibre ventricle, corrected to the beats so far, meets the data.

use std::collections::BTreeMap;

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::fixed_point::{Biomarker, Outcome, Weights};
use cardiotwin_calibrate::space_mapping::{Nearness, Prior, Problem, Run, propose};
use cardiotwin_schemas::outcome::{Step3ProposalResult, TaskResult};
use cardiotwin_schemas::task::{MovedParameter, Step3ProposalSpec};

use super::one_fibre;
use crate::context::Context;
use crate::error::TaskError;
use crate::step1;
use crate::tasks::organ_beat::{reduced, reduced_beat};

/// The prior holds what the data do not determine: nothing else needs to.
const NEARNESS: Nearness = Nearness { at_first: 0.0, of_best: 0.0 };
/// Organ over one-fibre ventricle that is expected of each biomarker before any beat: alike.
const EXPECTED: [f64; Biomarker::ALL.len()] = [1.0; Biomarker::ALL.len()];

/// Proposes.
///
/// # Errors
/// [`TaskError`] when the specification is outside the models, or nothing is left to try.
pub fn run(spec: &Step3ProposalSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let (passive, activation) = one_fibre(&spec.beat.organ)?;
    // Refused once and for all: an effect that cannot act, a parameter outside the models.
    reduced(&spec.beat, &passive, &activation)?;
    let axes: Vec<Axis> = spec.parameters.iter().map(|(name, moved)| Axis::new(name, moved)).collect();
    let named = |x: &[f64]| -> BTreeMap<String, f64> {
        axes.iter().zip(x).map(|(axis, x)| (axis.name.clone(), axis.value(*x))).collect()
    };
    let cheap = |x: &[f64]| match reduced_beat(&spec.beat.with_parameters(&named(x)), &passive, &activation) {
        Ok(Some(beat)) => step1::outcome(&beat),
        Ok(None) | Err(_) => Outcome::Failed,
    };
    let point = |values: &BTreeMap<String, f64>| -> Vec<f64> {
        axes.iter().map(|axis| values.get(&axis.name).map_or(axis.prior.centre, |v| v.abs().ln())).collect()
    };
    let runs: Vec<Run> = (spec.runs.iter())
        .map(|run| Run {
            x: point(&run.parameters),
            outcome: run.biomarkers.as_ref().map_or(Outcome::Failed, |b| step1::told(b, run.whole_beat)),
            predicted_misfit: run.predicted_misfit,
        })
        .collect();
    let intervals: Vec<Interval> = axes.iter().map(|axis| axis.interval).collect();
    let prior: Vec<Prior> = axes.iter().map(|axis| axis.prior).collect();
    let start: Vec<f64> = prior.iter().map(|prior| prior.centre).collect();
    let problem = Problem {
        measured: &step1::biomarkers(&spec.measured),
        weights: &Weights::of_uncertainty_percent(&spec.uncertainty_percent),
        runs: &runs,
        start: &start,
        intervals: &intervals,
        prior: &prior,
        nearness: NEARNESS,
        expected: EXPECTED,
        seed: spec.seed,
    };
    let proposal = propose(&problem, &cheap)
        .ok_or(TaskError::NoProposal("no beat of step 3 ended, nor does one of the one-fibre ventricle"))?;
    Ok(TaskResult::Step3Proposal(Step3ProposalResult {
        parameters: named(&proposal.x),
        predicted: step1::to_schema(&proposal.biomarkers),
        predicted_cost: proposal.cost,
        predicted_misfit: proposal.misfit,
        from_iteration: proposal.base.map(|base| base as u32 + 1),
        trust_radius: proposal.radius,
        step: proposal.step,
        correction: step1::factors(&proposal),
        reduced_beats: proposal.cheap_beats as u64,
    }))
}

/// A parameter as the search sees it: the logarithm of its magnitude.
struct Axis {
    name: String,
    sign: f64,
    interval: Interval,
    prior: Prior,
}

impl Axis {
    fn new(name: &str, moved: &MovedParameter) -> Self {
        let [a, b, centre] = [moved.lower, moved.upper, moved.centre].map(|value| value.abs().ln());
        let interval = Interval::new(a.min(b), a.max(b));
        Self {
            name: name.to_owned(),
            sign: moved.upper.signum(),
            interval,
            prior: Prior { centre: interval.clamp(centre), width: moved.log_sd },
        }
    }

    fn value(&self, x: f64) -> f64 {
        self.sign * x.exp()
    }
}
