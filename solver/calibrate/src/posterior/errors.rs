//! Gaussian errors of a trace that are correlated in time.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Variance that keeps a covariance from being singular, over the variance of a sample.
const NUGGET: f64 = 1e-6;

/// A measured trace at equal distances in time, and the covariance of its errors.
#[derive(Debug, Clone)]
pub struct TraceErrors {
    measured: Vec<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl TraceErrors {
    /// None for an empty trace, or a covariance that is none.
    ///
    /// - `measured`: samples
    /// - `covariance`: of the errors of two samples, by their indices; the unit is that of `measured`, squared
    #[must_use]
    pub fn new(measured: &[f64], covariance: impl Fn(usize, usize) -> f64) -> Option<Self> {
        let n = measured.len();
        if n == 0 {
            return None;
        }
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            covariance(i, j) * if i == j { 1.0 + NUGGET } else { 1.0 }
        });
        Some(Self {
            measured: measured.to_vec(),
            factor: matrix.cholesky()?,
        })
    }

    /// Differences of a simulated trace to the measured one, transformed so that errors are independent and of standard
    /// deviation 1; as many as samples.
    #[must_use]
    pub fn residuals(&self, simulated: &[f64]) -> Vec<f64> {
        let differences = simulated
            .iter()
            .zip(&self.measured)
            .map(|(simulated, measured)| simulated - measured);
        let mut values = DVector::from_iterator(self.measured.len(), differences);
        // The factor's diagonal is positive, so that this always has a solution.
        self.factor
            .l_dirty()
            .solve_lower_triangular_mut(&mut values);
        values.as_slice().to_vec()
    }
}
