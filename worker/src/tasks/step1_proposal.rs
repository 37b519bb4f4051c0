//! What to simulate next in step 1: the one-fibre ventricle's optimum, corrected to the simulations so far.

use cardiotwin_calibrate::fixed_point::{Biomarker, Outcome, Parameters};
use cardiotwin_calibrate::space_mapping::{Problem, Proposal, Run, propose};
use cardiotwin_models::ventricle::OneFibrePassive;
use cardiotwin_models::ventricle::passive_state::DEFAULT_EXPONENT;
use cardiotwin_schemas::organ::{self, ActivationSpec, ContractionSpec, OrganSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{Step1ProposalResult, TaskResult};
use cardiotwin_schemas::settings::ActivationSettings;
use cardiotwin_schemas::task::{OrganBeatSpec, Step1ProposalSpec};
use cardiotwin_units::{Ml, Mmhg};

use super::organ_beat::{reduced, reduced_beat};
use crate::context::Context;
use crate::error::TaskError;
use crate::step1;

/// Biomarkers of the simulated organ over those of the one-fibre ventricle that are expected before any simulation: alike.
const EXPECTED: [f64; Biomarker::ALL.len()] = [1.0; Biomarker::ALL.len()];

/// Proposes.
///
/// # Errors
/// [`TaskError`] when the specification is outside the models, or nothing is left to try.
pub fn run(spec: &Step1ProposalSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let ContractionSpec::Tanh { parameters: tanh } = spec.beat.contraction else {
        return Err(TaskError::NoProposal("step 1 personalises the Tanh model alone"));
    };
    let start = Step1Parameters { tanh, valves: spec.beat.valves };
    let (passive, activation) = one_fibre(&spec.beat.organ)?;
    // Refused once and for all: an effect that cannot act, a parameter outside the models.
    reduced(&spec.beat, &passive, &activation)?;
    let cheap = |p: &Parameters| match reduced_beat(&with(&spec.beat, &step1::with(&start, p)), &passive, &activation) {
        Ok(Some(beat)) => step1::outcome(&beat),
        Ok(None) | Err(_) => Outcome::Failed,
    };
    let runs: Vec<Run> = (spec.runs.iter())
        .map(|run| Run {
            parameters: step1::parameters(&run.parameters),
            outcome: run.biomarkers.as_ref().map_or(Outcome::Failed, |b| step1::told(b, run.whole_beat)),
            predicted_misfit: run.predicted_misfit,
        })
        .collect();
    let proposal = propose(
        &Problem {
            measured: &step1::biomarkers(&spec.measured),
            runs: &runs,
            initial: &step1::parameters(&start),
            settings: &step1::settings(&spec.bounds, &spec.frozen, &spec.weights),
            expected: EXPECTED,
            seed: spec.seed,
        },
        &cheap,
    );
    let Proposal { parameters, biomarkers, cost, misfit, base, radius, step, correction, cheap_beats } = proposal
        .ok_or(TaskError::NoProposal("no simulation of step 1 ended, nor does a beat of the one-fibre ventricle"))?;
    Ok(TaskResult::Step1Proposal(Step1ProposalResult {
        parameters: step1::with(&start, &parameters),
        predicted: step1::to_schema(&biomarkers),
        predicted_cost: cost,
        predicted_misfit: misfit,
        from_iteration: base.map(|base| base as u32 + 1),
        trust_radius: radius,
        step,
        correction: correction.into_iter().map(|(biomarker, factor)| (biomarker.key().to_owned(), factor)).collect(),
        reduced_beats: cheap_beats as u64,
    }))
}

fn with(beat: &OrganBeatSpec, p: &Step1Parameters) -> OrganBeatSpec {
    OrganBeatSpec { contraction: ContractionSpec::Tanh { parameters: p.tanh }, valves: p.valves, ..beat.clone() }
}

/// The one-fibre ventricle, or that of a finite-element one's volumes, pressure and activation.
fn one_fibre(organ: &OrganSpec) -> Result<(organ::OneFibrePassive, ActivationSpec), TaskError> {
    match organ {
        OrganSpec::Reduced { passive, activation } => Ok((*passive, *activation)),
        OrganSpec::External(organ) => Ok((organ.passive, organ.activation)),
        OrganSpec::FiniteElement(organ) => {
            let figures = &organ.figures;
            let law = OneFibrePassive::through(
                Ml(figures.unloaded_volume_ml),
                Ml(figures.end_diastolic_volume_ml),
                Mmhg(figures.end_diastolic_pressure_mmhg),
                Ml(figures.wall_volume_ml),
                DEFAULT_EXPONENT,
            )
            .map_err(TaskError::PassiveState)?;
            let passive = organ::OneFibrePassive {
                wall_volume_ml: figures.wall_volume_ml,
                unloaded_volume_ml: figures.unloaded_volume_ml,
                end_diastolic_volume_ml: figures.end_diastolic_volume_ml,
                end_diastolic_pressure_mmhg: figures.end_diastolic_pressure_mmhg,
                stiffness_kpa: law.stiffness.0,
                exponent: law.exponent,
            };
            let groups = ActivationSettings::default().groups;
            Ok((passive, ActivationSpec { spread_ms: figures.spread_ms, groups, onset_ms: figures.onset_ms }))
        }
    }
}
