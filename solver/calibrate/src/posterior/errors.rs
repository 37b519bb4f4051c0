//! Gaussian errors of a trace with correlation in time.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Variance that keeps a covariance from being singular, relative to the variance of a sample.
const NUGGET: f64 = 1e-6;

/// A measured trace with equidistant samples, and the covariance of its errors.
#[derive(Debug, Clone)]
pub struct TraceErrors {
    measured: Vec<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl TraceErrors {
    /// Creates the errors of a trace; `None` for an empty trace or a covariance that is not
    /// positive definite.
    ///
    /// - `measured`: samples of the trace
    /// - `covariance`: covariance of the errors of two samples, given their indices, in the squared
    ///   unit of `measured`
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

    /// Differences between a simulated and the measured trace, transformed so that the errors are
    /// independent with standard deviation 1. There is one per sample.
    #[must_use]
    pub fn residuals(&self, simulated: &[f64]) -> Vec<f64> {
        let differences = simulated
            .iter()
            .zip(&self.measured)
            .map(|(simulated, measured)| simulated - measured);
        let mut values = DVector::from_iterator(self.measured.len(), differences);
        // The factor's diagonal is positive, so that a solution always exists.
        self.factor
            .l_dirty()
            .solve_lower_triangular_mut(&mut values);
        values.as_slice().to_vec()
    }
}
