//! Proposals for the next simulation, from the one-fibre ventricle as a surrogate of the simulated
//! organ.

pub mod axes;
pub mod learned;
pub mod step1;
pub mod step3;

use cardiotwin_calibrate::fixed_point::Outcome;
use cardiotwin_calibrate::space_mapping::Proposal;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::organ_law::{LawKnowledge, LawSamples};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult};
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use std::collections::BTreeMap;

use crate::context::Context;
use crate::error::TaskError;
use crate::tasks::organ_beat::{ReducedOrgan, run_reduced};
use crate::tasks::surrogate::{known_surrogate, one_fibre, with_reduced_budget};

/// Replaces the organ of a beat by the one-fibre ventricle; other tasks are returned unchanged.
///
/// # Errors
/// [`TaskError`] when the organ's figures are outside the range of the model.
pub fn in_one_fibre(task: TaskSpec) -> Result<TaskSpec, TaskError> {
    let TaskSpec::OrganBeat(beat) = task else {
        return Ok(task);
    };
    let ReducedOrgan {
        passive,
        activation,
        ..
    } = one_fibre(&beat.organ)?;
    let organ = OrganSpec::Reduced {
        passive,
        activation,
    };
    let beat = OrganBeatSpec {
        organ,
        ..with_reduced_budget(&beat)
    };
    Ok(TaskSpec::OrganBeat(Box::new(beat)))
}

/// Simulates a beat in its organ's law.
pub(crate) fn in_law(beat: &OrganBeatSpec, known: &LawKnowledge, context: &mut Context) -> Ending {
    known_surrogate(beat, Some(known))
        .and_then(|organ| run_reduced(&with_reduced_budget(beat), &organ, context))
        .unwrap_or_else(TaskError::into_ending)
}

/// Number of beats from which a surrogate's law was learned; `None` for the one-fibre ventricle.
fn law_beats(organ: &ReducedOrgan, beats: Option<&[LawSamples]>) -> Option<u32> {
    organ.law.as_ref()?;
    beats.map(|beats| beats.len() as u32)
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
