//! Patients that wait for a place in a job.

use std::collections::HashSet;

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use crate::books::Books;

/// Whether a patient waits for a place in a job.
pub fn wants_place(books: &Books, i: usize) -> bool {
    let patient = books.patient(i);
    let open = |key: &TaskKey| {
        books
            .task(key)
            .is_some_and(|task| matches!(task.state, Task::Open { .. }))
    };
    patient.selected
        // A patient who has to wait for pilots takes no place, not even for step 0: its job would
        // end after that, and the patient would queue again.
        && !books.awaits_pilots(i).unwrap_or(false)
        && !books.jobs().placed().contains_key(&patient.row.id)
        && present_task(books, i).is_some_and(|key| open(&key))
}

/// Task that a patient waits for.
pub fn present_task(books: &Books, i: usize) -> Option<TaskKey> {
    match &books.patient(i).row.state {
        Patient::Working { task, .. } => Some(task.clone()),
        _ => None,
    }
}

/// Patients that want a place, one per task: patients that want the same task wait for the same
/// job.
pub fn waiting(books: &Books) -> Vec<usize> {
    let is_placed = |i: &usize| {
        books
            .jobs()
            .placed()
            .contains_key(&books.patient(*i).row.id)
    };
    let placed = (0..books.patients().len()).filter(is_placed);
    let mut tasks: HashSet<TaskKey> = placed.filter_map(|i| present_task(books, i)).collect();
    let mut waiting: Vec<usize> = (0..books.patients().len())
        .filter(|i| wants_place(books, *i))
        .collect();
    waiting.sort_by_key(|i| books.patient(*i).row.position);
    waiting.retain(|i| present_task(books, *i).is_some_and(|key| tasks.insert(key)));
    waiting
}
