//! What a run would do with each patient, without doing it.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_workflow::patient::{Patient, Step};

use super::EngineError;
use super::transitions::Decider;
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
    let mut world = World::new(run_dir, Writer::look(run_dir).await?, clock::now_ms())?;
    let was_over: Vec<bool> = world
        .patients
        .iter()
        .map(|p| p.row.state.is_final())
        .collect();
    decide_unwritten(&mut world, Some(plans))?;
    let mut foreseen = BTreeMap::new();
    // Patients that the store lacks come after those that it has.
    for (patient, was_over) in world.patients.iter().zip(was_over) {
        if !patient.row.active {
            continue;
        }
        let would = match &patient.row.state {
            Patient::Working { step, .. } if was_over => Foreseen::Redone(*step),
            Patient::Working { step, .. } => Foreseen::GoesOn(*step),
            _ => Foreseen::Stays,
        };
        foreseen.insert(PatientId(patient.row.patient.clone()), would);
    }
    Ok(foreseen)
}

/// Takes plans up and decides for every patient of the mirror, which is thrown away afterwards: nothing is committed.
pub(super) fn decide_unwritten(
    world: &mut World,
    plans: Option<&[ResolvedPatient]>,
) -> Result<(), EngineError> {
    let mut decider = Decider::default();
    if let Some(plans) = plans {
        decider.take_up(world, plans)?;
    }
    for i in 0..world.patients.len() {
        world.patients[i].selected = world.patients[i].row.active;
        world.await_present_task(i);
        decider.decide(world, i)?;
    }
    Ok(())
}
