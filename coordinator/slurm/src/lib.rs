//! Slurm as pure data and decisions: its commands and the parsers of their answers, the meaning of
//! its states, the consequences of each failure, the limits of a site, the exact batch scripts, the
//! packing of work into jobs, and a model of Slurm for tests.
//!
//! Nothing in this crate runs a command, reads a file or looks at a clock: the caller passes texts
//! and times. Three rules hold throughout. An answer that cannot be understood is reported as such,
//! never guessed. Absence from the queue does not mean that a job has ended. A refusal that may
//! pass is distinguished from one that will not.
#![deny(missing_docs)]

pub mod answers;
pub mod cancelled;
pub mod commands;
pub mod failure;
pub mod job;
pub mod job_status;
pub mod model;
pub mod plan;
pub mod reason;
pub mod script;
pub mod site;
pub mod state;
pub mod walltime;
