//! Settings of the posterior.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the posterior's sampling after step 3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PosteriorSettings {
    /// Whether the posterior is sampled.
    pub enabled: bool,
    /// Number of draws.
    // The 5 % quantile of fewer draws is the smallest of them.
    #[schemars(range(min = 40, max = 100_000))]
    pub draws: u32,
    /// Correlation time of the discrepancy between model and data that is not noise.
    #[schemars(extend("minimum" = 1.0, "maximum" = 1e4))]
    pub discrepancy_correlation_ms: f64,
    /// Factor on the standard deviations of the data's errors. It was calibrated on simulated
    /// patients so that intervals contain the true values as often as they claim (docs/step3.md).
    #[schemars(extend("minimum" = 0.1, "maximum" = 10.0))]
    pub error_factor: f64,
}

impl Default for PosteriorSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            draws: 100,
            discrepancy_correlation_ms: 100.0,
            error_factor: 1.4,
        }
    }
}
