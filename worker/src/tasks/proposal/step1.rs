//! Proposal for the next simulation of step 1: the optimum of the one-fibre ventricle, corrected by
//! the simulations so far.

use cardiotwin_calibrate::fixed_point::Weights;
use cardiotwin_calibrate::space_mapping::{Step1Problem, Step1Run, propose_step1};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::organ::{ContractionSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Step1ProposalResult, TaskResult};
use cardiotwin_schemas::settings::Step1Settings;
use cardiotwin_schemas::task::{OrganBeatSpec, Step1ProposalSpec};

use super::learned::learned_law;
use super::{factors, law_beats, outcome, told};
use crate::context::Context;
use crate::error::TaskError;
use crate::tasks::organ_beat::{reduced, reduced_beat};
use crate::tasks::surrogate::{searched, surrogate};

/// Expected ratios of the simulated organ's biomarkers to those of the one-fibre ventricle before
/// any simulation: both are equal.
const EXPECTED: [f64; Biomarker::OF_ORGAN.len()] = [1.0; Biomarker::OF_ORGAN.len()];

/// Computes the proposal.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models, or there is nothing
/// left to try.
pub fn run(spec: &Step1ProposalSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let ContractionSpec::Tanh { parameters: tanh } = spec.beat.contraction else {
        return Err(TaskError::NoProposal(
            "step 1 personalises the Tanh model alone",
        ));
    };
    let start = Step1Parameters {
        tanh,
        valves: spec.beat.valves,
    };
    let organ = surrogate(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?;
    let beat = searched(&spec.beat);
    // Reports errors that are common to all beats: an invalid effect, a parameter
    // outside the range of the models.
    reduced(&beat, &organ)?;
    let cheap = |p: &Step1Parameters| {
        let beat = reduced_beat(&with(&beat, p), &organ);
        outcome(beat.ok().flatten().as_ref())
    };
    let runs: Vec<Step1Run> = (spec.runs.iter())
        .map(|run| Step1Run {
            parameters: run.parameters,
            outcome: told(run.biomarkers.as_ref(), run.whole_beat),
            predicted_misfit: run.predicted_misfit,
        })
        .collect();
    let settings = Step1Settings {
        bounds: spec.bounds.clone(),
        frozen: spec.frozen.clone(),
        ..Step1Settings::default()
    };
    let proposal = propose_step1(
        &Step1Problem {
            measured: &spec.measured,
            runs: &runs,
            initial: &start,
            settings: &settings,
            weights: &Weights::of(&spec.weights)?,
            expected: EXPECTED,
            is_trusted: organ.law.is_some(),
            seed: spec.seed,
        },
        &cheap,
    );
    let (parameters, proposal) = proposal.ok_or(TaskError::NoProposal(
        "no simulation of step 1 ended, nor does a beat of the one-fibre ventricle",
    ))?;
    Ok(TaskResult::Step1Proposal(Step1ProposalResult {
        parameters,
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

fn with(beat: &OrganBeatSpec, p: &Step1Parameters) -> OrganBeatSpec {
    OrganBeatSpec {
        contraction: ContractionSpec::Tanh { parameters: p.tanh },
        valves: p.valves,
        ..beat.clone()
    }
}
