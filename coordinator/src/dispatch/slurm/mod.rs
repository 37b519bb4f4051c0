//! Access to Slurm: its commands with a time limit, and the folder that a job and the coordinator
//! share.
//!
//! The crate `cardiotwin-slurm` makes the commands and interprets their output. This module decides
//! nothing.

mod commands;
pub mod folder;

use std::future::Future;

use cardiotwin_slurm::answers::Output;
use cardiotwin_slurm::commands::Command;

pub use commands::Installed;

/// Runs Slurm's commands: the installed ones, or those of a model of Slurm in tests.
pub trait Scheduler: Send {
    /// Runs a command to its end or to the time limit.
    fn ask(&mut self, command: &Command) -> impl Future<Output = Output> + Send;
}
