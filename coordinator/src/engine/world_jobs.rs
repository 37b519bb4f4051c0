//! The cluster's part of the mirror: jobs, what patients' next jobs are given, attempts that a job began.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_workflow::attempt::{Attempt, AttemptEvent};
use cardiotwin_workflow::cluster_job::{ClusterJob, Element, JobAction, JobEvent};
use cardiotwin_workflow::task::Task;
use serde_json::json;

use super::EngineError;
use super::world::World;
use crate::store::Batch;
use crate::store::cluster_jobs::{Allotment, AllotmentRow, JobRow, JobSpec, SeenElement, id_text};
use crate::store::outbox::Action;

/// Jobs as the mirror keeps them.
#[derive(Debug, Default)]
pub struct Jobs {
    /// Those that are not over, by name.
    pub rows: BTreeMap<String, JobRow>,
    /// Where a patient is: job and element.
    pub placed: HashMap<i64, (String, usize)>,
    /// What patients' next jobs are given.
    pub allotments: HashMap<i64, Allotment>,
    /// Why nothing is submitted at present, for those who wait.
    pub holds: Option<String>,
    fresh: BTreeSet<String>,
    dirty: BTreeSet<String>,
    dirty_allotments: BTreeSet<i64>,
}

impl Jobs {
    /// From what the store holds.
    pub fn new(rows: Vec<JobRow>, allotments: HashMap<i64, Allotment>) -> Self {
        let mut jobs = Self {
            allotments,
            ..Self::default()
        };
        for row in rows {
            jobs.place(&row);
            jobs.rows.insert(row.name.clone(), row);
        }
        jobs
    }

    fn place(&mut self, row: &JobRow) {
        for (element, patients) in row.spec.elements.iter().enumerate() {
            if !row.seen.get(element).is_some_and(|seen| seen.settled) {
                self.placed.extend(
                    patients
                        .iter()
                        .map(|p| (p.patient_id, (row.name.clone(), element))),
                );
            }
        }
    }

    /// What a patient's next job is given.
    pub fn allotment(&self, patient_id: i64) -> Allotment {
        self.allotments
            .get(&patient_id)
            .cloned()
            .unwrap_or_default()
    }

    /// Changes it.
    pub fn set_allotment(&mut self, patient_id: i64, allotment: Allotment) {
        if self.allotments.get(&patient_id) != Some(&allotment) {
            self.allotments.insert(patient_id, allotment);
            self.dirty_allotments.insert(patient_id);
        }
    }

    /// What was seen of an element; tells whether it is news.
    pub fn see(
        &mut self,
        name: &str,
        element: usize,
        change: impl FnOnce(&mut SeenElement),
    ) -> bool {
        let Some(seen) = self
            .rows
            .get_mut(name)
            .and_then(|row| row.seen.get_mut(element))
        else {
            return false;
        };
        let before = seen.clone();
        change(seen);
        let news = *seen != before;
        if news {
            self.dirty.insert(name.to_owned());
        }
        news
    }

    /// How a patient stands with its job, in a word and a note.
    pub fn note(&self, patient_id: i64) -> Option<(&'static str, String)> {
        let (name, element) = self.placed.get(&patient_id)?;
        let row = self.rows.get(name)?;
        let id = id_text(row, *element);
        let why = row
            .seen
            .get(*element)
            .map(|seen| seen.why.as_str())
            .unwrap_or_default();
        Some(match row.state.word(*element) {
            "running" => ("running", format!("in job {id}")),
            "unknown" => ("unknown", format!("job {id}: {why}")),
            word if why.is_empty() => ("waiting", format!("job {id}: {word}")),
            word => ("waiting", format!("job {id} {word}: {why}")),
        })
    }
}

impl World {
    /// A job whose name is to be durable before the scheduler hears of it.
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
        self.jobs.place(&row);
        self.jobs.rows.insert(name.clone(), row);
        self.touch_placed(&name, None);
        self.jobs.fresh.insert(name.clone());
        self.put_action(Action::SubmitJob { job: name });
    }

    /// Feeds a job's machine.
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
        self.jobs.dirty.insert(name.to_owned());
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

    /// A patient's plan leads to other tasks: what its job does is stale, and what it spent was for another one.
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

    /// What `status` shows of the patients of a job, or of one element of it, follows from the job.
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

    /// The end of an element was taken up: its patients are free.
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

    /// An attempt that a job began: as [`World::begin`], but nobody needs to hand it over.
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

    /// An attempt of a job's, seen to have begun.
    pub fn attempt_seen(&mut self, id: &AttemptId, external: &str) -> Result<(), EngineError> {
        let accepted = AttemptEvent::Accepted {
            id: external.into(),
        };
        match self.attempts.get(id).map(|attempt| &attempt.state) {
            Some(Attempt::Submitting | Attempt::Unknown { .. }) => self.attempt_event(id, accepted),
            _ => Ok(()),
        }
    }

    /// Elements of jobs that are not over and whose end was not taken up.
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

    pub(super) fn flush_jobs(&mut self, batch: &mut Batch) {
        for name in std::mem::take(&mut self.jobs.fresh) {
            if let Some(row) = self.jobs.rows.get(&name) {
                batch.insert_job(row);
                self.jobs.dirty.remove(&name);
            }
        }
        for name in std::mem::take(&mut self.jobs.dirty) {
            let Some(row) = self.jobs.rows.get_mut(&name) else {
                continue;
            };
            batch.update_job(row);
            row.version += 1;
            if row.over {
                self.jobs.rows.remove(&name);
            }
        }
        for patient_id in std::mem::take(&mut self.jobs.dirty_allotments) {
            batch.put_allotment(&AllotmentRow {
                patient_id,
                allotment: &self.jobs.allotments[&patient_id],
            });
        }
    }
}
