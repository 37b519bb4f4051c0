//! Access to Slurm: its commands with a time limit, and the folder that a job and the coordinator
//! share.
//!
//! The rest of the crate makes the commands and interprets their output. This module decides
//! nothing.

mod commands;
pub mod folder;

use std::future::Future;
use std::io;
use std::path::PathBuf;

use crate::answers::Output;
use crate::commands::Command;

pub use commands::Installed;

/// A file of a job's folder cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[error("cannot {what} {path}")]
pub struct FolderError {
    /// Verb of the operation, as in "cannot read".
    pub what: &'static str,
    /// Path of the file.
    pub path: PathBuf,
    /// Error of the operating system.
    pub source: io::Error,
}

/// Runs Slurm's commands: the installed ones or, in tests, the commands of a model of Slurm.
pub trait Scheduler: Send {
    /// Runs a command to its end or to the time limit.
    fn ask(&mut self, command: &Command) -> impl Future<Output = Output> + Send;
}
