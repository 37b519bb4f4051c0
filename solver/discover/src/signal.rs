//! Data of one signal with the covariance of their errors, and residuals made white by it.

use nalgebra::DMatrix;

/// Data of one signal, with the factor that whitens its residuals.
#[derive(Debug, Clone)]
pub struct Signal {
    /// Time of each datum \[ms\], which is the middle of a bin or a frame.
    pub time_ms: Vec<f64>,
    /// Value of each datum, in the signal's unit.
    pub value: Vec<f64>,
    /// Standard deviation of one datum due to noise alone.
    pub noise_sd: f64,
    /// Rows of the inverse of the covariance's lower Cholesky factor, packed.
    whitening: Vec<f64>,
    /// Covariance of the data without the common factor.
    pub(crate) covariance: DMatrix<f64>,
    /// Logarithm of the determinant of the covariance without the common factor.
    pub log_determinant: f64,
    /// Standard deviation of a factor common to all data, whose mean is one.
    factor_sd: f64,
}

/// Whitening of residuals from one model curve, whose values carry the common factor of the data.
///
/// With data d = (1 + s) m + e, where s has standard deviation σ and e has covariance C₀ = L Lᵀ,
/// integration over s gives residuals d − m of covariance C₀ + σ² m mᵀ. The factor multiplies the
/// model's values m. With the measured values in their place, each fit would lie below its data
/// (Peelle's pertinent puzzle; D'Agostini 1994, Nucl Instrum Methods A 346:306). With u = σ L⁻¹ m,
/// the covariance is L (1 + u uᵀ) Lᵀ. Its inverse square root is the symmetric one of the bracket
/// times L⁻¹.
#[derive(Debug, Clone)]
pub struct Whitener<'a> {
    signal: &'a Signal,
    u: Vec<f64>,
    /// Squared norm of `u`.
    square: f64,
}

/// λ/(1 − 1/√(1 + λ)) without cancellation: (1 + B Bᵀ)^(−1/2) takes B v vᵀ Bᵀ over this number from
/// unit noise, where v is an eigenvector of Bᵀ B and λ its eigenvalue.
pub(crate) fn dilution(eigenvalue: f64) -> f64 {
    let root = (1.0 + eigenvalue).sqrt();
    root * (1.0 + root)
}

impl Whitener<'_> {
    /// Whitened residuals (1 + u uᵀ)^(−1/2) L⁻¹ r of residuals r.
    #[must_use]
    pub fn whiten(&self, residual: &[f64]) -> Vec<f64> {
        let mut white = self.signal.solve_factor(residual);
        let along: f64 = self.u.iter().zip(&white).map(|(u, w)| u * w).sum();
        let share = along / dilution(self.square);
        white
            .iter_mut()
            .zip(&self.u)
            .for_each(|(w, u)| *w -= share * u);
        white
    }

    /// Logarithm of the determinant added by the common factor, ln(1 + |u|²).
    #[must_use]
    pub fn factor_log_determinant(&self) -> f64 {
        self.square.ln_1p()
    }
}

impl Signal {
    /// # Panics
    /// If the covariance is not positive definite, which noise on the diagonal excludes.
    pub(crate) fn new(
        time_ms: Vec<f64>,
        value: Vec<f64>,
        noise_sd: f64,
        covariance: DMatrix<f64>,
        factor_sd: f64,
    ) -> Self {
        let (whitening, log_determinant) = packed_inverse_factor(&covariance);
        Self {
            time_ms,
            value,
            noise_sd,
            whitening,
            covariance,
            log_determinant,
            factor_sd,
        }
    }

    /// Smallest and largest value.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        self.value
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)))
    }

    /// Number of data in the signal.
    #[must_use]
    pub fn len(&self) -> usize {
        self.value.len()
    }

    /// Whether there are no data.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.value.is_empty()
    }

    /// Data minus model.
    ///
    /// - `model`: values of the model at the times of the data
    #[must_use]
    pub fn residual(&self, model: &[f64]) -> Vec<f64> {
        self.value.iter().zip(model).map(|(v, m)| v - m).collect()
    }

    /// Product of L⁻¹ with `x`.
    pub(crate) fn solve_factor(&self, x: &[f64]) -> Vec<f64> {
        let mut row = 0;
        (0..x.len())
            .map(|i| {
                let weights = &self.whitening[row..=row + i];
                row += i + 1;
                weights.iter().zip(x).map(|(w, x)| w * x).sum()
            })
            .collect()
    }

    /// u of the common factor; empty without one.
    ///
    /// - `model`: values of the model at the times of the data
    pub(crate) fn white_factor(&self, model: &[f64]) -> Vec<f64> {
        if self.factor_sd <= 0.0 {
            return Vec::new();
        }
        let scaled: Vec<f64> = model.iter().map(|m| self.factor_sd * m).collect();
        self.solve_factor(&scaled)
    }

    /// Whitening of residuals from a model.
    ///
    /// - `model`: values of the model at the times of the data
    #[must_use]
    pub fn whitener(&self, model: &[f64]) -> Whitener<'_> {
        let u = self.white_factor(model);
        Whitener {
            signal: self,
            square: u.iter().map(|u| u * u).sum(),
            u,
        }
    }

    /// White residuals, data minus model.
    ///
    /// - `model`: values of the model at the times of the data
    #[must_use]
    pub fn white(&self, model: &[f64]) -> Vec<f64> {
        self.whitener(model).whiten(&self.residual(model))
    }

    /// Standard deviation of the mean error of the data at some indices.
    ///
    /// - `model`: values of the model at the times of all data
    #[must_use]
    pub fn mean_sd(&self, positions: &[usize], model: &[f64]) -> f64 {
        let own: f64 = positions
            .iter()
            .flat_map(|i| positions.iter().map(|j| self.covariance[(*i, *j)]))
            .sum();
        let common = self.factor_sd * positions.iter().map(|i| model[*i]).sum::<f64>();
        (own + common * common).sqrt() / positions.len().max(1) as f64
    }

    /// The same signal with other values, for a simulated patient.
    #[must_use]
    pub fn with_values(&self, value: Vec<f64>) -> Self {
        Self {
            value,
            ..self.clone()
        }
    }

    /// The data at these indices, with their own covariance.
    #[must_use]
    pub fn subset(&self, keep: &[usize]) -> Self {
        let pick = |v: &[f64]| keep.iter().map(|i| v[*i]).collect::<Vec<_>>();
        let covariance = DMatrix::from_fn(keep.len(), keep.len(), |r, c| {
            self.covariance[(keep[r], keep[c])]
        });
        Self::new(
            pick(&self.time_ms),
            pick(&self.value),
            self.noise_sd,
            covariance,
            self.factor_sd,
        )
    }
}

/// Packed rows of L⁻¹, where C = L Lᵀ, and ln det C.
fn packed_inverse_factor(covariance: &DMatrix<f64>) -> (Vec<f64>, f64) {
    let n = covariance.nrows();
    let factor = covariance
        .clone()
        .cholesky()
        .expect("a covariance with noise on its diagonal is positive definite")
        .l();
    let inverse = factor
        .solve_lower_triangular(&DMatrix::identity(n, n))
        .expect("the factor's diagonal is positive");
    let packed = (0..n)
        .flat_map(|r| (0..=r).map(move |c| (r, c)))
        .map(|(r, c)| inverse[(r, c)])
        .collect();
    (
        packed,
        2.0 * factor.diagonal().iter().map(|d| d.ln()).sum::<f64>(),
    )
}
