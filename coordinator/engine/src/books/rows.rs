//! Rows of the store as the in-memory mirror keeps them.

use std::collections::HashMap;
use std::sync::OnceLock;

use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::ids::{AttemptId, ExternalId, TaskKey};
use cardiotwin_schemas::organ::Step1Parameters;
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::progress::Claim;
use cardiotwin_workflow::attempt::Attempt;
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::patient::Step;
use cardiotwin_workflow::task::Task;

use cardiotwin_store::Batch;
use cardiotwin_store::attempts::{AttemptChange, NewAttempt};
use cardiotwin_store::patients::{PatientRow, PlanRow};
use cardiotwin_store::tasks::{NewTask, TaskChange};

/// A patient with everything from which its chain is derived.
#[derive(Debug)]
pub struct PatientEntry {
    pub row: PatientRow,
    pub plan_row: PlanRow,
    /// Parsed from the row on first use: most patients of a resumed run are over and never need it.
    pub(super) plan: OnceLock<ResolvedPatient>,
    pub carried: Vec<Step1Parameters>,
    pub chain: Chain,
    pub steps: HashMap<Step, TaskKey>,
    /// Whether this run works on the patient.
    pub selected: bool,
    pub(super) stored: bool,
    pub(super) chain_changed: bool,
    pub(super) plan_changed: bool,
}

/// A task with the outcome that settled it.
#[derive(Debug)]
pub struct TaskEntry {
    pub state: Task,
    pub kind: String,
    /// JSON of the specification; empty once the task is settled and its patients are over. A task
    /// that is opened again has it from its derivation.
    pub spec: String,
    pub(super) version: i64,
    pub(super) outcome_text: Option<String>,
    pub(super) outcome: OnceLock<Option<TaskOutcome>>,
    /// Whether there is an outcome, in memory or in the store.
    pub(super) has_outcome: bool,
    /// Wall time of the attempt that published the task, s; kept without the outcome.
    pub(super) wall_s: Option<f64>,
    /// Indices of the patients that wait for this task.
    pub waiters: Vec<usize>,
    /// Before this time no further attempt begins, milliseconds since 1970. A restarted coordinator
    /// does not pause.
    pub not_before_ms: i64,
    pub(super) stored: bool,
    pub(super) outcome_changed: bool,
}

/// An attempt that is not over, or ended since the last flush.
#[derive(Debug)]
pub struct AttemptEntry {
    pub state: Attempt,
    /// Path relative to the run directory.
    pub directory: String,
    pub(super) version: i64,
    pub(super) stored: bool,
    pub(super) external_id: Option<ExternalId>,
    pub(super) claim: Option<Claim>,
    pub(super) planned_ms: i64,
    pub(super) ended_ms: Option<i64>,
}

impl TaskEntry {
    /// Whether the task has to wait after a failure of the site.
    pub fn is_paused(&self, now_ms: i64) -> bool {
        let has_failed =
            matches!(self.state, Task::Open { site_failures, .. } if site_failures > 0);
        has_failed && now_ms < self.not_before_ms
    }

    pub fn outcome(&self) -> Option<&TaskOutcome> {
        self.outcome
            .get_or_init(|| {
                self.outcome_text
                    .as_ref()
                    .and_then(|text| OUTCOME.read(&"tasks.outcome", text.as_bytes()).ok())
            })
            .as_ref()
    }

    /// Whether the task is published and its outcome is only in the store.
    pub fn is_absent(&self) -> bool {
        let is_published = matches!(self.state, Task::Published { .. });
        let is_here = self.outcome_text.is_some() || self.outcome.get().is_some();
        is_published && self.has_outcome && !is_here
    }

    /// Wall time of the attempt that published the task, s; `None` if it is not known here.
    pub fn wall_s(&self) -> Option<f64> {
        self.wall_s
            .or_else(|| Some(self.outcome()?.provenance.wall_s))
    }

    /// Takes the outcome from the store.
    pub(super) fn recall(&mut self, text: String) {
        if self.is_absent() {
            self.outcome_text = Some(text);
        }
    }

    /// Leaves the specification and the outcome of a task that is over to the store.
    pub(super) fn leave(&mut self) {
        if !self.stored || self.outcome_changed || !self.state.is_final() {
            return;
        }
        self.wall_s = self.wall_s();
        self.spec = String::new();
        self.outcome_text = None;
        self.outcome = OnceLock::new();
    }

    pub(super) fn flush(&mut self, key: &str, batch: &mut Batch) {
        let word = self.state.word();
        if !self.stored {
            batch.insert_task(&NewTask {
                key,
                kind: &self.kind,
                state: &self.state,
                word,
                spec: &self.spec,
            });
            self.stored = true;
            // A task whose job did its work between two ticks is inserted, begun and settled in one
            // commit.
            if !self.outcome_changed {
                return;
            }
        }
        let outcome = self
            .outcome_text
            .as_deref()
            .filter(|_| self.outcome_changed);
        batch.update_task(&TaskChange {
            key,
            version: self.version,
            state: &self.state,
            word,
            outcome,
        });
        self.version += 1;
        self.outcome_changed = false;
        if self.outcome.get().is_some() {
            // The store has the text now.
            self.outcome_text = None;
        }
    }
}

impl AttemptEntry {
    pub(super) fn flush(&mut self, id: &AttemptId, allocation: i64, batch: &mut Batch) {
        let (task, generation, state, word) = (
            id.task.as_str(),
            id.generation,
            &self.state,
            self.state.word(),
        );
        if !self.stored {
            let (directory, planned_ms) = (self.directory.as_str(), self.planned_ms);
            batch.insert_attempt(&NewAttempt {
                task,
                generation,
                allocation,
                directory,
                state,
                word,
                planned_ms,
            });
            self.stored = true;
            if self.external_id.is_none() && self.claim.is_none() && !state.is_final() {
                return;
            }
        }
        let claim = self
            .claim
            .take()
            .map(|c| serde_json::to_string(&c).expect("a claim is JSON"));
        batch.update_attempt(&AttemptChange {
            task,
            generation,
            version: self.version,
            state,
            word,
            over: state.is_final(),
            external_id: self.external_id.take().as_ref().map(ExternalId::as_str),
            claim: claim.as_deref(),
            ended_ms: self.ended_ms,
        });
        self.version += 1;
    }
}
