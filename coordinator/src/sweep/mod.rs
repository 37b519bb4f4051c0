//! Sweeps: what a sweep's folder is about, which tasks it consists of, and what follows from their outcomes.
//!
//! A sweep is a run of the engine like any other, whose members are the sweep's elements: progress, resume, retry and
//! cancel are the engine's. Here is what is left: specification to members, outcomes to results.

mod error;
pub mod folder;
pub mod gsa;
pub mod robustness;

pub use error::SweepError;
