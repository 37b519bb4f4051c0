//! Slurm as pure data and decisions: what its commands are asked and how their answers are read, what its states mean,
//! what follows from each failure, what a site allows, the exact batch scripts, how work is packed into jobs, and a
//! model of Slurm that tests are run against.
//!
//! Nothing here runs a command, reads a file or looks at a clock: a caller hands in texts and times. Three rules hold
//! throughout: an answer that cannot be understood is said to be so, never guessed; absence from the queue is no
//! ending; a refusal that may pass is told from one that will not.
#![deny(missing_docs)]

pub mod answers;
pub mod cancelled;
pub mod commands;
pub mod failure;
pub mod job;
pub mod job_status;
#[cfg(any(test, feature = "model"))]
pub mod model;
pub mod plan;
pub mod reason;
pub mod script;
pub mod site;
pub mod state;
pub mod walltime;
