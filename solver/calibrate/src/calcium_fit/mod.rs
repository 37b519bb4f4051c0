//! Rice's four parameters from a measured calcium transient, with intervals and what the trace does not tell.
//!
//! Source: Jung et al. 2022, Appendix B.3: least squares over all samples (their minimiser is Powell's; ours is
//! Levenberg and Marquardt's, which also gives errors). The transient does not change when its two time constants are
//! exchanged, so that they cannot be fitted as such where they are close: both act alike there. The fit runs over their
//! mean m and their asymmetry u instead, τ = m (1 ± √u) with u from 0, in which the curve is smooth at equal constants too.
//! A trace that is narrower than any transient of its rise and decay pushes u against 0: both constants come out equal.
//!
//! Intervals are the linearised ones and those of the profile (all values with which the other parameters can be fitted
//! so that the sum of squares rises by less than z² residual variances). Both take residuals as independent of each
//! other; [`CalciumFit::residual_correlation`] tells whether they are.

mod fit;
#[cfg(test)]
mod tests;
mod transient;

pub use fit::{CalciumFitError, CalciumFitSettings, fit_calcium};
use serde::{Deserialize, Serialize};

/// Rice's parameters as they are fitted here: the decay is the slower of the two, though the curve does not know.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RiceParameters {
    /// Resting calcium, µM.
    #[serde(rename = "ca_res_uM")]
    pub ca_res_um: f64,
    /// Peak calcium, µM.
    #[serde(rename = "ca_max_uM")]
    pub ca_max_um: f64,
    /// The longer time constant (or both), ms.
    pub tau_cr_ms: f64,
    /// The shorter time constant (or both), ms.
    pub tau_cd_ms: f64,
}

/// One fitted quantity in its unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// Standard error of the linearised model; none where it does not hold, as for equal time constants.
    pub standard_error: Option<f64>,
    /// Lower end of the profile's interval; none if the trace sets none within the limits.
    pub lower: Option<f64>,
    /// Upper end of the profile's interval; none if the trace sets none within the limits.
    pub upper: Option<f64>,
}

/// What the trace tells about the two time constants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeConstants {
    /// Two different ones: equal ones do not fit.
    Distinct,
    /// Two different ones fit best, equal ones fit as well within the confidence level.
    Indistinct,
    /// Equal ones fit best.
    Equal,
}

impl TimeConstants {
    /// A sentence for reports.
    #[must_use]
    pub fn explanation(self) -> &'static str {
        match self {
            Self::Distinct => {
                "the trace tells two time constants apart, but not which of them is the rise's: the transient is the \
                 same with both exchanged"
            }
            Self::Indistinct => {
                "two equal time constants fit the trace as well: only their mean is determined, and the transient is \
                 the same with both exchanged"
            }
            Self::Equal => {
                "the best time constants are equal: the transient is the same with both exchanged, and any difference \
                 makes it wider than the trace"
            }
        }
    }
}

/// A fitted transient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalciumFit {
    /// The parameters.
    pub parameters: RiceParameters,
    /// Resting calcium, µM.
    #[serde(rename = "ca_res_uM")]
    pub ca_res_um: Estimate,
    /// Peak calcium, µM.
    #[serde(rename = "ca_max_uM")]
    pub ca_max_um: Estimate,
    /// The longer time constant, ms.
    pub tau_cr_ms: Estimate,
    /// The shorter time constant, ms.
    pub tau_cd_ms: Estimate,
    /// The mean of both, ms: determined even where each of them is not.
    pub tau_mean_ms: Estimate,
    /// What the trace tells about the two.
    pub time_constants: TimeConstants,
    /// Probability that an interval covers, dimensionless.
    pub confidence_level: f64,
    /// Number of samples.
    pub n_samples: usize,
    /// Root of the mean squared residual, µM.
    #[serde(rename = "root_mean_square_uM")]
    pub root_mean_square_um: f64,
    /// Correlation of neighbouring residuals, dimensionless: near zero for noise; near one where the model misses the
    /// trace's shape or the noise is smooth, and intervals are too narrow by about √((1 + ρ)/(1 − ρ)).
    pub residual_correlation: f64,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
}
