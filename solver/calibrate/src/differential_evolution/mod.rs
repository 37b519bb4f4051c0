//! Differential evolution with `SciPy`'s semantics and an ask-and-tell interface.
//!
//! Source: Storn and Price 1997, J. Global Optim. 11:341 (DE/best/1/bin), as run by
//! `scipy.optimize.differential_evolution` and used in the paper (Jung et al. 2022, section 2.3.2):
//! start from a Latin hypercube, mutation dithered once per generation, values beyond a bound drawn
//! again, convergence when the standard deviation of the costs falls below a fraction of their
//! mean, then a bounded quasi-Newton [polish](crate::polish).
//!
//! - `deferred`: a generation is one batch, compared with the previous generation. It is the
//!   default here because wide batches run in parallel.
//! - `immediate`: each trial replaces its member at once, so that a batch is one point. It is
//!   `SciPy`'s default and the reference mode.
//!
//! Random numbers depend only on seed, generation and candidate. The result does not depend on how
//! a batch is computed, and a stored state continues bit for bit.

mod optimiser;
mod settings;
#[cfg(test)]
mod tests;

pub use cardiotwin_vocabulary::step2_settings::Updating;
pub use optimiser::{DifferentialEvolution, Outcome, Stage, StopReason};
pub use settings::Settings;
