//! How sure a fit is: draws from the posterior distribution of parameters, given data with Gaussian errors.
//!
//! Randomised maximum likelihood (Kitanidis 1995, Water Resour. Res. 31:2411; Oliver, He and Reynolds 1996; Chen and Oliver
//! 2012, Math. Geosci. 44:1): each draw is the best compromise between data that errors of their distribution were added to,
//! and a draw of the prior. Draws are of the posterior where the model is linear, and near it where it is not: how near shows
//! in the share of true values that intervals of simulated data hold (docs/step3.md). Draws do not depend on each other, so
//! that none is needed to forget where another began, and whoever owns the model makes them in parallel or not.
//!
//! Each parameter is transformed so that its prior is standard normal ([`TruncatedNormal`]): then bounds need no care, and a
//! direction of which the data say nothing costs nothing.

mod descent;
mod draw;
mod errors;
mod prior;

pub use descent::{Mode, mode};
pub use draw::{Draw, draw};
pub use errors::TraceErrors;
pub use prior::TruncatedNormal;

/// What a model says of parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated<Q> {
    /// Differences to the data, independent and of standard deviation 1 where the model is right.
    pub residuals: Vec<f64>,
    /// Quantities whose distribution is wanted, too.
    pub seen: Q,
}

/// The model and what is known without data.
#[derive(Clone, Copy)]
pub struct Target<'a, Q> {
    /// Of each parameter.
    pub prior: &'a [TruncatedNormal],
    /// From parameters, in their own coordinates; none where the model has no answer, which counts as impossible.
    pub model: &'a (dyn Fn(&[f64]) -> Option<Evaluated<Q>> + Sync),
}

impl<Q> Target<'_, Q> {
    /// Parameters in their own coordinates.
    #[must_use]
    pub fn parameters(&self, u: &[f64]) -> Vec<f64> {
        u.iter()
            .zip(self.prior)
            .map(|(u, prior)| prior.from_standard(*u))
            .collect()
    }

    /// The coordinates in which the prior is standard normal.
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
