//! Results of `cardiotwin fit`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::fits::TimeConstants;

/// Result of `cardiotwin fit calcium --json`: Rice's calcium (docs/models.md) fitted to a measured
/// transient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CalciumFitAnswer {
    /// Version of the formats.
    pub schema_version: u32,
    /// File of the trace, as named on the command line.
    pub trace: String,
    /// Time of activation on the trace's clock.
    pub activation_ms: f64,
    /// Resting calcium.
    #[serde(rename = "Ca_res_uM", alias = "ca_res_uM")]
    pub ca_res_um: f64,
    /// Peak calcium.
    #[serde(rename = "Ca_max_uM", alias = "ca_max_uM")]
    pub ca_max_um: f64,
    /// Longer time constant. The transient does not change if the two are exchanged.
    #[serde(rename = "tau_CR_ms", alias = "tau_cr_ms")]
    pub tau_cr_ms: f64,
    /// Shorter time constant.
    #[serde(rename = "tau_CD_ms", alias = "tau_cd_ms")]
    pub tau_cd_ms: f64,
    /// Estimates of each parameter and of the mean time constant (`tau_mean_ms`), with errors and
    /// intervals.
    pub estimates: Vec<FittedQuantity>,
    /// Coverage probability of the intervals, for independent residuals.
    pub confidence_level: f64,
    /// Information of the trace about the two time constants.
    pub time_constants: TimeConstants,
    /// Explanation of `time_constants` in words.
    pub time_constants_in_words: String,
    /// Number of samples.
    pub n_samples: usize,
    /// Root of the mean squared residual.
    #[serde(rename = "root_mean_square_uM")]
    pub root_mean_square_um: f64,
    /// Correlation of neighbouring residuals: near zero for noise, near one if the curve does not
    /// follow the shape of the trace.
    pub residual_correlation: f64,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
    /// Points to check before the values are used.
    pub warnings: Vec<String>,
    /// Result as tables for `cohort.toml`.
    pub cohort_toml: CohortDefaults,
}

/// One fitted quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FittedQuantity {
    /// Name with unit.
    pub name: String,
    /// Value of the best fit.
    pub value: f64,
    /// Standard error of the linearised model; absent if that model does not hold, as for equal
    /// time constants.
    pub standard_error: Option<f64>,
    /// Lower end of the interval from the profile likelihood; absent if the trace does not bound
    /// it.
    pub lower: Option<f64>,
    /// Upper end of the interval from the profile likelihood; absent if the trace does not bound
    /// it.
    pub upper: Option<f64>,
}

/// Tables for `cohort.toml`, as text.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CohortDefaults {
    /// Tables with which step 2 holds calcium at the fitted values and fits the other parameters.
    pub frozen: String,
    /// Tables with which step 2 fits calcium within the intervals.
    pub bounds: String,
}
