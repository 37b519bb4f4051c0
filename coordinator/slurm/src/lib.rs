//! Slurm: its commands and the parsers of their answers, the meaning of its states, and the
//! consequences of each failure. Also the limits of a site, batch scripts, and the packing of work.
//!
//! Only [`access`] runs commands and reads files. The rest of the crate is pure data and decisions:
//! it runs no command, reads no file and looks at no clock, because the caller passes texts and
//! times. Three rules hold throughout. An answer that cannot be understood is reported as such,
//! never guessed. Absence from the queue does not mean that a job has ended. A refusal that may
//! pass is distinguished from one that will not.
#![deny(missing_docs)]

pub mod access;
pub mod answers;
pub mod cancelled;
pub mod commands;
pub mod directives;
pub mod failure;
pub mod job;
pub mod job_status;
pub mod judgement;
pub mod plan;
pub mod reason;
pub mod script;
pub mod site;
pub mod state;
pub mod walltime;
