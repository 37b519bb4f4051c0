//! Executes the committed actions of the outbox. Actions are idempotent: a second execution changes
//! nothing.

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use cardiotwin_store::outbox::Action;
use cardiotwin_workflow::attempt::{Attempt, AttemptEvent};

use super::LocalLoop;
use crate::books::AttemptEntry;
use crate::dispatch::{AttemptFindings, DispatchError, Executor, News, Order};
use crate::{EngineError, StopLevel, cores, overlay, requests};

impl<E: Executor> LocalLoop<E> {
    /// Ends the workers that are hung, or that are in the way of a stop.
    pub(super) fn end_workers(&mut self) -> Result<(), EngineError> {
        for (attempt, by_force) in std::mem::take(&mut self.to_end) {
            let directory = self.books.directory(&attempt);
            self.executor.stop(&attempt, &directory, by_force)?;
        }
        Ok(())
    }

    pub(super) fn remove_applied_requests(&mut self) -> Result<(), EngineError> {
        if self.applied_requests.is_empty() {
            return Ok(());
        }
        requests::remove(&std::mem::take(&mut self.applied_requests))?;
        self.surroundings.crash.pass("after requests were removed")
    }

    pub(super) async fn work_off_outbox(&mut self) -> Result<(), EngineError> {
        self.books.set_now_ms(self.surroundings.clock.now_ms());
        for (id, action) in self.books.take_outbox() {
            // A stopping coordinator submits nothing new; the next run executes this action.
            if self.seen_stop > StopLevel::Run && matches!(action, Action::Submit { .. }) {
                continue;
            }
            self.surroundings.crash.pass("before an action")?;
            match action {
                Action::Submit { attempt } => self.submit(&attempt).await?,
                Action::Stop { attempt } => {
                    let directory = self.books.directory(&attempt);
                    if !self.executor.stop(&attempt, &directory, false)? {
                        // No process is left whose end would be reported.
                        self.stopped_unwatched.push(attempt);
                    }
                }
                Action::WriteOverlay { patient_id } => {
                    self.books
                        .recall_patient(&mut self.writer, patient_id)
                        .await?;
                    overlay::write_of(&self.books, patient_id)?;
                }
                // Left over from a time when this run's tasks were jobs of a cluster. The next tick
                // on the cluster executes it.
                Action::SubmitJob { .. } | Action::FenceJob { .. } | Action::CancelJob { .. } => {
                    continue;
                }
            }
            self.surroundings.crash.pass("after an action")?;
            self.books.action_done(id);
        }
        Ok(())
    }

    async fn submit(&mut self, attempt: &AttemptId) -> Result<(), EngineError> {
        // An action may be executed twice: by now the attempt may be over, cancelled or already
        // running.
        let wanted =
            |a: &AttemptEntry| !a.state.is_final() && !matches!(a.state, Attempt::Cancelling);
        let wanted = self.books.attempt(attempt).is_some_and(wanted) && !self.watch.has(attempt);
        let Some(task) = self.books.task(&attempt.task).filter(|_| wanted) else {
            return Ok(());
        };
        let task: TaskSpec = serde_json::from_str(&task.spec).map_err(|source| {
            cardiotwin_store::StoreError::Content {
                table: "tasks",
                column: "spec",
                row: attempt.task.to_string(),
                source,
            }
        })?;
        let directory = self.books.directory(attempt);
        let spec = AttemptSpec {
            schema_version: formats::SPEC.version,
            attempt: attempt.clone(),
            threads: cores::threads(&self.settings, &task),
            instruction_set: self.settings.instruction_set,
            vtu_every_ms: self.settings.vtu_every_ms,
            task,
        };
        match self
            .executor
            .submit(Order {
                spec,
                directory: directory.clone(),
            })
            .await
        {
            Ok(id) => {
                self.submitted += 1;
                self.watch.begin(attempt, &directory);
                self.books
                    .attempt_event(attempt, AttemptEvent::Accepted { id })
            }
            Err(error) if error.is_passing() => {
                let evidence = AttemptFindings::Nothing {
                    class: FailureClass::Site,
                    reason: with_cause(&error),
                };
                self.not_submitted(attempt, evidence);
                Ok(())
            }
            Err(error @ DispatchError::Kind { .. }) => {
                let evidence = AttemptFindings::Nothing {
                    class: FailureClass::Input,
                    reason: error.to_string(),
                };
                self.not_submitted(attempt, evidence);
                Ok(())
            }
            // No attempt could be started for this reason, so the attempt keeps its state for the
            // next run.
            Err(error) => Err(error.into()),
        }
    }

    fn not_submitted(&mut self, attempt: &AttemptId, evidence: AttemptFindings) {
        self.failed_submissions.push(News::Ended {
            attempt: attempt.clone(),
            evidence,
            claim: None,
        });
    }
}

fn with_cause(error: &DispatchError) -> String {
    match std::error::Error::source(error) {
        Some(cause) => format!("{error}: {cause}"),
        None => error.to_string(),
    }
}
