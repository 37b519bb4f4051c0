//! In-memory mirror of the store, and the only way to change it: an event is fed to a state
//! machine, the event is logged, the row is marked, and the machine's actions go to the outbox.
//! [`Books::flush`] turns the changes into a batch.

mod access;
mod job_events;
mod jobs;
mod pilots;
mod recall;
mod rows;
mod school;
mod show;

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_schemas::outcome::{Ending, TaskOutcome};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::progress::Claim;
use cardiotwin_schemas::status::PatientStatus;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_store::events::NewEvent;
use cardiotwin_store::outbox::{Action, NewAction};
use cardiotwin_store::patients::{ChainRow, PatientRow, PlanRow};
use cardiotwin_store::steps::StepRow;
use cardiotwin_store::{Batch, Loaded};
use cardiotwin_workflow::attempt::{Attempt, AttemptAction, AttemptEvent};
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::derivation::Settled;
use cardiotwin_workflow::patient::{Patient, PatientAction, PatientEvent, Step};
use cardiotwin_workflow::task::{Task, TaskEvent};
use serde::Serialize;

use super::EngineError;
pub use jobs::Jobs;
pub use rows::{AttemptEntry, PatientEntry, TaskEntry};
use school::School;

/// The mirror of all rows.
#[derive(Debug)]
pub struct Books {
    run_dir: PathBuf,
    patients: Vec<PatientEntry>,
    by_name: HashMap<String, usize>,
    tasks: HashMap<TaskKey, TaskEntry>,
    attempts: HashMap<AttemptId, AttemptEntry>,
    /// Open tasks with waiting patients, by position in the cohort: the first patients finish
    /// first.
    ready: BTreeSet<(i64, TaskKey)>,
    /// Actions of committed batches that are still to be executed, oldest first.
    outbox: Vec<(i64, Action)>,
    /// Jobs of a cluster.
    jobs: Jobs,
    /// Patients who teach others.
    school: School,
    by_id: HashMap<i64, usize>,
    allocation: i64,
    now_ms: i64,
    fresh_actions: Vec<Action>,
    next_action: i64,
    next_patient: i64,
    dirty_patients: BTreeSet<usize>,
    dirty_tasks: HashSet<TaskKey>,
    dirty_attempts: HashSet<AttemptId>,
    /// Published tasks that were asked for while their outcomes are only in the store.
    absent: Mutex<BTreeSet<TaskKey>>,
    /// Patients that were over at the last flush, whose outcomes leave memory with the next one.
    leaving: Vec<usize>,
    batch: Batch,
}

/// Folder of the attempts in the run's folder: a link if they are on a file system of their own.
pub const ATTEMPTS: &str = "attempts";

/// A settled task as the chain sees it, for the coordinator's mirror and the driver's ledger;
/// `None` while the task is not settled.
pub fn settled<'a>(
    key: &TaskKey,
    state: &'a Task,
    outcome: impl FnOnce() -> Option<&'a TaskOutcome>,
    run_dir: &Path,
) -> Option<Settled<'a>> {
    match state {
        Task::Published { generation } => {
            let outcome = outcome()?;
            let Ending::Succeeded { result } = &outcome.ending else {
                return None;
            };
            let attempt = AttemptId {
                task: key.clone(),
                generation: *generation,
            };
            Some(Settled::Published {
                result,
                artefacts: &outcome.artefacts,
                directory: run_dir.join(attempt_directory(&attempt)),
            })
        }
        Task::Failed { failure, .. } => Some(Settled::Failed(failure)),
        Task::Open { .. } | Task::Attempting { .. } => None,
    }
}

/// Directory of an attempt, relative to the run directory.
pub(super) fn attempt_directory(attempt: &AttemptId) -> String {
    let key = attempt.task.as_str();
    format!(
        "{ATTEMPTS}/{}/{}-g{}",
        &key[..2],
        &key[..16],
        attempt.generation
    )
}

impl Books {
    /// States of the selected patients.
    pub fn selected_states(&self) -> impl Iterator<Item = &Patient> {
        self.patients
            .iter()
            .filter(|p| p.selected)
            .map(|p| &p.row.state)
    }

    /// Puts a single value into the next batch.
    pub fn put_meta(&mut self, key: &str, value: &str) {
        self.batch.put_meta(key, value);
    }

    /// Mirrors the rows of the store.
    pub fn new(run_dir: &Path, loaded: Loaded, now_ms: i64) -> Result<Self, EngineError> {
        let school = School::of(&loaded.meta);
        let mut steps = loaded.steps;
        let mut patients = Vec::with_capacity(loaded.patients.len());
        for (row, plan_row, chain) in loaded.patients {
            let carried =
                serde_json::from_str(&plan_row.carried).map_err(|source| EngineError::Plan {
                    patient: row.status.patient.clone(),
                    source,
                })?;
            let steps = steps.remove(&row.id).unwrap_or_default();
            patients.push(PatientEntry {
                row,
                plan_row,
                plan: OnceLock::new(),
                carried,
                chain,
                steps,
                selected: false,
                stored: true,
                chain_changed: false,
                plan_changed: false,
            });
        }
        let tasks = loaded.tasks.into_iter().map(|row| {
            let entry = TaskEntry {
                state: row.state,
                kind: row.kind,
                spec: row.spec.unwrap_or_default(),
                version: row.version,
                outcome_text: row.outcome,
                outcome: OnceLock::new(),
                has_outcome: row.has_outcome,
                wall_s: None,
                waiters: Vec::new(),
                not_before_ms: 0,
                stored: true,
                outcome_changed: false,
            };
            (TaskKey(row.key), entry)
        });
        let attempts = loaded.attempts.into_iter().map(|row| {
            let entry = AttemptEntry {
                state: row.state,
                directory: row.directory,
                version: row.version,
                stored: true,
                external_id: None,
                claim: None,
                planned_ms: 0,
                ended_ms: None,
            };
            (
                AttemptId {
                    task: TaskKey(row.task),
                    generation: row.generation,
                },
                entry,
            )
        });
        Ok(Self {
            run_dir: run_dir.to_owned(),
            by_name: patients
                .iter()
                .enumerate()
                .map(|(i, p)| (p.row.status.patient.clone(), i))
                .collect(),
            by_id: patients
                .iter()
                .enumerate()
                .map(|(i, p)| (p.row.id, i))
                .collect(),
            jobs: Jobs::new(loaded.jobs, loaded.allotments),
            school,
            next_patient: patients.iter().map(|p| p.row.id).max().unwrap_or(0) + 1,
            next_action: loaded.outbox.iter().map(|(id, _)| *id).max().unwrap_or(0) + 1,
            outbox: loaded.outbox,
            tasks: tasks.collect(),
            attempts: attempts.collect(),
            patients,
            ready: BTreeSet::new(),
            allocation: 0,
            now_ms,
            fresh_actions: Vec::new(),
            dirty_patients: BTreeSet::new(),
            dirty_tasks: HashSet::new(),
            dirty_attempts: HashSet::new(),
            absent: Mutex::default(),
            leaving: Vec::new(),
            batch: Batch::default(),
        })
    }

    /// Plan of a patient, parsed on first use.
    pub fn plan(&self, i: usize) -> Result<&ResolvedPatient, EngineError> {
        let patient = &self.patients[i];
        if let Some(plan) = patient.plan.get() {
            return Ok(plan);
        }
        let row = &patient.plan_row;
        let plan =
            serde_json::from_str(row.plan.as_ref().unwrap_or(&row.given)).map_err(|source| {
                EngineError::Plan {
                    patient: patient.row.status.patient.clone(),
                    source,
                }
            })?;
        Ok(patient.plan.get_or_init(|| plan))
    }

    /// Whether the store has this plan as the one that the cohort gives.
    pub fn is_given(&self, i: usize, given: &ResolvedPatient) -> bool {
        let patient = &self.patients[i];
        let text = serde_json::to_string(given).expect("a plan is JSON");
        if patient.plan_row.given == text {
            return true;
        }
        // A plan of an earlier program may have another text and the same meaning.
        let stored = serde_json::from_str::<ResolvedPatient>(&patient.plan_row.given);
        let Some(stored) = stored.ok().filter(|stored| stored == given) else {
            return false;
        };
        // The plans of patients that are over may be many, and nothing reads them.
        if patient.plan_row.plan.is_none() && !patient.row.state.is_final() {
            let _ = patient.plan.set(stored);
        }
        true
    }

    /// Adds a patient that the store does not have. Returns its index.
    pub fn add_patient(
        &mut self,
        name: &str,
        position: i64,
        plan_row: PlanRow,
        plan: ResolvedPatient,
    ) -> usize {
        let id = self.next_patient;
        self.next_patient += 1;
        let i = self.patients.len();
        self.by_name.insert(name.to_owned(), i);
        self.by_id.insert(id, i);
        self.patients.push(PatientEntry {
            row: PatientRow {
                id,
                position,
                active: true,
                version: 1,
                state: Patient::Waiting,
                status: PatientStatus {
                    patient: name.to_owned(),
                    ..PatientStatus::default()
                },
                since_ms: self.now_ms,
            },
            plan_row: PlanRow {
                patient_id: id,
                ..plan_row
            },
            plan: OnceLock::from(plan),
            carried: Vec::new(),
            chain: Chain::default(),
            steps: HashMap::new(),
            selected: false,
            stored: false,
            chain_changed: false,
            plan_changed: true,
        });
        self.dirty_patients.insert(i);
        i
    }

    /// Adds a task unless it exists.
    pub fn add_task(&mut self, key: &TaskKey, spec: &TaskSpec) {
        if let Some(task) = self.tasks.get_mut(key) {
            if task.spec.is_empty() {
                task.spec = serde_json::to_string(spec).expect("a task's spec is JSON");
            }
            return;
        }
        let entry = TaskEntry {
            state: Task::default(),
            kind: spec.kind().to_owned(),
            spec: serde_json::to_string(spec).expect("a task's spec is JSON"),
            version: 1,
            outcome_text: None,
            outcome: OnceLock::new(),
            has_outcome: false,
            wall_s: None,
            waiters: Vec::new(),
            not_before_ms: 0,
            stored: false,
            outcome_changed: false,
        };
        self.tasks.insert(key.clone(), entry);
        self.dirty_tasks.insert(key.clone());
    }

    /// Links a step of a patient's chain to a task, in place of an earlier one.
    pub fn link(&mut self, i: usize, step: Step, key: &TaskKey) {
        let patient = &mut self.patients[i];
        if patient.steps.get(&step) == Some(key) {
            return;
        }
        patient.steps.insert(step, key.clone());
        let (patient_id, at_ms) = (patient.row.id, self.now_ms);
        let row = StepRow {
            patient_id,
            stage: step.stage,
            number: step.number,
            task: key.as_str(),
            at_ms,
        };
        self.batch.append_step(&row);
    }

    /// A settled task as the chain sees it. `None`, and noted as absent, if its outcome is only in
    /// the store: what was derived from that answer must be dropped.
    pub fn settled(&self, key: &TaskKey) -> Option<Settled<'_>> {
        let task = self.tasks.get(key)?;
        if task.is_absent() {
            self.note_absent(key);
            return None;
        }
        settled(key, &task.state, || task.outcome(), &self.run_dir)
    }

    /// Registers a working patient with its task. The store holds this only in the patient's state.
    pub fn await_present_task(&mut self, i: usize) {
        let Patient::Working { task, .. } = &self.patients[i].row.state else {
            return;
        };
        if let Some(task) = self.tasks.get_mut(task)
            && !task.waiters.contains(&i)
        {
            task.waiters.push(i);
        }
    }

    /// Absolute directory of an attempt.
    pub fn directory(&self, attempt: &AttemptId) -> PathBuf {
        self.run_dir.join(attempt_directory(attempt))
    }

    /// Feeds an event to a patient's machine.
    pub fn patient_event(&mut self, i: usize, event: PatientEvent) -> Result<(), EngineError> {
        let patient = &mut self.patients[i].row;
        let (state, actions) = patient.state.clone().on(event.clone())?;
        if state == patient.state && actions.is_empty() {
            return Ok(()); // an observation without effect
        }
        let has_turned = patient.state.is_final() != state.is_final();
        patient.state = state;
        let id = patient.id;
        self.log("patient", Some(id), None, &event);
        self.dirty_patients.insert(i);
        if has_turned && self.is_pilot(i) {
            self.touch_pupils();
        }
        for PatientAction::Release(task) in actions {
            self.release(i, &task)?;
        }
        Ok(())
    }

    /// Removes a patient from the waiters of a task. An attempt at a task without waiters is
    /// cancelled.
    fn release(&mut self, i: usize, key: &TaskKey) -> Result<(), EngineError> {
        let position = self.patients[i].row.position;
        self.ready.remove(&(position, key.clone()));
        let Some(task) = self.tasks.get_mut(key) else {
            return Ok(());
        };
        task.waiters.retain(|waiter| *waiter != i);
        if !task.waiters.is_empty() {
            return Ok(());
        }
        if let Task::Attempting { generation, .. } = task.state {
            let attempt = AttemptId {
                task: key.clone(),
                generation,
            };
            if self
                .attempts
                .get(&attempt)
                .is_some_and(|a| !a.state.is_final())
            {
                self.attempt_event(&attempt, AttemptEvent::Cancel)?;
            }
        }
        Ok(())
    }

    /// Feeds an event to a task's machine.
    pub fn task_event(&mut self, key: &TaskKey, event: TaskEvent) -> Result<(), EngineError> {
        let Some(task) = self.tasks.get_mut(key) else {
            return Ok(());
        };
        let state = task.state.clone().on(event.clone())?;
        if state == task.state {
            return Ok(());
        }
        task.state = state;
        self.log("task", None, Some((key, None)), &event);
        self.dirty_tasks.insert(key.clone());
        Ok(())
    }

    /// Stores the outcome that settles a task.
    pub fn keep_outcome(&mut self, key: &TaskKey, outcome: TaskOutcome, text: String) {
        if let Some(task) = self.tasks.get_mut(key) {
            task.wall_s = Some(outcome.provenance.wall_s);
            task.outcome_text = Some(text);
            task.outcome = OnceLock::from(Some(outcome));
            task.has_outcome = true;
            task.outcome_changed = true;
            self.dirty_tasks.insert(key.clone());
        }
    }

    /// Feeds an event to an attempt's machine.
    pub fn attempt_event(
        &mut self,
        id: &AttemptId,
        event: AttemptEvent,
    ) -> Result<(), EngineError> {
        let Some(attempt) = self.attempts.get_mut(id) else {
            return Ok(());
        };
        let (state, actions) = attempt.state.clone().on(event.clone())?;
        if state == attempt.state && actions.is_empty() {
            return Ok(());
        }
        if let Attempt::Running { id } = &state {
            attempt.external_id = Some(id.clone());
        }
        if state.is_final() && !attempt.state.is_final() {
            attempt.ended_ms = Some(self.now_ms);
        }
        attempt.state = state;
        self.log(
            "attempt",
            None,
            Some((&id.task, Some(id.generation))),
            &event,
        );
        self.dirty_attempts.insert(id.clone());
        for action in actions {
            let attempt = id.clone();
            self.fresh_actions.push(match action {
                AttemptAction::Submit => Action::Submit { attempt },
                AttemptAction::Stop => Action::Stop { attempt },
            });
        }
        // The rows of the waiting patients show the state of the attempt.
        if let Some(task) = self.tasks.get(&id.task) {
            self.dirty_patients.extend(task.waiters.iter().copied());
        }
        Ok(())
    }

    /// Begins the next attempt at a task.
    pub fn begin(&mut self, key: &TaskKey) -> Result<AttemptId, EngineError> {
        self.task_event(key, TaskEvent::Start)?;
        let generation = self.tasks[key].state.generation();
        let id = AttemptId {
            task: key.clone(),
            generation,
        };
        let entry = AttemptEntry {
            state: Attempt::Planned,
            directory: attempt_directory(&id),
            version: 1,
            stored: false,
            external_id: None,
            claim: None,
            planned_ms: self.now_ms,
            ended_ms: None,
        };
        self.attempts.insert(id.clone(), entry);
        self.attempt_event(&id, AttemptEvent::Approve)?;
        Ok(id)
    }

    /// Withdraws the submission of an attempt that a job of the cluster has begun.
    pub(super) fn drop_submission(&mut self, id: &AttemptId) {
        self.fresh_actions
            .retain(|action| !matches!(action, Action::Submit { attempt } if attempt == id));
    }

    /// Stores the claim of an attempt.
    pub fn claimed(&mut self, id: &AttemptId, claim: Claim) {
        if let Some(attempt) = self.attempts.get_mut(id) {
            attempt.claim = Some(claim);
            self.dirty_attempts.insert(id.clone());
        }
    }

    /// Adds an action to the outbox of the next commit.
    pub fn put_action(&mut self, action: Action) {
        self.fresh_actions.push(action);
    }

    /// Marks an action as executed in the next commit.
    pub fn action_done(&mut self, id: i64) {
        self.outbox.retain(|(other, _)| *other != id);
        self.batch.actions_done([id]);
    }

    /// Marks a patient's row for the next commit.
    pub fn touch(&mut self, i: usize) {
        self.dirty_patients.insert(i);
    }

    pub(super) fn log<E: Serialize>(
        &mut self,
        machine: &'static str,
        patient_id: Option<i64>,
        task: Option<(&TaskKey, Option<u32>)>,
        event: &E,
    ) {
        let event = serde_json::to_value(event).expect("events are JSON");
        let (task, generation) = task.map_or((None, None), |(key, generation)| {
            (Some(key.as_str()), generation)
        });
        self.batch.append_event(&NewEvent {
            at_ms: self.now_ms,
            machine,
            patient_id,
            task,
            generation,
            event: &event,
        });
    }

    /// Turns all changes since the last flush into one batch, which the mirror then counts as
    /// committed.
    pub fn flush(&mut self) -> Batch {
        let leaving = std::mem::take(&mut self.leaving);
        for i in std::mem::take(&mut self.dirty_patients) {
            self.show(i);
            if self.patients[i].row.state.is_final() {
                self.leaving.push(i);
            }
            let patient = &mut self.patients[i];
            if patient.stored {
                self.batch.update_patient(&patient.row);
                patient.row.version += 1;
            } else {
                self.batch.insert_patient(&patient.row);
                patient.stored = true;
            }
            if std::mem::take(&mut patient.plan_changed) {
                self.batch.put_plan(&patient.plan_row);
            }
            if std::mem::take(&mut patient.chain_changed) {
                self.batch.update_chain(&ChainRow {
                    patient_id: patient.row.id,
                    chain: &patient.chain,
                });
            }
        }
        for key in std::mem::take(&mut self.dirty_tasks) {
            let Some(task) = self.tasks.get_mut(&key) else {
                continue;
            };
            task.flush(key.as_str(), &mut self.batch);
        }
        for id in std::mem::take(&mut self.dirty_attempts) {
            let Some(attempt) = self.attempts.get_mut(&id) else {
                continue;
            };
            attempt.flush(&id, self.allocation, &mut self.batch);
            if attempt.state.is_final() {
                self.attempts.remove(&id);
            }
        }
        let mut batch = std::mem::take(&mut self.batch);
        self.jobs.flush(&mut batch);
        self.batch = batch;
        for action in std::mem::take(&mut self.fresh_actions) {
            self.batch.put_action(&NewAction {
                id: self.next_action,
                at_ms: self.now_ms,
                action: &action,
            });
            self.outbox.push((self.next_action, action));
            self.next_action += 1;
        }
        // What followed from their ends was committed with the last flush, and done since.
        leaving.into_iter().for_each(|i| self.leave(i));
        std::mem::take(&mut self.batch)
    }
}
