//! What to simulate next in step 3: the cell whose one-fibre ventricle, corrected to the beats so far, meets the data.

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::fixed_point::Weights;
use cardiotwin_calibrate::least_squares;
use cardiotwin_calibrate::space_mapping::{Effort, Nearness, Prior, Problem, Run, Trial, propose};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::organ::{
    ActivationSpec, ContractionSpec, OneFibrePassive, Step1Parameters,
};
use cardiotwin_schemas::outcome::{Step3ProposalResult, TaskResult};
use cardiotwin_schemas::samples::BeatSamples;
use cardiotwin_schemas::task::{OrganBeatSpec, Step1Beat, Step3ProposalSpec, Step3Run};

use super::axes::{axes, is_sensitive, named, point};
use super::{factors, one_fibre, outcome, told};
use crate::context::Context;
use crate::error::TaskError;
use crate::tasks::organ_beat::{reduced, reduced_beat};

/// The organ's factors are known at the best beat alone: among cells that serve alike the nearest is the surest.
const NEARNESS: Nearness = Nearness {
    at_first: 0.0,
    of_best: 1.0,
};
/// How far a beat's biomarker may lie from its measurement, as a logarithm, before step 1's beat says more of its factor:
/// step 1's is near the measurements, as a twin is (docs/step3.md).
const REACH: f64 = 0.1;

/// Change of a parameter's logarithm that the first step may make: no bounds of step 3 are farther apart, so that they alone
/// limit it.
const FIRST_RADIUS: f64 = 10.0;
/// Shortest time step of the one-fibre ventricle in a search: the correction takes up what that changes.
const TIME_STEP_MS: f64 = 2.0;

const LOCAL: least_squares::Settings = least_squares::Settings {
    cost_tolerance: 1e-4,
    step_tolerance: 1e-4,
    max_steps: 3,
    difference_step: 5e-3,
};
/// From step 2's cell.
const FAR: Effort = Effort::Evolution {
    evaluations: 6000,
    candidates: 16,
    deviation: 0.1,
    local: LOCAL,
};
/// From a cell that step 3 has tried.
const NEARBY: Effort = Effort::Evolution {
    evaluations: 3000,
    candidates: 12,
    deviation: 0.1,
    local: LOCAL,
};

/// Proposes.
///
/// # Errors
/// [`TaskError`] when the specification is outside the models, or nothing is left to try.
pub fn run(spec: &Step3ProposalSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let (passive, activation) = one_fibre(&spec.beat.organ)?;
    let beat = OrganBeatSpec {
        time_step_ms: spec.beat.time_step_ms.max(TIME_STEP_MS),
        ..spec.beat.clone()
    };
    // Refused once and for all: an effect that cannot act, a parameter outside the models.
    reduced(&beat, &passive, &activation)?;
    let axes = axes(&spec.parameters);
    let named = |x: &[f64]| named(&axes, x);
    let also = |samples: Option<&BeatSamples>| {
        spec.traces
            .as_ref()
            .map_or_else(Vec::new, |traces| traces.residuals(samples))
    };
    let cheap = |x: &[f64]| {
        let trial = beat.with_parameters(&named(x));
        let sensitive = is_sensitive(&trial);
        let simulated = if sensitive {
            reduced_beat(&trial, &passive, &activation).ok().flatten()
        } else {
            None
        };
        Trial {
            outcome: outcome(simulated.as_ref()),
            also: also(simulated.as_ref().map(|beat| &beat.samples)),
        }
    };
    let runs: Vec<Run> = (spec.runs.iter())
        .map(|Step3Run { run, samples }| Run {
            x: point(&axes, &run.parameters),
            outcome: told(run.biomarkers.as_ref(), run.whole_beat),
            also: also(samples.as_ref()),
            predicted_misfit: run.predicted_misfit,
        })
        .collect();
    let intervals: Vec<Interval> = axes.iter().map(|axis| axis.interval).collect();
    let prior: Vec<Prior> = axes.iter().map(|axis| axis.prior).collect();
    let start: Vec<f64> = prior.iter().map(|prior| prior.centre).collect();
    let expected = match &spec.step1 {
        Some(of_step1) => expected(of_step1, &beat, &passive, &activation),
        None => [1.0; Biomarker::OF_ORGAN.len()],
    };
    let problem = Problem {
        measured: &spec.measured,
        weights: &Weights::of_uncertainty_percent(&spec.uncertainty_percent),
        runs: &runs,
        start: &start,
        intervals: &intervals,
        prior: &prior,
        nearness: NEARNESS,
        expected,
        reach: Biomarker::OF_ORGAN.map(|b| {
            if is_of_relaxation(b) {
                f64::INFINITY
            } else {
                REACH
            }
        }),
        first_radius: FIRST_RADIUS,
        effort: if spec.runs.len() > 1 { NEARBY } else { FAR },
        seed: spec.seed,
    };
    let proposal = propose(&problem, &cheap).ok_or(TaskError::NoProposal(
        "no beat of step 3 ended, nor does one of the one-fibre ventricle",
    ))?;
    Ok(TaskResult::Step3Proposal(Step3ProposalResult {
        parameters: named(&proposal.x),
        predicted: proposal.biomarkers,
        predicted_cost: proposal.cost,
        predicted_misfit: proposal.misfit,
        from_iteration: proposal.base.map(|base| base as u32 + 1),
        trust_radius: proposal.radius,
        step: proposal.step,
        correction: factors(&proposal),
        reduced_beats: proposal.cheap_beats as u64,
    }))
}

/// The Tanh stress of step 1 relaxes otherwise than a cell: its factor says nothing of the twin's.
fn is_of_relaxation(biomarker: Biomarker) -> bool {
    biomarker == Biomarker::DpdtMin
}

/// Organ over one-fibre ventricle of step 1's best beat, by biomarker; 1 where either lacks it.
fn expected(
    of_step1: &Step1Beat,
    beat: &OrganBeatSpec,
    passive: &OneFibrePassive,
    activation: &ActivationSpec,
) -> [f64; Biomarker::OF_ORGAN.len()] {
    let Step1Parameters { tanh, valves } = of_step1.parameters;
    let beat = OrganBeatSpec {
        contraction: ContractionSpec::Tanh { parameters: tanh },
        valves,
        ..beat.clone()
    };
    let simulated = reduced_beat(&beat, passive, activation).ok().flatten();
    let one_fibre = simulated.map(|beat| beat.biomarkers).unwrap_or_default();
    let organ = &of_step1.biomarkers;
    Biomarker::OF_ORGAN.map(|biomarker| match organ.ratio_to(&one_fibre, biomarker) {
        Some(ratio) if !is_of_relaxation(biomarker) => ratio,
        _ => 1.0,
    })
}
