//! A batch of transitions: rows of every table, one JSON array each, committed as one transaction.

use serde::Serialize;

use super::{StoreError, attempts, cluster_jobs, events, outbox, patients, steps, tasks};

/// Rows of one statement.
#[derive(Debug, Default)]
pub(super) struct Rows {
    text: String,
    pub(super) count: usize,
}

impl Rows {
    pub(super) fn push<T: Serialize>(&mut self, row: &T) {
        self.text.push(if self.count == 0 { '[' } else { ',' });
        self.text
            .push_str(&serde_json::to_string(row).expect("rows are plain structs: they are JSON"));
        self.count += 1;
    }

    /// The rows as a JSON array, and their number; `None` if there are none.
    pub(super) fn take(&mut self) -> Option<(String, usize)> {
        if self.count == 0 {
            return None;
        }
        let mut text = std::mem::take(&mut self.text);
        text.push(']');
        Some((text, std::mem::take(&mut self.count)))
    }
}

/// All changes of one commit.
#[derive(Debug, Default)]
pub struct Batch {
    pub(super) new_patients: Rows,
    pub(super) patients: Rows,
    pub(super) plans: Rows,
    pub(super) chains: Rows,
    pub(super) new_tasks: Rows,
    pub(super) tasks: Rows,
    pub(super) steps: Rows,
    pub(super) new_attempts: Rows,
    pub(super) attempts: Rows,
    pub(super) events: Rows,
    pub(super) outbox: Rows,
    pub(super) new_jobs: Rows,
    pub(super) jobs: Rows,
    pub(super) allotments: Rows,
    pub(super) meta: Rows,
    pub(super) done: Vec<i64>,
}

impl Batch {
    /// Whether there is nothing to commit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let rows = [
            &self.new_patients,
            &self.patients,
            &self.plans,
            &self.chains,
            &self.new_tasks,
            &self.tasks,
            &self.steps,
            &self.new_attempts,
            &self.attempts,
            &self.events,
            &self.outbox,
            &self.new_jobs,
            &self.jobs,
            &self.allotments,
            &self.meta,
        ];
        rows.iter().all(|rows| rows.count == 0) && self.done.is_empty()
    }

    /// Inserts a patient that is new to the store.
    pub fn insert_patient(&mut self, row: &patients::PatientRow) {
        self.new_patients.push(row);
    }

    /// Updates a patient's row. `row.version` is the version in the store, which the update raises
    /// by one.
    pub fn update_patient(&mut self, row: &patients::PatientRow) {
        self.patients.push(row);
    }

    /// Inserts or replaces a patient's plan.
    pub fn put_plan(&mut self, row: &patients::PlanRow) {
        self.plans.push(row);
    }

    /// Updates a patient's chain.
    pub fn update_chain(&mut self, row: &patients::ChainRow<'_>) {
        self.chains.push(row);
    }

    /// Inserts a task that is new to the store.
    pub fn insert_task(&mut self, row: &tasks::NewTask<'_>) {
        self.new_tasks.push(row);
    }

    /// Updates a task's row, guarded by its version.
    pub fn update_task(&mut self, row: &tasks::TaskChange<'_>) {
        self.tasks.push(row);
    }

    /// Links a step of a patient's chain to a task, in place of an earlier one.
    pub fn append_step(&mut self, row: &steps::StepRow<'_>) {
        self.steps.push(row);
    }

    /// Inserts the row of a planned attempt.
    pub fn insert_attempt(&mut self, row: &attempts::NewAttempt<'_>) {
        self.new_attempts.push(row);
    }

    /// Updates an attempt's row, guarded by its version.
    pub fn update_attempt(&mut self, row: &attempts::AttemptChange<'_>) {
        self.attempts.push(row);
    }

    /// Appends an event to the log.
    pub fn append_event(&mut self, row: &events::NewEvent<'_>) {
        self.events.push(row);
    }

    /// Adds an action to be executed after the commit.
    pub fn put_action(&mut self, row: &outbox::NewAction<'_>) {
        self.outbox.push(row);
    }

    /// Inserts a job of a cluster, whose name is durable from then on.
    pub fn insert_job(&mut self, row: &cluster_jobs::JobRow) {
        self.new_jobs.push(row);
    }

    /// Updates a job's row, guarded by its version.
    pub fn update_job(&mut self, row: &cluster_jobs::JobRow) {
        self.jobs.push(row);
    }

    /// Inserts or replaces the allotment for a patient's next job.
    pub fn put_allotment(&mut self, row: &cluster_jobs::AllotmentRow<'_>) {
        self.allotments.push(row);
    }

    /// Sets a single value.
    pub fn put_meta(&mut self, key: &str, value: &str) {
        self.meta
            .push(&serde_json::json!({ "key": key, "value": value }));
    }

    /// Removes actions from the outbox after their execution.
    pub fn actions_done(&mut self, ids: impl IntoIterator<Item = i64>) {
        self.done.extend(ids);
    }

    /// The statements of this batch in the order required by foreign keys, each with its rows and
    /// its guard.
    pub(super) fn statements(&mut self) -> Vec<Statement> {
        let mut statements = Vec::new();
        let mut add = |rows: &mut Rows, sql: &'static str, guard: Option<&'static str>| {
            if let Some((json, count)) = rows.take() {
                statements.push(Statement {
                    sql,
                    json,
                    guard: guard.map(|table| (table, count)),
                });
            }
        };
        add(&mut self.new_patients, patients::INSERT, None);
        add(&mut self.patients, patients::UPDATE, Some("patients"));
        add(&mut self.plans, patients::PUT_PLAN, None);
        add(&mut self.chains, patients::UPDATE_CHAIN, Some("plans"));
        add(&mut self.new_tasks, tasks::INSERT, None);
        add(&mut self.tasks, tasks::UPDATE, Some("tasks"));
        add(&mut self.steps, steps::INSERT, None);
        add(&mut self.new_attempts, attempts::INSERT, None);
        add(&mut self.attempts, attempts::UPDATE, Some("attempts"));
        add(&mut self.events, events::INSERT, None);
        add(&mut self.outbox, outbox::INSERT, None);
        add(&mut self.new_jobs, cluster_jobs::INSERT, None);
        add(&mut self.jobs, cluster_jobs::UPDATE, Some("jobs"));
        add(&mut self.allotments, cluster_jobs::PUT_ALLOTMENT, None);
        add(&mut self.meta, cluster_jobs::PUT_META, None);
        if !self.done.is_empty() {
            let json =
                serde_json::to_string(&std::mem::take(&mut self.done)).expect("numbers are JSON");
            statements.push(Statement {
                sql: outbox::DONE,
                json,
                guard: None,
            });
        }
        statements
    }
}

/// One statement with all its rows.
pub(super) struct Statement {
    pub(super) sql: &'static str,
    pub(super) json: String,
    /// Table, and number of its rows that must have changed.
    pub(super) guard: Option<(&'static str, usize)>,
}

impl Statement {
    pub(super) fn check(&self, changed: u64) -> Result<(), StoreError> {
        match self.guard {
            Some((table, expected)) if changed != expected as u64 => Err(StoreError::Guard {
                table,
                expected,
                changed,
            }),
            _ => Ok(()),
        }
    }
}
