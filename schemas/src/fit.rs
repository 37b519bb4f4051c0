//! What `cardiotwin fit` answers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `cardiotwin fit calcium --json`: Rice's calcium (docs/models.md) as fitted to a measured transient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CalciumFitAnswer {
    /// Of the formats.
    pub schema_version: u32,
    /// The trace's file, as it was named.
    pub trace: String,
    /// Time of activation on the trace's clock.
    pub activation_ms: f64,
    /// Resting calcium.
    #[serde(rename = "ca_res_uM")]
    pub ca_res_um: f64,
    /// Peak calcium.
    #[serde(rename = "ca_max_uM")]
    pub ca_max_um: f64,
    /// The longer time constant: the transient is the same with both exchanged.
    pub tau_cr_ms: f64,
    /// The shorter time constant.
    pub tau_cd_ms: f64,
    /// Each parameter, and the mean of both time constants (`tau_mean_ms`), with errors and intervals.
    pub estimates: Vec<FittedQuantity>,
    /// Probability that an interval covers, for independent residuals.
    pub confidence_level: f64,
    /// What the trace tells about the two time constants.
    pub time_constants: TimeConstants,
    /// The same in words.
    pub time_constants_in_words: String,
    /// Number of samples.
    pub n_samples: usize,
    /// Root of the mean squared residual.
    #[serde(rename = "root_mean_square_uM")]
    pub root_mean_square_um: f64,
    /// Correlation of neighbouring residuals: near zero for noise, near one where the curve misses the trace's shape.
    pub residual_correlation: f64,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
    /// What to mind before the values are used.
    pub warnings: Vec<String>,
    /// The result for `cohort.toml`.
    pub cohort_toml: CohortDefaults,
}

/// One fitted quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FittedQuantity {
    /// Name with unit.
    pub name: String,
    /// Best value.
    pub value: f64,
    /// Standard error of the linearised model; absent where it does not hold, as for equal time constants.
    pub standard_error: Option<f64>,
    /// Lower end of the profile's interval; absent where the trace sets none.
    pub lower: Option<f64>,
    /// Upper end of the profile's interval; absent where the trace sets none.
    pub upper: Option<f64>,
}

/// What a trace tells about two time constants that may be exchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TimeConstants {
    /// Two different ones: equal ones do not fit.
    Distinct,
    /// Two different ones fit best, equal ones fit as well within the confidence level.
    Indistinct,
    /// Equal ones fit best.
    Equal,
}

/// Tables for `cohort.toml`, as text.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CohortDefaults {
    /// Step 2 holds calcium at the fitted values and fits the other parameters.
    pub frozen: String,
    /// Step 2 fits calcium within the intervals.
    pub bounds: String,
}
