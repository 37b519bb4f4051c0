//! Choice of the pilots, and what follows when the last of them has ended.

use std::collections::HashSet;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::status::RefusedPatient;
use cardiotwin_store::pilots::Pilots;
use cardiotwin_workflow::patient::{Patient, PatientEvent};
use cardiotwin_workflow::pilots::choose;

use super::Decider;
use crate::EngineError;
use crate::books::Books;

/// Decides the chains of all patients again who learn from pilots.
fn replan_pupils(books: &mut Books) -> Result<(), EngineError> {
    for i in 0..books.patients().len() {
        if books.patient(i).row.active && books.is_pupil(i)? {
            learn_anew(books, i)?;
        }
    }
    Ok(())
}

fn learn_anew(books: &mut Books, i: usize) -> Result<(), EngineError> {
    if matches!(books.patient(i).row.state, Patient::Cancelled { .. }) {
        return Ok(());
    }
    books.plan_changed(i);
    let reason = "the organ's law is learned from pilots".to_owned();
    books.patient_event(i, PatientEvent::Replan { reason })
}

impl Decider {
    /// Chooses the run's pilots by name alone, or keeps those that were chosen. Pilots whose tasks
    /// have changed teach again.
    ///
    /// - `refused`: patients whose files have errors; those who were chosen before stay pilots
    /// - `changed`: patients whose plans lead to other tasks than before
    pub(super) fn choose_pilots(
        &mut self,
        books: &mut Books,
        plans: &[ResolvedPatient],
        refused: &[RefusedPatient],
        changed: &HashSet<&PatientId>,
    ) -> Result<(), EngineError> {
        let of_plans = plans.iter().map(ResolvedPatient::n_pilots);
        let Some(n) = of_plans.max().filter(|n| *n > 0) else {
            // The choice stays for a later run with pilots.
            return Ok(());
        };
        let before = books.pilots().clone();
        let candidates = || (plans.iter()).filter(|p| p.n_pilots() > 0).map(|p| &p.id);
        let names = if before.n != n {
            choose(n, candidates())
        } else if books.has_lessons() {
            // They have taught, even those that have left the cohort.
            before.names.clone()
        } else {
            let stays = |name: &&PatientId| {
                let is_refused = refused.iter().any(|one| one.patient == name.as_str());
                is_refused || candidates().any(|id| id == *name)
            };
            let kept: Vec<PatientId> = before.names.iter().filter(stays).cloned().collect();
            let room = n.saturating_sub(u32::try_from(kept.len()).unwrap_or(n));
            let others = candidates().filter(|id| !kept.contains(id));
            let mut names = choose(room, others);
            names.extend(kept);
            names.sort();
            names
        };
        let has_changed = names.iter().any(|name| changed.contains(name));
        if (before.n, &before.names) == (n, &names) && !(has_changed && books.has_lessons()) {
            return Ok(());
        }
        let was = |i: usize, books: &Books| {
            let name = &books.patient(i).row.status.patient;
            before.names.iter().any(|pilot| pilot.as_str() == name)
        };
        books.set_pilots(Pilots { n, names });
        let turned: Vec<usize> = (0..books.patients().len())
            .filter(|i| was(*i, books) != books.is_pilot(*i))
            .collect();
        for i in turned {
            learn_anew(books, i)?;
        }
        books.set_lessons(None);
        replan_pupils(books)
    }

    /// Lets the pilots teach again: their beats may be others.
    pub(super) fn forget_lessons(&mut self, books: &mut Books) -> Result<(), EngineError> {
        if !books.has_lessons() {
            return Ok(());
        }
        books.set_lessons(None);
        for i in 0..books.patients().len() {
            if books.is_pupil(i)? {
                self.reopen(books, i);
            }
        }
        replan_pupils(books)
    }

    /// Decides for the patients who wait for pilots, if all pilots have ended.
    pub(super) fn teach(&mut self, books: &mut Books) -> Result<(), EngineError> {
        if !books.gather_lessons()? {
            return Ok(());
        }
        for i in 0..books.patients().len() {
            let is_idle = matches!(
                books.patient(i).row.state,
                Patient::Waiting | Patient::Deciding { .. }
            );
            if is_idle && books.is_pupil(i)? {
                self.decide(books, i)?;
            }
        }
        Ok(())
    }
}
