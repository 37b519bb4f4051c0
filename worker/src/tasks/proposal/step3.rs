//! Proposal for the next simulation of step 3: the cell whose one-fibre ventricle, corrected by the
//! beats so far, fits the data best.

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::fixed_point::Weights;
use cardiotwin_calibrate::least_squares;
use cardiotwin_calibrate::space_mapping::{
    Effort, Nearness, Prior, Problem, Proposal, Run, Trial, propose,
};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::organ::{ContractionSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Step3ProposalResult, TaskResult};
use cardiotwin_schemas::samples::BeatSamples;
use cardiotwin_schemas::task::{OrganBeatSpec, Step1Beat, Step3ProposalSpec, Step3Run};

use super::axes::{axes, is_sensitive, named, point, tolerated};
use super::learned::learned_law;
use super::{factors, law_beats, outcome, told};
use crate::context::Context;
use crate::error::TaskError;
use crate::tasks::organ_beat::{ReducedOrgan, reduced, reduced_beat};
use crate::tasks::surrogate::{searched, surrogate};

/// The organ's factors are known at the beats so far only. Among cells with similar costs, the nearest
/// one to the best beat is therefore the safest. The share of the doubt was chosen on ten development
/// patients (docs/measurements/step3.md#the-doubt).
const NEARNESS: Nearness = Nearness {
    at_first: 0.0,
    of_best: 1.0,
    of_doubt: 0.3,
};
/// Largest distance of a beat's biomarker from its measurement, as a logarithm, up to which the
/// beat determines the biomarker's factor. Beyond it, the beat of step 1 is a better guide, because
/// it is near the measurements, as a twin is (docs/step3.md).
const REACH: f64 = 0.1;

/// Largest change of a parameter's logarithm in the first step. It exceeds the width of all bounds
/// in step 3, so that only the bounds limit the step.
const FIRST_RADIUS: f64 = 10.0;
/// Shortest time step of the one-fibre ventricle in a search. The correction absorbs its error.
const TIME_STEP_MS: f64 = 2.0;

const LOCAL: least_squares::Settings = least_squares::Settings {
    cost_tolerance: 1e-4,
    step_tolerance: 1e-4,
    max_steps: 3,
    difference_step: 5e-3,
};
/// Effort of a search that starts from step 2's cell.
const FAR: Effort = Effort::Evolution {
    evaluations: 6000,
    candidates: 16,
    deviation: 0.1,
    local: LOCAL,
};
/// Effort of a search that starts from a cell that step 3 has tried.
const NEARBY: Effort = Effort::Evolution {
    evaluations: 3000,
    candidates: 12,
    deviation: 0.1,
    local: LOCAL,
};
/// Effort of a search in the organ's law, which is smooth enough for descents. The number of descents
/// was chosen on two development patients, the weight of the prior on twelve: the largest one that
/// leaves their twins as near to the measurements (docs/measurements/step3.md).
const IN_LAW: Effort = Effort::Descents {
    points: 10,
    best: 2,
    spread: 0.5,
    steps: 60,
    weight_of_prior: 0.2,
};

/// Misfit above which descents count as stuck, twice the largest of the development patients'
/// searches. A population then searches as well: descents from a cell that barely contracts find no
/// way to one that does.
const STUCK: f64 = 100.0;

/// Computes the proposal.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models, or there is nothing
/// left to try.
pub fn run(spec: &Step3ProposalSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let organ = surrogate(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?;
    let beat = OrganBeatSpec {
        time_step_ms: spec.beat.time_step_ms.max(TIME_STEP_MS),
        ..searched(&spec.beat)
    };
    // Reports errors that are common to all beats: an invalid effect, a parameter
    // outside the range of the models.
    reduced(&beat, &organ)?;
    let axes = axes(&spec.parameters);
    let named = |x: &[f64]| named(&axes, x);
    let also = |samples: Option<&BeatSamples>| {
        spec.traces
            .as_ref()
            .map_or_else(Vec::new, |traces| traces.residuals(samples))
    };
    let has_law = organ.law.is_some();
    let simulable = |x: &[f64]| -> Option<Vec<f64>> {
        if has_law {
            tolerated(&beat, &axes, x)
        } else {
            is_sensitive(&beat.with_parameters(&named(x))).then(|| x.to_vec())
        }
    };
    let cheap = |x: &[f64]| {
        let simulated = simulable(x).and_then(|x| {
            let trial = beat.with_parameters(&named(&x));
            reduced_beat(&trial, &organ).ok().flatten()
        });
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
    // The law has learned from step 1's beats, so their factors would count twice.
    let expected = match &spec.step1 {
        _ if has_law => Biomarker::OF_ORGAN.map(of_first_beat),
        Some(of_step1) => expected(of_step1, &beat, &organ),
        None => [1.0; Biomarker::OF_ORGAN.len()],
    };
    let evolution = if spec.runs.len() > 1 { NEARBY } else { FAR };
    let problem = Problem {
        measured: &spec.measured,
        weights: &Weights::of_uncertainty_percent(&spec.uncertainty_percent),
        runs: &runs,
        start: &start,
        intervals: &intervals,
        prior: &prior,
        nearness: NEARNESS,
        expected,
        // A law learned from the organ is trusted everywhere, so that only its beats correct it.
        reach: Biomarker::OF_ORGAN.map(|b| {
            if is_of_relaxation(b) || has_law {
                f64::INFINITY
            } else {
                REACH
            }
        }),
        first_radius: FIRST_RADIUS,
        effort: if has_law { IN_LAW } else { evolution },
        seed: spec.seed,
    };
    let proposal = propose(&problem, &cheap).ok_or(TaskError::NoProposal(
        "no beat of step 3 ended, nor does one of the one-fibre ventricle",
    ))?;
    let proposal = if has_law && (proposal.misfit.is_nan() || proposal.misfit > STUCK) {
        let evolved = Problem {
            effort: evolution,
            ..problem
        };
        better(proposal, propose(&evolved, &cheap))
    } else {
        proposal
    };
    let x = simulable(&proposal.x).unwrap_or_else(|| proposal.x.clone());
    Ok(TaskResult::Step3Proposal(Step3ProposalResult {
        parameters: named(&x),
        predicted: proposal.biomarkers,
        predicted_cost: proposal.cost,
        predicted_misfit: proposal.misfit,
        from_iteration: proposal.base.map(|base| base as u32 + 1),
        trust_radius: proposal.radius,
        step: proposal.step,
        correction: factors(&proposal),
        law_beats: law_beats(&organ, spec.law.as_deref()),
        learned_law: learned_law(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?,
        reduced_beats: proposal.cheap_beats as u64,
    }))
}

/// The proposal with the lower misfit, with the beats of both searches.
fn better(first: Proposal, second: Option<Proposal>) -> Proposal {
    let Some(second) = second else { return first };
    let cheap_beats = first.cheap_beats + second.cheap_beats;
    let best = if second.misfit < first.misfit || first.misfit.is_nan() {
        second
    } else {
        first
    };
    Proposal {
        cheap_beats,
        ..best
    }
}

/// The Tanh stress of step 1 relaxes differently from a cell, so that its factor does not apply to
/// the twin.
fn is_of_relaxation(biomarker: Biomarker) -> bool {
    biomarker == Biomarker::DpdtMin
}

/// Expected ratio of the organ's first beat with a cell to the organ's law that has learned from beats
/// with the Tanh stress: means of twelve development patients (docs/organ-law.md#the-first-cell). The
/// Tanh stress teaches the law little about a cell's relaxation.
fn of_first_beat(biomarker: Biomarker) -> f64 {
    match biomarker {
        Biomarker::DpdtMax => 1.02,
        Biomarker::DpdtMin => 1.05,
        Biomarker::Sv => 1.015,
        _ => 1.0,
    }
}

/// Ratios of organ to one-fibre ventricle in step 1's best beat, by biomarker; 1 if either lacks
/// the biomarker.
fn expected(
    of_step1: &Step1Beat,
    beat: &OrganBeatSpec,
    organ: &ReducedOrgan,
) -> [f64; Biomarker::OF_ORGAN.len()] {
    let Step1Parameters { tanh, valves } = of_step1.parameters;
    let beat = OrganBeatSpec {
        contraction: ContractionSpec::Tanh { parameters: tanh },
        valves,
        ..beat.clone()
    };
    let simulated = reduced_beat(&beat, organ).ok().flatten();
    let one_fibre = simulated.map(|beat| beat.biomarkers).unwrap_or_default();
    let simulated = &of_step1.biomarkers;
    Biomarker::OF_ORGAN.map(
        |biomarker| match simulated.ratio_to(&one_fibre, biomarker) {
            Some(ratio) if !is_of_relaxation(biomarker) => ratio,
            _ => 1.0,
        },
    )
}
