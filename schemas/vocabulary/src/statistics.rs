//! Statistics of samples: moments, sensitivity indices, independent samples in coloured noise.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Mean, standard deviation, minimum and maximum.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Moments {
    /// Arithmetic mean of the values.
    pub mean: f64,
    /// Of a sample (divisor n − 1); none for a single value.
    pub standard_deviation: Option<f64>,
    /// Smallest of the values.
    pub minimum: f64,
    /// Largest of the values.
    pub maximum: f64,
}

/// A dimensionless index with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SobolIndex {
    /// Estimate of the index.
    pub value: f64,
    /// Half-width of the interval; absent without resamples.
    pub half_width: Option<f64>,
    /// Number of blocks from which the index was computed.
    pub n_blocks: u64,
}

/// Number of independent samples that coloured residuals stand for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct EffectiveSampleSize {
    /// Correlation time of the residuals.
    pub correlation_time_ms: f64,
    /// Correlation of the residuals of neighbouring beats at the same phase; absent for one beat.
    pub beat_correlation: Option<f64>,
    /// Effective number of samples.
    pub n_effective: f64,
}
