//! A patient's workflow, pure: state machines, the verdict on outcomes, and what follows from what. No clock, no file, no
//! database, no `async`.
//!
//! Three identities are never mixed. A **task** ([`task`]) is what is wanted, an **attempt** ([`attempt`]) is one try at
//! it in its own directory, an **allocation** is what a scheduler gave (the store's table; the local executor has one
//! for each coordinator's life). A **patient** ([`patient`]) walks along a chain of tasks.
//!
//! Each machine is one total function `on(state, event)`. Commands that make no sense are errors; observations (late,
//! doubled, lost and found) never are, and change nothing that they should not.

pub mod attempt;
pub mod cell_fit;
pub mod chain;
pub mod cluster_job;
pub mod derivation;
pub mod judge;
mod organ_fit;
pub mod patient;
pub mod task;

#[cfg(test)]
mod golden;
#[cfg(test)]
mod tests;

/// A command that makes no sense in the present state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{machine} is {state}: `{event}` makes no sense there")]
pub struct IllegalTransition {
    /// `patient`, `task` or `attempt`.
    pub machine: &'static str,
    /// Present state, as printed.
    pub state: String,
    /// The command, as printed.
    pub event: String,
}
