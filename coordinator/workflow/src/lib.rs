//! A patient's workflow as pure functions: state machines, the verdict on outcomes, and the
//! derivation of the next task. No clock, file, database or `async`.
//!
//! Three identities are never mixed. A **task** ([`task`]) is a wanted result. An **attempt**
//! ([`attempt`]) is one try at it in a directory of its own. An **allocation** is the resources
//! that a scheduler gave (a table of the store; the local executor has one per coordinator
//! process). A **patient** ([`patient`]) proceeds along a chain of tasks.
//!
//! Each machine is one total function `on(state, event)`. Commands that make no sense are errors.
//! Observations (late, repeated, lost or found again) are never errors, and have no effect that
//! they should not have.

pub mod attempt;
pub mod cell_fit;
pub mod chain;
pub mod cluster_job;
pub mod derivation;
pub mod judge;
mod organ_fit;
pub mod patient;
pub mod pilots;
mod stream;
pub mod task;

#[cfg(test)]
mod golden;
#[cfg(test)]
mod tests;

/// A command that makes no sense in the present state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{machine} is {state}: unexpected event `{event}`")]
pub struct IllegalTransition {
    /// Name of the machine: `patient`, `task`, `attempt` or `cluster job`.
    pub machine: &'static str,
    /// Name of the present state.
    pub state: String,
    /// Name of the command.
    pub event: String,
}
