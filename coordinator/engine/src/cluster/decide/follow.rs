//! Brings chains up to date from the attempt directories that drivers left. The directories follow
//! from the task keys that the chain derives, so drivers need not report anything.

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_workflow::task::Task;

use super::super::waiting::present_task;
use super::State;
use super::observation::{AttemptSeen, Question};
use crate::EngineError;
use crate::decider::Circumstance;
use crate::dispatch::AttemptFindings;

impl State {
    /// Asks about the attempt that comes next on the chains which are followed; `None` when they all
    /// have been. A chain is followed to its end before the next one.
    pub(super) fn next_attempt(&mut self) -> Option<Question> {
        while let Some(&i) = self.to_follow.front() {
            if let Some((attempt, is_begun)) = self.attempt_to_look_for(i) {
                return Some(Question::Attempt { attempt, is_begun });
            }
            self.to_follow.pop_front();
        }
        None
    }

    /// Attempt of a patient's present task that may have news, and whether it has begun.
    fn attempt_to_look_for(&self, i: usize) -> Option<(AttemptId, bool)> {
        let task = present_task(&self.books, i)?;
        let (generation, is_begun) = match self.books.task(&task)?.state {
            Task::Open { generation, .. } => (generation + 1, false),
            Task::Attempting { generation, .. } => (generation, true),
            Task::Published { .. } | Task::Failed { .. } => return None,
        };
        Some((AttemptId { task, generation }, is_begun))
    }

    /// Takes up what was seen of the attempt that was asked about.
    pub(super) fn take_attempt(&mut self, seen: AttemptSeen) -> Result<(), EngineError> {
        let asked = self.to_follow.front().copied();
        let Some((attempt, _)) = asked.and_then(|i| self.attempt_to_look_for(i)) else {
            return Ok(());
        };
        match seen {
            AttemptSeen::Nothing => {
                self.to_follow.pop_front();
                Ok(())
            }
            AttemptSeen::Begun(allocation) => {
                self.books.begin_found(&attempt.task, attempt.generation)?;
                let id = allocation
                    .map(|a| a.id.unwrap_or(a.job))
                    .unwrap_or_default();
                self.books.attempt_seen(&attempt, &id)
            }
            AttemptSeen::Ended(evidence) => self.take_evidence(&attempt, evidence),
            AttemptSeen::Superseded => self.interrupt(&attempt, "superseded by a later job"),
        }
    }

    /// Ends an attempt that can publish nothing, without counting it against the retries.
    pub(super) fn interrupt(&mut self, attempt: &AttemptId, why: &str) -> Result<(), EngineError> {
        let evidence = AttemptFindings::Nothing {
            class: FailureClass::Site,
            reason: why.to_owned(),
        };
        self.take_evidence(attempt, evidence)
    }

    /// Takes up the evidence of an attempt that no coordinator watched.
    fn take_evidence(
        &mut self,
        attempt: &AttemptId,
        evidence: AttemptFindings,
    ) -> Result<(), EngineError> {
        self.decider
            .attempt_ended(&mut self.books, attempt, evidence, Circumstance::Excused)
    }

    /// Takes up the ends of attempts that were stopped.
    pub(super) fn take_stopped(&mut self) -> Result<(), EngineError> {
        for stopped in std::mem::take(&mut self.stopped) {
            self.books.action_done(stopped.action);
            if !self.books.attempts().contains_key(&stopped.attempt) {
                continue;
            }
            match stopped.published {
                Some(evidence) => self.take_evidence(&stopped.attempt, evidence)?,
                None => self.interrupt(&stopped.attempt, "ended by the coordinator")?,
            }
        }
        Ok(())
    }
}
