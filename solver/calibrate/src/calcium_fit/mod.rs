//! Rice's four parameters from a measured calcium transient, with intervals and their limits.
//!
//! Source: Jung et al. 2022, Appendix B.3: least squares over all samples. The paper minimises by
//! Powell's method; this module uses Levenberg–Marquardt, which also gives errors.
//!
//! The transient does not change when its two time constants are exchanged, and both act alike
//! where they are close. They can therefore not be fitted directly. The fit runs over their mean m
//! and their asymmetry u, τ = m (1 ± √u) with u ≥ 0, in which the curve is smooth at equal
//! constants too. A trace narrower than any transient of its rise and decay presses u against 0, so
//! that both constants come out equal.
//!
//! Intervals are given from the linearised model and from the profile (all values at which the
//! other parameters can be fitted so that the sum of squares rises by less than z² residual
//! variances). Both assume independent residuals; [`CalciumFit::residual_correlation`] shows
//! whether they are.

mod fit;
#[cfg(test)]
mod tests;

pub use cardiotwin_models::calcium::Rice2008Parameters;
pub use cardiotwin_vocabulary::fits::TimeConstants;
pub use fit::{CalciumFitError, CalciumFitSettings, fit_calcium};

/// One fitted quantity, in its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Value at which the sum of squares is smallest.
    pub value: f64,
    /// Standard error of the linearised model; `None` where that model fails, as for equal time
    /// constants.
    pub standard_error: Option<f64>,
    /// Lower end of the profile's interval; `None` if the trace sets none within the limits.
    pub lower: Option<f64>,
    /// Upper end of the profile's interval; `None` if the trace sets none within the limits.
    pub upper: Option<f64>,
}

/// A fitted transient.
#[derive(Debug, Clone, PartialEq)]
pub struct CalciumFit {
    /// Best values of the parameters. The first time constant is taken to be the longer one,
    /// although the curve does not determine which is longer.
    pub parameters: Rice2008Parameters,
    /// Calcium at rest, between two transients \[µM\].
    pub ca_res_um: Estimate,
    /// Calcium at the peak of the transient \[µM\].
    pub ca_max_um: Estimate,
    /// Longer of the two time constants \[ms\].
    pub tau_cr_ms: Estimate,
    /// Shorter of the two time constants \[ms\].
    pub tau_cd_ms: Estimate,
    /// Mean of both time constants \[ms\]. It is determined even if the two are not.
    pub tau_mean_ms: Estimate,
    /// Extent to which the trace determines the two time constants.
    pub time_constants: TimeConstants,
    /// Probability that an interval covers the truth, dimensionless.
    pub confidence_level: f64,
    /// Number of samples of the trace.
    pub n_samples: usize,
    /// Root of the mean squared residual, µM.
    pub root_mean_square_um: f64,
    /// Correlation of neighbouring residuals, dimensionless. It is near zero for noise. It is near
    /// one if the model misses the shape of the trace or the noise is smooth; intervals are then
    /// too narrow by about √((1 + ρ)/(1 − ρ)).
    pub residual_correlation: f64,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
}
