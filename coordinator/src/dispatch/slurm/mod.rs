//! Slurm reached: its commands run with a time limit, and the folder that a job and the coordinator share.
//!
//! What is asked and what an answer means is the crate `cardiotwin-slurm`'s; nothing is decided here.

mod commands;
pub mod folder;

use std::future::Future;

use cardiotwin_slurm::answers::Output;
use cardiotwin_slurm::commands::Command;

pub use commands::Installed;

/// Whoever runs Slurm's commands: the installed ones, or in tests a model of Slurm.
pub trait Scheduler: Send {
    /// Runs a command to its end, or stops waiting for it.
    fn ask(&mut self, command: &Command) -> impl Future<Output = Output> + Send;
}
