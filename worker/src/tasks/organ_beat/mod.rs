//! Simulation of the organ: an iteration of step 1, or the verification beat.
//!
//! Artefacts: `traces.csv` (pressures, volume, flows) and `nodal.csv` (see [`crate::nodal`]). A
//! simulation that diverges leaves its traces up to that time.

mod circuit;
mod external;
mod finite_element;
mod late_sector;
pub(crate) mod models;
mod potentials;
mod result;

use std::collections::BTreeMap;

use cardiotwin_models::beat::{BeatOutcome, BeatTraces};
use cardiotwin_schemas::organ::OrganSpec;
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult};
use cardiotwin_schemas::task::OrganBeatSpec;

use self::circuit::beats_of;
use self::result::{ending, organ_beat_result};
use crate::context::Context;
use crate::error::TaskError;
use crate::finite_element::stored::About;
use crate::team::Team;

pub use self::models::{ReducedOrgan, reduced};
pub(crate) use self::result::samples;
pub use self::result::simulated_biomarkers;

/// Takes part in a 3D beat of rank 0 of `team`.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models or does not match the
/// ventricle's file.
pub(crate) fn serve(spec: &OrganBeatSpec, about: &About, team: &Team) -> Result<(), TaskError> {
    match &spec.organ {
        OrganSpec::Reduced { .. } | OrganSpec::External(_) => Ok(()),
        OrganSpec::FiniteElement(organ) => finite_element::serve(spec, organ, about, team),
    }
}

/// Runs the simulation and checks it.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models or files cannot be
/// written.
pub fn run(spec: &OrganBeatSpec, context: &mut Context) -> Result<Ending, TaskError> {
    context.check_stop()?;
    let is_external = matches!(spec.organ, OrganSpec::External(_));
    if spec.circulation.closed.is_some() && is_external {
        return Err(TaskError::ClosedLoop);
    }
    match &spec.organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => run_reduced(
            spec,
            &ReducedOrgan::one_fibre(*passive, *activation),
            context,
        ),
        OrganSpec::FiniteElement(organ) => finite_element::run(spec, organ, context),
        OrganSpec::External(organ) => external::run(spec, organ, context),
    }
}

/// Runs the simulation in a reduced ventricle in place of the specification's organ.
///
/// # Errors
/// Same as for [`run`].
pub fn run_reduced(
    spec: &OrganBeatSpec,
    organ: &ReducedOrgan,
    context: &mut Context,
) -> Result<Ending, TaskError> {
    context.progress.report("simulating", 0.0, None, || {
        format!("{} ms cycle", spec.cycle_length_ms)
    });
    let (outcome, seen) = beats_of(spec, organ, true)?;
    ending(spec, outcome, BTreeMap::new(), seen, context)
}

/// A beat of the reduced ventricle without artefacts, for searches that need many beats; `None`
/// if it diverges.
///
/// # Errors
/// Same as for [`run`].
pub fn reduced_beat(
    spec: &OrganBeatSpec,
    organ: &ReducedOrgan,
) -> Result<Option<OrganBeatResult>, TaskError> {
    let (outcome, seen) = beats_of(spec, organ, false)?;
    match outcome {
        BeatOutcome::Finished(result) => organ_beat_result(spec, &result, seen).map(Some),
        BeatOutcome::Diverged { .. } => Ok(None),
    }
}

/// A beat of the reduced ventricle with its traces and those of its groups, without artefacts.
///
/// # Errors
/// Same as for [`run`]; [`TaskError::Diverged`] if the beat diverges.
pub fn reduced_beat_with_traces(
    spec: &OrganBeatSpec,
    organ: &ReducedOrgan,
) -> Result<(OrganBeatResult, BeatTraces), TaskError> {
    let (outcome, seen) = beats_of(spec, organ, true)?;
    match outcome {
        BeatOutcome::Finished(result) => {
            let read = organ_beat_result(spec, &result, seen)?;
            Ok((read, result.traces))
        }
        BeatOutcome::Diverged { t, reason, .. } => Err(TaskError::Diverged {
            last_good_ms: t.0,
            source: reason,
        }),
    }
}
