//! Step 1: the fixed point at the organ scale, as a pure function of its history.
//!
//! Source: Jung et al. 2022, Mathematics 10(5):823, section 2.3.1, eqs. 12-15; docs/models.md,
//! `fixed-point`, describes the rules for stops and failures. [`decide`] takes everything simulated
//! so far and returns the next parameters or the end. It holds no state, so that a store can replay
//! it. A rerun with other settings ([`History::resumed_at`]) continues from earlier simulations
//! without repeating them.

mod cost;
mod decision;
mod driver;
mod error;
mod settings;

pub use cost::{Cost, Term, Weights};
pub use decision::{
    Decision, Ending, History, Iteration, Outcome, PROMISED_FRACTION, Quality, content, decide,
    ended, nothing_new,
};
pub use driver::driver;
pub use error::FixedPointError;
pub use settings::validate;

#[cfg(test)]
mod tests;
