//! The worker: executes a task specification and returns its outcome. It is the only crate that
//! converts specifications to solver types.
//!
//! [`run::run_attempt`] is the whole life of a worker process: it claims an attempt's directory,
//! executes the task and publishes the outcome. [`tasks::run_task`] only executes the task.

pub mod attempt;
pub mod average_ventricle;
pub mod calcium;
mod call;
pub mod cell_parameters;
pub mod checkpoint;
pub mod clock;
pub mod context;
pub mod engine;
pub mod error;
pub mod files;
pub mod finite_element;
mod follow;
pub mod igb;
pub mod inputs;
pub mod learn;
pub mod memory;
#[cfg(feature = "mpi")]
pub mod mpi;
pub mod nodal;
pub mod opencarp;
pub mod process;
pub mod program;
pub mod progress;
pub mod provenance;
pub mod run;
pub mod sample_log;
pub mod stop;
pub mod tasks;
pub mod team;
