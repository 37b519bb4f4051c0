//! Brings chains up to date from the attempt directories that drivers left. The directories follow
//! from the task keys that the chain derives, so drivers need not report anything.

use cardiotwin_protocol::closing;
use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_slurm::access::{Scheduler, folder};
use cardiotwin_workflow::task::Task;

use super::Cluster;
use super::place::present_task;
use crate::EngineError;
use crate::decider::Circumstance;
use crate::dispatch::{self, Evidence};

impl<S: Scheduler> Cluster<S> {
    /// Takes up everything that is there for a patient: begun attempts, their outcomes, and the
    /// tasks that follow.
    pub(super) async fn follow(&mut self, i: usize) -> Result<(), EngineError> {
        while let Some(key) = present_task(&self.books, i) {
            if !self.follow_task(&key)? {
                break;
            }
            self.complete_decisions().await?;
        }
        Ok(())
    }

    /// Advances a task by one step; false if nothing new was found.
    fn follow_task(&mut self, key: &TaskKey) -> Result<bool, EngineError> {
        let Some(task) = self.books.task(key) else {
            return Ok(false);
        };
        let state = task.state.clone();
        let attempt = |generation| AttemptId {
            task: key.clone(),
            generation,
        };
        match state {
            Task::Open { generation, .. } => {
                let next = attempt(generation + 1);
                let directory = self.books.directory(&next);
                if !folder::is_begun(&directory) {
                    return Ok(false);
                }
                self.books.begin_found(key, generation + 1)?;
                let allocation = folder::allocation_of(&directory);
                let id = allocation
                    .map(|a| a.id.unwrap_or(a.job))
                    .unwrap_or_default();
                self.books.attempt_seen(&next, &id)?;
                Ok(true)
            }
            Task::Attempting { generation, .. } => {
                let at_work = attempt(generation);
                let directory = self.books.directory(&at_work);
                if let Some(evidence) = dispatch::outcome(&directory)? {
                    self.take_up(&at_work, evidence)?;
                    return Ok(true);
                }
                // A later job went past this attempt after revoking it, so it can publish nothing.
                let passed = folder::is_begun(&self.books.directory(&attempt(generation + 1)));
                if passed && closing::is_revoked(&directory) {
                    self.interrupt(&at_work, "superseded by a later job")?;
                }
                Ok(passed)
            }
            Task::Published { .. } | Task::Failed { .. } => Ok(false),
        }
    }

    /// Ends an attempt that can publish nothing, without counting it against the retries.
    pub(super) fn interrupt(&mut self, attempt: &AttemptId, why: &str) -> Result<(), EngineError> {
        let class = cardiotwin_schemas::failure::FailureClass::Site;
        let evidence = Evidence::Nothing {
            class,
            reason: why.to_owned(),
        };
        self.take_up(attempt, evidence)
    }

    /// Takes up the evidence of an attempt that no coordinator watched.
    pub(super) fn take_up(
        &mut self,
        attempt: &AttemptId,
        evidence: Evidence,
    ) -> Result<(), EngineError> {
        self.decider
            .attempt_ended(&mut self.books, attempt, evidence, Circumstance::Excused)
    }
}
