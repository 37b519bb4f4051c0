//! Execution of attempts. An executor starts, watches and ends them. It decides nothing and does
//! not access the database.
//!
//! Every call may come twice, because a coordinator that was killed cannot know which calls took
//! effect. Evidence is read from the attempt's own directory first (`outcome.json`,
//! `started.json`), and from the operating system second.

mod evidence;
mod in_process;
mod launcher;
mod limited;
mod local;
mod process;

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
pub use launcher::{Launcher, Places};
pub use limited::{CommandEnd, run_limited};
pub use local::Local;
pub use process::{claim_of_this_process, lives_here, own_uid};

/// Data that an executor needs to start an attempt.
#[derive(Debug, Clone)]
pub struct Order {
    /// Specification, written to `spec.json`.
    pub spec: AttemptSpec,
    /// The attempt's own directory, as an absolute path.
    pub directory: PathBuf,
}

/// Evidence of how an attempt ended.
#[derive(Debug, Clone, PartialEq)]
pub enum AttemptFindings {
    /// An outcome that the attempt's worker published in its directory.
    Outcome {
        /// Content of `outcome.json`.
        outcome: Box<TaskOutcome>,
        /// Text of `outcome.json`, from which the outcome was parsed.
        text: String,
    },
    /// No outcome, and no process that could still write one.
    Nothing {
        /// Class of the failure, as far as it can be determined.
        class: FailureClass,
        /// Exit code, signal, or last line of the log.
        reason: String,
    },
}

/// An event of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// The claim is held by a living process that this executor did not start.
    Alive {
        /// Id of the attempt.
        attempt: AttemptId,
        /// Claim of the living process.
        claim: Claim,
    },
    /// The attempt has no process any more.
    Ended {
        /// Id of the attempt.
        attempt: AttemptId,
        /// Outcome, or the reason for its absence.
        evidence: AttemptFindings,
        /// Claim on the attempt, if it was claimed.
        claim: Option<Claim>,
    },
    /// It cannot be observed any more whether the attempt is alive.
    Vanished {
        /// Id of the attempt.
        attempt: AttemptId,
    },
}

/// State of an attempt that an earlier coordinator started or was about to start.
#[derive(Debug, Clone, PartialEq)]
pub enum Found {
    /// The process of the attempt lives, and is watched from now on.
    Alive(Claim),
    /// The attempt is over.
    Over {
        /// Outcome, or the reason for its absence.
        evidence: AttemptFindings,
        /// Claim on the attempt, if it was claimed.
        claim: Option<Claim>,
    },
    /// The attempt has no claim and may be submitted (again).
    Unclaimed,
    /// The claim is incomplete and should be read again later.
    BeingClaimed,
    /// A process on another host holds the claim, and its state cannot be determined from here.
    Elsewhere(Claim),
}

/// Errors in handing over or watching an attempt.
#[derive(Debug, thiserror::Error)]
pub enum DispatchError {
    /// A file of the attempt's directory cannot be read or written.
    #[error("cannot {what} {path}")]
    File {
        /// Verb of the operation, as in "cannot read".
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The worker cannot be started.
    #[error("cannot start {worker}")]
    Spawn {
        /// Path of the worker's executable.
        worker: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The executor does not run tasks of this kind.
    #[error("the in-process executor runs only no-op tasks, not {kind}")]
    Kind {
        /// Kind of the task.
        kind: &'static str,
    },
}

impl DispatchError {
    /// Whether the error may pass by itself, because the process table or the memory is full.
    #[must_use]
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Spawn { source, .. }
            if matches!(source.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::OutOfMemory | io::ErrorKind::Interrupted))
    }
}

/// Starts, watches and ends attempts.
pub trait Executor: Send {
    /// Name of the executor in the table of allocations.
    fn kind(&self) -> &'static str;

    /// Number of attempts that the executor would take now.
    fn free(&self) -> usize;

    /// Starts an attempt. If the attempt is claimed already, no work is done twice.
    fn submit(
        &mut self,
        order: Order,
    ) -> impl Future<Output = Result<ExternalId, DispatchError>> + Send;

    /// Looks for an attempt of an earlier coordinator, and watches it if it is alive.
    ///
    /// # Errors
    /// [`DispatchError::File`] if its directory cannot be read.
    fn adopt(&mut self, attempt: &AttemptId, directory: &Path) -> Result<Found, DispatchError>;

    /// Revokes an attempt unless it has published, and ends its process: by a request first and by
    /// force after a while, or by force at once if `now`. Returns whether a process is still
    /// watched, whose end will be reported by [`Executor::news`]. If not, [`Executor::adopt`] finds
    /// an outcome that was published before.
    ///
    /// # Errors
    /// [`DispatchError::File`] if the revocation cannot be written.
    fn stop(
        &mut self,
        attempt: &AttemptId,
        directory: &Path,
        now: bool,
    ) -> Result<bool, DispatchError>;

    /// Waits for events. Dropping the future loses none.
    fn news(&mut self) -> impl Future<Output = Vec<News>> + Send;
}
