//! Differential evolution by ask and tell, with `SciPy`'s semantics.
//!
//! Source: Storn and Price 1997, J. Global Optim. 11:341 (DE/best/1/bin), as `scipy.optimize.differential_evolution`
//! runs it and the paper uses it (Jung et al. 2022, section 2.3.2): Latin hypercube start, mutation dithered once a
//! generation, values beyond a bound drawn anew, convergence when the costs' standard deviation falls below a fraction
//! of their mean, then a bounded quasi-Newton [polish](crate::polish).
//!
//! - `deferred`: a generation is one batch, compared with the generation before. The default here: batches run wide.
//! - `immediate`: each trial replaces its member at once, so a batch is one point. `SciPy`'s default, the reference mode.
//!
//! Random numbers depend on seed, generation and candidate only: the answer does not depend on how a batch is computed,
//! and a stored state continues bit for bit.

mod optimiser;
mod settings;
#[cfg(test)]
mod tests;

pub use optimiser::{DifferentialEvolution, Ending, Outcome, Stage};
pub use settings::{Settings, Updating};
