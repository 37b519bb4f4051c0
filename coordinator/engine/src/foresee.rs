//! Predicts what a run would do with each patient, without doing it.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_store::Writer;
use cardiotwin_store::clock;
use cardiotwin_workflow::patient::{Patient, Stage, Step};

use super::EngineError;
use super::books::Books;
use super::decider::Decider;

/// Effect that a run would have on a patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Foreseen {
    /// The patient is over and stays so.
    Stays,
    /// The patient was over; this is the first task that would be computed again.
    Redone(Step),
    /// The patient continues with this task.
    GoesOn(Step),
    /// The patient waits for pilots.
    Waits,
}

/// Decides for every patient as a run would, by the keys of the tasks, and writes nothing. Without
/// an existing run the answer is empty.
///
/// # Errors
/// [`EngineError`] if the store or a plan cannot be read.
pub async fn foresee(
    run_dir: &Path,
    plans: &[ResolvedPatient],
) -> Result<BTreeMap<PatientId, Foreseen>, EngineError> {
    let mut books = Books::new(run_dir, Writer::look(run_dir).await?, clock::now_ms())?;
    let was_over: Vec<bool> = books
        .patients()
        .iter()
        .map(|p| p.row.state.is_final())
        .collect();
    decide_unwritten(&mut books, Some(plans))?;
    let mut foreseen = BTreeMap::new();
    // Patients that are new to the store come after the stored ones and are not part of the answer.
    for (patient, was_over) in books.patients().iter().zip(was_over) {
        if !patient.row.active {
            continue;
        }
        let would = match &patient.row.state {
            Patient::Working { step, .. } if was_over => Foreseen::Redone(*step),
            // It waits for pilots first.
            Patient::Waiting | Patient::Deciding { .. } if was_over => {
                Foreseen::Redone(Step::only(Stage::LearnLaw))
            }
            Patient::Working { step, .. } => Foreseen::GoesOn(*step),
            Patient::Waiting | Patient::Deciding { .. } => Foreseen::Waits,
            _ => Foreseen::Stays,
        };
        foreseen.insert(PatientId(patient.row.status.patient.clone()), would);
    }
    Ok(foreseen)
}

/// Takes plans up and decides for every patient of the in-memory mirror. Nothing is committed, so
/// the mirror must be dropped afterwards.
pub(super) fn decide_unwritten(
    books: &mut Books,
    plans: Option<&[ResolvedPatient]>,
) -> Result<(), EngineError> {
    let mut decider = Decider::default();
    if let Some(plans) = plans {
        decider.take_up(books, plans, &[], &[])?;
    }
    books.select(|_| true);
    for i in 0..books.patients().len() {
        books.await_present_task(i);
        decider.decide(books, i)?;
    }
    decider.look_and_answer(books)
}
