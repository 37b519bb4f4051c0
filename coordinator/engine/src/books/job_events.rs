//! Effects of jobs on the mirror: their state machines, the patients placed in them, the attempts
//! that they began.

use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_store::cluster_jobs::{Allotment, JobRow, JobSpec, SeenElement};
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::attempt::{Attempt, AttemptEvent};
use cardiotwin_workflow::cluster_job::{ClusterJob, Element, JobAction, JobEvent};
use cardiotwin_workflow::task::Task;
use serde_json::json;

use super::Books;
use crate::EngineError;

impl Books {
    /// Adds a job, whose name must be committed before the scheduler receives it.
    pub fn intend_job(&mut self, name: String, spec: JobSpec) {
        let n_elements = spec.elements.len();
        let row = JobRow {
            version: 1,
            over: false,
            state: ClusterJob::intended(n_elements),
            seen: vec![SeenElement::default(); n_elements],
            intended_ms: self.now_ms,
            spec,
            name: name.clone(),
        };
        self.jobs.insert_fresh(row);
        self.touch_placed(&name, None);
        self.put_action(Action::SubmitJob { job: name });
    }

    /// Feeds an event to a job's machine.
    pub fn job_event(&mut self, name: &str, event: JobEvent) -> Result<(), EngineError> {
        let Some(row) = self.jobs.rows.get_mut(name) else {
            return Ok(());
        };
        let (state, actions) = row.state.clone().on(event.clone())?;
        if state == row.state && actions.is_empty() {
            return Ok(());
        }
        row.state = state;
        let element = match &event {
            JobEvent::Cancel { element }
            | JobEvent::GiveUp { element }
            | JobEvent::Seen { element, .. }
            | JobEvent::Vanished { element, .. }
            | JobEvent::Ended { element, .. } => Some(*element),
            JobEvent::Accepted { .. }
            | JobEvent::Refused { .. }
            | JobEvent::Doubt { .. }
            | JobEvent::Absent => None,
        };
        self.log("job", None, None, &json!({ "job": name, "event": event }));
        self.jobs.touch(name);
        self.touch_placed(name, element);
        for action in actions {
            let job = name.to_owned();
            self.put_action(match action {
                JobAction::Fence(element) => Action::FenceJob { job, element },
                JobAction::Cancel(element) => Action::CancelJob { job, element },
            });
        }
        Ok(())
    }

    /// Resets a patient's allotment after its plan changed: its job is stale, and spent retries
    /// belonged to other tasks.
    pub fn plan_changed(&mut self, i: usize) {
        let patient_id = self.patients[i].row.id;
        let plans = self.jobs.allotment(patient_id).plans + 1;
        self.jobs.set_allotment(
            patient_id,
            Allotment {
                plans,
                ..Allotment::default()
            },
        );
    }

    /// Marks the patients of a job, or of one element of it, because their rows show the state of
    /// the job.
    pub fn touch_placed(&mut self, name: &str, element: Option<usize>) {
        let Some(row) = self.jobs.rows.get(name) else {
            return;
        };
        let lists = row
            .spec
            .elements
            .iter()
            .enumerate()
            .filter(|(i, _)| element.is_none_or(|element| *i == element));
        let patients: Vec<usize> = lists
            .flat_map(|(_, list)| list)
            .filter_map(|placed| self.by_id.get(&placed.patient_id).copied())
            .collect();
        patients.into_iter().for_each(|i| self.touch(i));
    }

    /// Frees the patients of an element whose end was dealt with.
    pub fn element_settled(&mut self, name: &str, element: usize) {
        self.jobs.see(name, element, |seen| seen.settled = true);
        let Some(row) = self.jobs.rows.get_mut(name) else {
            return;
        };
        row.over = row.state.is_over() && row.seen.iter().all(|seen| seen.settled);
        let here = |place: &(String, usize)| place.0 == name && place.1 == element;
        let patients = row.spec.elements.get(element).cloned().unwrap_or_default();
        for placed in patients {
            if self.jobs.placed.get(&placed.patient_id).is_some_and(here) {
                self.jobs.placed.remove(&placed.patient_id);
            }
            if let Some(&i) = self.by_id.get(&placed.patient_id) {
                self.touch(i);
            }
        }
    }

    /// Begins an attempt that a job has begun already: as [`Books::begin`], without a submission.
    pub fn begin_found(
        &mut self,
        key: &TaskKey,
        generation: u32,
    ) -> Result<AttemptId, EngineError> {
        debug_assert!(
            matches!(self.tasks[key].state, Task::Open { generation: g, .. } if g + 1 == generation)
        );
        let id = self.begin(key)?;
        self.drop_submission(&id);
        Ok(id)
    }

    /// Records that a job's attempt was seen to have begun.
    pub fn attempt_seen(&mut self, id: &AttemptId, external: &str) -> Result<(), EngineError> {
        let accepted = AttemptEvent::Accepted {
            id: external.into(),
        };
        match self.attempts.get(id).map(|attempt| &attempt.state) {
            Some(Attempt::Submitting | Attempt::Unknown { .. }) => self.attempt_event(id, accepted),
            _ => Ok(()),
        }
    }

    /// Elements of jobs that are not over.
    pub fn elements_at_work(&self) -> Vec<(String, usize)> {
        let rows = self.jobs.rows.values();
        rows.flat_map(|row| {
            let alive =
                |element: &usize| !matches!(row.state.elements[*element], Element::Over { .. });
            (0..row.spec.elements.len())
                .filter(alive)
                .map(|element| (row.name.clone(), element))
        })
        .collect()
    }
}
