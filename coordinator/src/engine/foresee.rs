//! What a run would do with each patient, without doing it.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_workflow::patient::{Patient, Step};

use super::EngineError;
use super::decide::Decider;
use super::world::World;
use crate::clock;
use crate::store::Writer;

/// What would become of a patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Foreseen {
    /// It is over and stays so.
    Stays,
    /// It was over, and this is the first task that is wanted again.
    Redone(Step),
    /// It goes on with this task.
    GoesOn(Step),
}

/// Decides for every patient as a run would, by the keys of the tasks, and writes nothing; without patients where there is no
/// run.
///
/// # Errors
/// The store's; a plan that cannot be read.
pub async fn foresee(
    run_dir: &Path,
    plans: &[ResolvedPatient],
) -> Result<BTreeMap<PatientId, Foreseen>, EngineError> {
    let loaded = Writer::look(run_dir).await?;
    let mut world = World::new(run_dir, loaded, clock::now_ms())?;
    let n_stored = world.patients.len();
    let was_over: Vec<bool> = world
        .patients
        .iter()
        .map(|p| p.row.state.is_final())
        .collect();
    let mut decider = Decider::default();
    decider.take_up(&mut world, plans)?;
    let mut foreseen = BTreeMap::new();
    for (i, was_over) in was_over.into_iter().enumerate().take(n_stored) {
        if !world.patients[i].row.active {
            continue;
        }
        world.patients[i].selected = true;
        world.await_present_task(i);
        decider.decide(&mut world, i)?;
        let row = &world.patients[i].row;
        let would = match &row.state {
            Patient::Working { step, .. } if was_over => Foreseen::Redone(*step),
            Patient::Working { step, .. } => Foreseen::GoesOn(*step),
            _ => Foreseen::Stays,
        };
        foreseen.insert(PatientId(row.patient.clone()), would);
    }
    Ok(foreseen)
}
