//! Executes effects and returns their results. Every effect may be executed twice, and nothing is
//! decided here.

use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::access::folder::JobFolder;
use cardiotwin_slurm::answers::Exit;
use cardiotwin_slurm::answers::submit;
use cardiotwin_slurm::commands::{self, Command};

use super::Cluster;
use super::decide::{Effect, EffectResult, SubmissionResult};
use super::order::script_of;
use crate::dispatch::{self, AttemptFindings};
use crate::{EngineError, overlay, requests};

impl<S: Scheduler> Cluster<S> {
    pub(super) async fn execute(
        &mut self,
        effect: Effect,
    ) -> Result<Option<EffectResult>, EngineError> {
        match effect {
            Effect::RemoveRequests(paths) => {
                requests::remove(&paths)?;
                self.pass("after requests were removed")?;
                Ok(None)
            }
            Effect::Fence((job, element)) => {
                self.folder(&job).fence(element)?;
                self.pass("after an element was revoked")?;
                Ok(None)
            }
            Effect::Revoke { attempt, reason } => {
                dispatch::revoke(&self.directory(&attempt), &attempt, &reason)?;
                self.pass("after an attempt was revoked")?;
                Ok(None)
            }
            Effect::Cancel { actions, commands } => {
                let accepted = self.cancel(&commands).await?;
                Ok(Some(EffectResult::Cancelled { actions, accepted }))
            }
            Effect::CancelLingering(jobs) => {
                self.cancel(&[commands::cancel(&jobs)]).await?;
                Ok(None)
            }
            of_action => {
                self.pass("before an action")?;
                let result = self.execute_action(of_action).await?;
                self.pass("after an action")?;
                Ok(result)
            }
        }
    }

    /// Executes an action of the outbox.
    async fn execute_action(
        &mut self,
        effect: Effect,
    ) -> Result<Option<EffectResult>, EngineError> {
        Ok(Some(match effect {
            Effect::FenceByAction {
                action,
                element: (job, element),
            } => {
                self.folder(&job).fence(element)?;
                EffectResult::Done(action)
            }
            Effect::Stop { action, attempt } => EffectResult::Stopped {
                action,
                published: self.stop(&attempt)?,
                attempt,
            },
            Effect::WriteOverlay { action, patient_id } => {
                let books = &mut self.state.books;
                books.recall_patient(&mut self.writer, patient_id).await?;
                overlay::write_of(books, patient_id)?;
                EffectResult::Done(action)
            }
            Effect::Submit { action, job } => EffectResult::Submitted {
                action,
                answer: self.submit(&job).await?,
                job,
            },
            Effect::Nothing { action } => EffectResult::Done(action),
            _ => return Ok(None),
        }))
    }

    fn folder(&self, job: &str) -> JobFolder {
        JobFolder::of(self.state.books.run_dir(), job)
    }

    pub(super) fn directory(&self, attempt: &AttemptId) -> std::path::PathBuf {
        self.state.books.directory(attempt)
    }

    /// Revokes an attempt that is not wanted any more. Returns an outcome that was published first.
    fn stop(&self, attempt: &AttemptId) -> Result<Option<AttemptFindings>, EngineError> {
        let directory = self.directory(attempt);
        // An attempt that never began is revoked as well, so that no driver begins it.
        std::fs::create_dir_all(&directory).map_err(|source| EngineError::File {
            what: "create",
            path: directory.clone(),
            source,
        })?;
        Ok(dispatch::revoke(&directory, attempt, "no longer needed")?)
    }

    /// Runs commands that cancel jobs. Returns whether Slurm took all of them.
    async fn cancel(&mut self, commands: &[Command]) -> Result<bool, EngineError> {
        let mut accepted = true;
        for command in commands {
            self.commands += 1;
            accepted &= self.run_command(command).await?.exit == Exit::Code(0);
        }
        Ok(accepted)
    }

    async fn submit(&mut self, name: &str) -> Result<SubmissionResult, EngineError> {
        let folder = self.folder(name);
        let Some(row) = self.state.books.jobs().rows().get(name) else {
            return Ok(SubmissionResult::BegunBefore);
        };
        if folder.was_submitting() {
            return Ok(SubmissionResult::BegunBefore);
        }
        let (site, settings) = (&self.state.site, &self.state.settings);
        let text = match script_of(&row.spec, name, &folder, site, settings, &self.program) {
            Ok(text) => text,
            Err(error) => return Ok(SubmissionResult::NoScript(error.to_string())),
        };
        folder.write(&self.state.orders(row, &self.worker)?, &text)?;
        self.pass("after a job's files were written")?;
        folder.mark_submitting()?;
        self.commands += 1;
        let command = commands::submit(
            &folder.path().to_string_lossy(),
            &folder.script().to_string_lossy(),
        );
        let output = self.run_command(&command).await?;
        if submit::read(&output).may_be_repeated() {
            // The same name may be submitted again.
            folder.unmark_submitting()?;
            self.pass("after a mark was taken back")?;
        }
        Ok(SubmissionResult::Answered(output))
    }
}
