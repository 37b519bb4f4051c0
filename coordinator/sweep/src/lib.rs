//! Sweeps: the content of a sweep's folder, its tasks, and the results computed from their
//! outcomes.
//!
//! A sweep is a run of the engine like any other, whose members are the sweep's elements. The
//! engine provides progress, resume, retry and cancel. This module makes members from a
//! specification and results from their outcomes.

pub mod discovery;
mod error;
pub mod folder;
pub mod gsa;
pub mod robustness;

pub use error::SweepError;
