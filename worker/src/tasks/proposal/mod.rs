//! Proposals for the next simulation, from the one-fibre ventricle as a surrogate of the simulated
//! organ.

pub mod axes;
pub mod step1;
pub mod step3;

use cardiotwin_calibrate::fixed_point::Outcome;
use cardiotwin_calibrate::space_mapping::Proposal;
use cardiotwin_models::ventricle::PassiveLaw as _;
use cardiotwin_models::ventricle::passive_state::DEFAULT_EXPONENT;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::{ActivationSpec, OneFibrePassive, OrganSpec};
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::settings::{ActivationSettings, SolverSettings};
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use cardiotwin_units::{Ml, Mmhg};
use std::collections::BTreeMap;

use crate::error::TaskError;

/// Replaces the organ of a beat by the one-fibre ventricle; other tasks are returned unchanged.
///
/// # Errors
/// [`TaskError`] when the organ's figures are outside the range of the model.
pub fn in_one_fibre(task: TaskSpec) -> Result<TaskSpec, TaskError> {
    let TaskSpec::OrganBeat(beat) = task else {
        return Ok(task);
    };
    let (passive, activation) = one_fibre(&beat.organ)?;
    let organ = OrganSpec::Reduced {
        passive,
        activation,
    };
    // The budget of a finite-element ventricle does not apply to this one.
    let SolverSettings {
        newton_iterations,
        shortest_step_ms,
        ..
    } = SolverSettings::default();
    let beat = OrganBeatSpec {
        organ,
        newton_iterations,
        shortest_step_ms,
        finite_element: None,
        ..*beat
    };
    Ok(TaskSpec::OrganBeat(Box::new(beat)))
}

/// The one-fibre ventricle of the organ, or the one with a finite-element ventricle's volumes,
/// pressure and activation.
pub(crate) fn one_fibre(organ: &OrganSpec) -> Result<(OneFibrePassive, ActivationSpec), TaskError> {
    match organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => Ok((*passive, *activation)),
        OrganSpec::External(organ) => Ok((organ.passive, organ.activation)),
        OrganSpec::FiniteElement(organ) => {
            let figures = &organ.figures;
            let passive = OneFibrePassive::through(
                Ml(figures.unloaded_volume_ml),
                Ml(figures.end_diastolic_volume_ml),
                Mmhg(figures.end_diastolic_pressure_mmhg),
                Ml(figures.wall_volume_ml),
                DEFAULT_EXPONENT,
            )
            .map_err(TaskError::PassiveState)?;
            let groups = ActivationSettings::default().groups;
            Ok((
                passive,
                ActivationSpec {
                    spread_ms: figures.spread_ms,
                    groups,
                    onset_ms: figures.onset_ms,
                },
            ))
        }
    }
}

/// Outcome of a beat, judged by its checks; a failure if there is no beat.
#[must_use]
pub fn outcome(beat: Option<&OrganBeatResult>) -> Outcome {
    match beat {
        Some(beat) if beat.failed_simulation().is_none() => {
            Outcome::of(&beat.biomarkers, beat.failed_valve().is_none())
        }
        _ => Outcome::Failed,
    }
}

/// Outcome of an earlier run from its biomarkers; a failure if there are none.
fn told(biomarkers: Option<&Biomarkers>, is_whole_beat: bool) -> Outcome {
    biomarkers.map_or(Outcome::Failed, |b| Outcome::of(b, is_whole_beat))
}

/// Correction factors of the surrogate's biomarkers at a proposal's base, by key.
fn factors(proposal: &Proposal) -> BTreeMap<String, f64> {
    proposal
        .correction
        .iter()
        .map(|(biomarker, factor)| (biomarker.key().to_owned(), *factor))
        .collect()
}
