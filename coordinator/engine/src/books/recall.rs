//! What leaves memory when a patient is over, and comes back from the store when it is asked for.
//!
//! Outcomes are most of a run's bytes. A patient that is over needs none of them, except to teach
//! others. A decision that asks for one notes it as absent, and is made again once the loop has
//! read it.

use std::collections::BTreeSet;
use std::sync::PoisonError;

use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_store::Writer;
use cardiotwin_store::tasks::OutcomeRow;

use super::Books;
use crate::EngineError;

impl Books {
    /// Notes a task whose outcome is asked for and only in the store.
    pub(super) fn note_absent(&self, key: &TaskKey) {
        self.absent().insert(key.clone());
    }

    /// Whether an outcome was asked for that is only in the store.
    pub fn has_absent(&self) -> bool {
        !self.absent().is_empty()
    }

    /// Tasks whose outcomes were asked for and are only in the store.
    pub fn take_absent(&self) -> BTreeSet<TaskKey> {
        std::mem::take(&mut *self.absent())
    }

    fn absent(&self) -> std::sync::MutexGuard<'_, BTreeSet<TaskKey>> {
        self.absent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tasks of a patient's steps whose outcomes are only in the store.
    pub fn absent_of(&self, i: usize) -> Vec<TaskKey> {
        let keys = self.patients[i].steps.values();
        let is_absent = |key: &&TaskKey| self.tasks.get(key).is_some_and(|task| task.is_absent());
        keys.filter(is_absent).cloned().collect()
    }

    /// Reads the outcomes of tasks from the store.
    pub async fn recall(
        &mut self,
        writer: &mut Writer,
        keys: &[TaskKey],
    ) -> Result<(), EngineError> {
        if keys.is_empty() {
            return Ok(());
        }
        for OutcomeRow { key, outcome, .. } in writer.outcomes(keys).await? {
            let Some(task) = self.tasks.get_mut(&TaskKey(key)) else {
                continue;
            };
            match outcome {
                Some(text) => task.recall(text),
                None => task.has_outcome = false,
            }
        }
        Ok(())
    }

    /// Reads the outcomes of a patient's tasks from the store.
    pub async fn recall_patient(
        &mut self,
        writer: &mut Writer,
        patient_id: i64,
    ) -> Result<(), EngineError> {
        let Some(i) = self.by_id(patient_id) else {
            return Ok(());
        };
        let absent = self.absent_of(i);
        if absent.is_empty() {
            return Ok(());
        }
        self.recall(writer, &absent).await?;
        self.leaving.push(i);
        Ok(())
    }

    /// Leaves the outcomes of a patient that is over to the store, unless it teaches others or has
    /// changes that are not committed.
    pub fn leave(&mut self, i: usize) {
        let patient = &self.patients[i];
        let stays = !patient.row.state.is_final() || self.is_pilot(i);
        if stays || self.dirty_patients.contains(&i) {
            return;
        }
        let patient = &mut self.patients[i];
        patient.plan.take();
        for key in patient.steps.values() {
            if let Some(task) = self.tasks.get_mut(key) {
                task.leave();
            }
        }
    }

    /// Takes the wall times from outcomes that stay in the store.
    pub fn note_wall_times(&mut self, rows: Vec<OutcomeRow>) {
        for OutcomeRow { key, outcome, .. } in rows {
            let Some(task) = self.tasks.get_mut(&TaskKey(key)) else {
                continue;
            };
            let read =
                |text: String| OUTCOME.read::<TaskOutcome>(&"tasks.outcome", text.as_bytes());
            if let Some(Ok(outcome)) = outcome.map(read) {
                task.wall_s = Some(outcome.provenance.wall_s);
            }
        }
    }
}
