//! TaskSpec in, TaskOutcome out: the one place where specifications become solver types.
//!
//! [`run::run_attempt`] is a worker process's whole life: claim an attempt's directory, do the task, publish the
//! outcome. [`tasks::run_task`] is the task alone.

pub mod attempt;
pub mod bench;
pub mod benchmark;
pub mod calcium;
pub mod cell_parameters;
pub mod checkpoint;
pub mod clock;
pub mod context;
pub mod engine;
pub mod error;
pub mod files;
pub mod finite_element;
pub mod igb;
pub mod inputs;
pub mod memory;
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
