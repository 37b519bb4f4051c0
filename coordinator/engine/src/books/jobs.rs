//! Jobs of a cluster as the engine keeps them between commits.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use cardiotwin_schemas::status::{JobState, PatientState};

use cardiotwin_store::Batch;
use cardiotwin_store::cluster_jobs::{Allotment, AllotmentRow, JobRow, SeenElement, id_text};

/// Jobs in the in-memory mirror.
#[derive(Debug, Default)]
pub struct Jobs {
    /// Jobs that are not over, by name.
    pub(super) rows: BTreeMap<String, JobRow>,
    /// Job and element in which a patient is placed, by the patient's row id.
    pub(super) placed: HashMap<i64, (String, usize)>,
    /// Resources and spent retries for patients' next jobs, by the patient's row id.
    allotments: HashMap<i64, Allotment>,
    /// Reason for which nothing is submitted at present, shown with the waiting patients.
    holds: Option<String>,
    /// Whether patients are placed in jobs, instead of tasks in workers of this machine.
    places: bool,
    fresh: BTreeSet<String>,
    dirty: BTreeSet<String>,
    dirty_allotments: BTreeSet<i64>,
}

impl Jobs {
    /// Jobs and allotments as the store holds them.
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

    /// Jobs that are not over, by name.
    pub fn rows(&self) -> &BTreeMap<String, JobRow> {
        &self.rows
    }

    /// Job and element in which a patient is placed, by the patient's row id.
    pub fn placed(&self) -> &HashMap<i64, (String, usize)> {
        &self.placed
    }

    /// Reason for which nothing is submitted at present.
    pub fn holds(&self) -> Option<&str> {
        self.holds.as_deref()
    }

    pub fn set_holds(&mut self, holds: Option<String>) {
        self.holds = holds;
    }

    /// Whether patients are placed in jobs.
    pub fn places_patients(&self) -> bool {
        self.places
    }

    /// From now on, patients are placed in jobs.
    pub fn place_patients(&mut self) {
        self.places = true;
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

    /// Allotment for a patient's next job; the default if none is stored.
    pub fn allotment(&self, patient_id: i64) -> Allotment {
        self.allotments
            .get(&patient_id)
            .cloned()
            .unwrap_or_default()
    }

    /// Changes a patient's allotment.
    pub fn set_allotment(&mut self, patient_id: i64, allotment: Allotment) {
        if self.allotments.get(&patient_id) != Some(&allotment) {
            self.allotments.insert(patient_id, allotment);
            self.dirty_allotments.insert(patient_id);
        }
    }

    /// Changes what was seen of an element. Returns whether this made a difference.
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

    /// State of a patient in a job, and a note.
    pub fn note(&self, patient_id: i64) -> Option<(PatientState, String)> {
        let (name, element) = self.placed.get(&patient_id)?;
        let row = self.rows.get(name)?;
        let id = id_text(row, *element);
        let why = row
            .seen
            .get(*element)
            .map(|seen| seen.why.as_str())
            .unwrap_or_default();
        Some(match row.state.shown(*element) {
            JobState::Running => (PatientState::Running, format!("in job {id}")),
            JobState::Unknown => (PatientState::Unknown, format!("job {id}: {why}")),
            state if why.is_empty() => (PatientState::Waiting, format!("job {id}: {state}")),
            state => (PatientState::Waiting, format!("job {id} {state}: {why}")),
        })
    }

    /// Adds a job that the store does not hold yet.
    pub fn insert_fresh(&mut self, row: JobRow) {
        self.place(&row);
        self.fresh.insert(row.name.clone());
        self.rows.insert(row.name.clone(), row);
    }

    /// Marks a job's row as changed.
    pub fn touch(&mut self, name: &str) {
        self.dirty.insert(name.to_owned());
    }

    /// Moves changed rows into a batch, and drops jobs that are over.
    pub fn flush(&mut self, batch: &mut Batch) {
        for name in std::mem::take(&mut self.fresh) {
            if let Some(row) = self.rows.get(&name) {
                batch.insert_job(row);
                self.dirty.remove(&name);
            }
        }
        for name in std::mem::take(&mut self.dirty) {
            let Some(row) = self.rows.get_mut(&name) else {
                continue;
            };
            batch.update_job(row);
            row.version += 1;
            if row.over {
                self.rows.remove(&name);
            }
        }
        for patient_id in std::mem::take(&mut self.dirty_allotments) {
            batch.put_allotment(&AllotmentRow {
                patient_id,
                allotment: &self.allotments[&patient_id],
            });
        }
    }
}
