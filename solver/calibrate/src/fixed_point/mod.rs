//! Step 1: the fixed point at the organ scale, as a pure function of its history.
//!
//! Source: Jung et al. 2022, Mathematics 10(5):823, section 2.3.1, eqs. 12-15; stop and failure rules are documented in
//! docs/models.md, `fixed-point`. [`decide`] is told everything that was simulated so far and answers with the next
//! parameters or the end. It keeps nothing, so a store can replay it, and a rerun with other settings
//! ([`History::resumed_at`]) goes on from what was simulated before without repeating it.

mod cost;
mod decision;
mod driver;
mod settings;

pub use cost::{Cost, Term, Weights};
pub use decision::{
    Decision, Ending, FixedPointError, History, Iteration, Outcome, PROMISED_FRACTION, Quality,
    content, decide, ended, nothing_new,
};
pub use driver::driver;
pub use settings::validate;

#[cfg(test)]
mod tests;
