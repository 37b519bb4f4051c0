//! Whitening of pressure and volume together: errors of the model that both share, and the factor
//! common to all volumes.
//!
//! With noise of covariance L Lᵀ for each signal, shared errors U of unit variance and the common
//! factor's u (see [`crate::signal::Signal`]), the covariance is L (1 + B Bᵀ) Lᵀ with B = L⁻¹ (u U).
//! Its inverse square root is the symmetric one of the bracket, from the eigenvalues of Bᵀ B, times
//! L⁻¹.

use crate::signal::{Signal, dilution};
use nalgebra::{DMatrix, DVector};

/// Errors that pressure and volume share, besides the noise of each.
#[derive(Debug, Clone)]
pub struct SharedErrors {
    /// Errors at the times of pressure, then volume; one column for each.
    errors: DMatrix<f64>,
    /// L⁻¹ times the errors.
    white: DMatrix<f64>,
    /// Products of the white errors with one another.
    gram: DMatrix<f64>,
}

/// White residuals of pressure, then volume.
#[derive(Debug, Clone)]
pub struct White {
    /// Residuals of unit covariance.
    pub residuals: Vec<f64>,
    /// Logarithm of the determinant that errors and factor add to the noise.
    pub log_determinant: f64,
}

impl SharedErrors {
    /// Errors at the times of pressure, then volume: one row a datum.
    ///
    /// # Panics
    /// If the number of rows is not that of all data.
    #[must_use]
    pub fn new([pressure, volume]: [&Signal; 2], errors: DMatrix<f64>) -> Self {
        let n = pressure.len();
        assert_eq!(errors.nrows(), n + volume.len(), "one row a datum");
        let mut white = errors.clone();
        for (own, mut white) in errors.column_iter().zip(white.column_iter_mut()) {
            let own = own.as_slice();
            let both = [
                pressure.solve_factor(&own[..n]),
                volume.solve_factor(&own[n..]),
            ];
            white.copy_from_slice(&both.concat());
        }
        let gram = white.tr_mul(&white);
        Self {
            errors,
            white,
            gram,
        }
    }

    /// The errors of parts of both signals.
    ///
    /// - `rows`: indices of the parts' data among those of pressure, then volume
    #[must_use]
    pub fn part(&self, signals: [&Signal; 2], rows: &[usize]) -> Self {
        Self::new(signals, self.errors.select_rows(rows))
    }

    /// Whitens residuals from a model.
    ///
    /// - `residuals`: data minus model, pressure and volume
    /// - `volume_ml`: the model's volume at the times of the data
    #[must_use]
    pub fn whiten(
        &self,
        [pressure, volume]: [&Signal; 2],
        residuals: [&[f64]; 2],
        volume_ml: &[f64],
    ) -> White {
        let n_p = pressure.len();
        let mut white = pressure.solve_factor(residuals[0]);
        white.extend(volume.solve_factor(residuals[1]));
        let mut white = DVector::from_vec(white);
        let factor = DVector::from_vec(volume.white_factor(volume_ml));
        let (n_errors, n_factor) = (self.gram.nrows(), usize::from(!factor.is_empty()));
        let n = n_errors + n_factor;
        if n == 0 {
            return White {
                residuals: white.as_slice().to_vec(),
                log_determinant: 0.0,
            };
        }
        let of_volume = self.white.rows_range(n_p..);
        let mut gram = DMatrix::zeros(n, n);
        gram.view_mut((0, 0), (n_errors, n_errors))
            .copy_from(&self.gram);
        let mut along = DVector::zeros(n);
        along
            .rows_mut(0, n_errors)
            .copy_from(&self.white.tr_mul(&white));
        if n_factor == 1 {
            let shared = of_volume.tr_mul(&factor);
            gram.view_mut((0, n_errors), (n_errors, 1))
                .copy_from(&shared);
            gram.view_mut((n_errors, 0), (1, n_errors))
                .copy_from(&shared.transpose());
            gram[(n_errors, n_errors)] = factor.norm_squared();
            along[n_errors] = factor.dot(&white.rows_range(n_p..));
        }
        let eigen = gram.symmetric_eigen();
        let mut rotated = eigen.eigenvectors.tr_mul(&along);
        let mut log_determinant = 0.0;
        for (along, value) in rotated.iter_mut().zip(eigen.eigenvalues.iter()) {
            *along /= dilution(value.max(0.0));
            log_determinant += value.max(0.0).ln_1p();
        }
        let shares = eigen.eigenvectors * rotated;
        white -= &self.white * shares.rows(0, n_errors);
        if n_factor == 1 {
            let mut of_volume = white.rows_range_mut(n_p..);
            of_volume.axpy(-shares[n_errors], &factor, 1.0);
        }
        White {
            residuals: white.as_slice().to_vec(),
            log_determinant,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares and determinants of white residuals are those of the whole covariance.
    #[test]
    fn errors_and_factor_are_terms_of_the_covariance() {
        let own = |n: usize, scale: f64| {
            DMatrix::from_fn(n, n, |i, j| {
                scale * (-(i as f64 - j as f64).abs() / 2.0).exp()
            })
        };
        let times = |n: usize| (0..n).map(|i| i as f64).collect::<Vec<f64>>();
        let (n_p, n_v) = (9, 5);
        let n = n_p + n_v;
        let pressure = Signal::new(times(n_p), vec![0.0; n_p], 1.0, own(n_p, 1.4), 0.0);
        let volume = Signal::new(times(n_v), vec![0.0; n_v], 1.0, own(n_v, 2.5), 0.02);
        let errors = DMatrix::from_fn(n, 3, |i, k| ((i * (k + 2)) as f64).sin());
        let signals = [&pressure, &volume];
        let shared = SharedErrors::new(signals, errors.clone());
        let model: Vec<f64> = (0..n_v).map(|i| 80.0 + 7.0 * i as f64).collect();
        let residual: Vec<f64> = (0..n).map(|i| (0.7 * i as f64).cos()).collect();
        let mut whole = &errors * errors.transpose();
        let (own_p, own_v) = (own(n_p, 1.4), own(n_v, 2.5));
        for i in 0..n {
            for j in 0..n {
                whole[(i, j)] += match (i.checked_sub(n_p), j.checked_sub(n_p)) {
                    (None, None) => own_p[(i, j)],
                    (Some(i), Some(j)) => own_v[(i, j)] + 4e-4 * model[i] * model[j],
                    _ => 0.0,
                };
            }
        }
        let white = shared.whiten(signals, [&residual[..n_p], &residual[n_p..]], &model);
        let factor = whole.cholesky().unwrap();
        let r = DVector::from_vec(residual);
        let square: f64 = white.residuals.iter().map(|w| w * w).sum();
        assert!((square / r.dot(&factor.solve(&r)) - 1.0).abs() < 1e-9);
        let of_noise = pressure.log_determinant + volume.log_determinant;
        let log_determinant = of_noise + white.log_determinant;
        assert!((log_determinant - factor.ln_determinant()).abs() < 1e-9);
    }
}
