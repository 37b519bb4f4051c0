//! Uncertainty of a fit: draws from the posterior distribution of parameters, given data with
//! Gaussian errors.
//!
//! The method is randomised maximum likelihood (Kitanidis 1995, Water Resour. Res. 31:2411; Oliver,
//! He and Reynolds 1996; Chen and Oliver 2012, Math. Geosci. 44:1): each draw is the best
//! compromise between the data with random errors added and a draw from the prior. The draws follow
//! the posterior exactly if the model is linear, and approximately if it is not. The share of true
//! values that the intervals cover for simulated data shows the quality of the approximation
//! (docs/step3.md). Draws have independent random numbers and share derivatives: there is no burn-in,
//! and the caller can compute each round in parallel.
//!
//! Each parameter is transformed so that its prior is standard normal ([`TruncatedNormal`]). Bounds
//! then need no special treatment, and a direction without information in the data costs nothing.

mod draw;
mod ensemble;
mod errors;
mod mode;
mod points;

pub use crate::descent::Evaluated;
pub use crate::truncated_normal::TruncatedNormal;
pub use draw::Draw;
pub use ensemble::{Ensemble, Next};
pub use errors::TraceErrors;
pub use mode::{Mode, mode};

/// The model and the prior.
#[derive(Clone, Copy)]
pub struct Target<'a, Q> {
    /// Prior of each parameter.
    pub prior: &'a [TruncatedNormal],
    /// The model as a function of the parameters in their own coordinates; `None` if it has no
    /// result, which counts as impossible.
    pub model: &'a (dyn Fn(&[f64]) -> Option<Evaluated<Q>> + Sync),
}

impl<Q> Target<'_, Q> {
    /// Converts standard coordinates to parameters in their own coordinates.
    #[must_use]
    pub fn parameters(&self, u: &[f64]) -> Vec<f64> {
        u.iter()
            .zip(self.prior)
            .map(|(u, prior)| prior.from_standard(*u))
            .collect()
    }

    /// Converts parameters to the coordinates in which the prior is standard normal.
    #[must_use]
    pub fn standard(&self, parameters: &[f64]) -> Vec<f64> {
        parameters
            .iter()
            .zip(self.prior)
            .map(|(x, prior)| prior.to_standard(*x))
            .collect()
    }

    fn at(&self, u: &[f64]) -> Option<Evaluated<Q>> {
        (self.model)(&self.parameters(u))
            .filter(|found| found.residuals.iter().all(|r| r.is_finite()))
    }
}

#[cfg(test)]
mod tests;
