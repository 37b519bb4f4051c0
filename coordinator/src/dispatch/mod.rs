//! Where attempts run. An executor starts, watches and ends them; it decides nothing and knows no database.
//!
//! Every call may come twice: a coordinator that was killed repeats what it cannot know to have happened. Evidence is
//! read from the attempt's own directory first (`outcome.json`, `started.json`), from the operating system second.

mod evidence;
mod in_process;
mod limited;
mod local;
mod process;
pub mod slurm;

use std::future::Future;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, ExternalId};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::progress::Claim;
use cardiotwin_schemas::task::AttemptSpec;

pub use evidence::{outcome, revoke};
pub use in_process::InProcess;
pub use limited::{CommandEnd, run_limited};
pub use local::{Launcher, Local};
pub use process::{claim_of_this_process, lives_here, own_uid};

/// What an executor needs to start an attempt.
#[derive(Debug, Clone)]
pub struct Order {
    /// Becomes `spec.json`.
    pub spec: AttemptSpec,
    /// The attempt's own directory, absolute.
    pub directory: PathBuf,
}

/// What an attempt left behind.
#[derive(Debug, Clone, PartialEq)]
pub enum Evidence {
    /// An outcome, with its text as it was found.
    Outcome {
        /// What it says.
        outcome: Box<TaskOutcome>,
        /// The text.
        text: String,
    },
    /// No outcome, and no process that could still write one.
    Nothing {
        /// Whose fault, as far as it can be told.
        class: FailureClass,
        /// What is known: exit code, signal, last line of the log.
        reason: String,
    },
}

/// Something that happened to an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// Another process than the one that we started holds the claim and lives.
    Alive {
        /// Which attempt.
        attempt: AttemptId,
        /// Who.
        claim: Claim,
    },
    /// It ended.
    Ended {
        /// Which attempt.
        attempt: AttemptId,
        /// With what.
        evidence: Evidence,
        /// Who had claimed it.
        claim: Option<Claim>,
    },
    /// It can no longer be seen whether it lives.
    Vanished {
        /// Which attempt.
        attempt: AttemptId,
    },
}

/// What is found of an attempt that an earlier coordinator started, or was about to.
#[derive(Debug, Clone, PartialEq)]
pub enum Found {
    /// It lives, and is watched from now on.
    Alive(Claim),
    /// It is over.
    Over {
        /// With what.
        evidence: Evidence,
        /// Who had claimed it.
        claim: Option<Claim>,
    },
    /// Nobody has claimed it: it may be submitted (again).
    Unclaimed,
    /// Its claim is half written: to be looked at again.
    BeingClaimed,
    /// Claimed on another host: nothing can be said from here.
    Elsewhere(Claim),
}

/// Why an attempt cannot be handed over.
#[derive(Debug, thiserror::Error)]
pub enum DispatchError {
    /// A file of the attempt's directory.
    #[error("cannot {what} {path}")]
    File {
        /// Verb.
        what: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The worker cannot be started.
    #[error("cannot start {worker}")]
    Spawn {
        /// Its executable.
        worker: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Not for this executor.
    #[error("the in-process executor only does no-op tasks, not {kind}")]
    Kind {
        /// The task's kind.
        kind: &'static str,
    },
}

impl DispatchError {
    /// Whether waiting a moment may help: the process table or memory is full.
    #[must_use]
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Spawn { source, .. }
            if matches!(source.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::OutOfMemory | io::ErrorKind::Interrupted))
    }
}

/// Starts, watches and ends attempts.
pub trait Executor: Send {
    /// As in the table of allocations.
    fn kind(&self) -> &'static str;

    /// How many more attempts it would take now.
    fn free(&self) -> usize;

    /// Starts an attempt; with an attempt that is claimed already nothing is done twice.
    fn submit(
        &mut self,
        order: Order,
    ) -> impl Future<Output = Result<ExternalId, DispatchError>> + Send;

    /// Looks for an attempt of an earlier coordinator and watches it if it lives.
    ///
    /// # Errors
    /// [`DispatchError::File`] when its directory cannot be read.
    fn adopt(&mut self, attempt: &AttemptId, directory: &Path) -> Result<Found, DispatchError>;

    /// Revokes an attempt unless it has published, and ends its process: kindly first, by force after a while, or at
    /// once when `now`. Tells whether a process is still watched, whose end will be news; where none is, an outcome
    /// that was published first is found by [`Executor::adopt`].
    ///
    /// # Errors
    /// [`DispatchError::File`] when the revocation cannot be written.
    fn stop(
        &mut self,
        attempt: &AttemptId,
        directory: &Path,
        now: bool,
    ) -> Result<bool, DispatchError>;

    /// Waits until there is something to tell. Dropping the future loses nothing.
    fn news(&mut self) -> impl Future<Output = Vec<News>> + Send;
}
