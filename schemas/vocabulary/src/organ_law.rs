//! Knowledge about the organ's law before the first beat of an organ.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Gaussian distribution of coefficients, whose mean depends on features of the organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Gaussian {
    /// Mean of each coefficient in an organ of typical features.
    pub mean: Vec<f64>,
    /// Change of the mean per unit of the logarithm of the exponents' factor.
    pub per_log_exponent_factor: Vec<f64>,
    /// Change of the mean per unit of the logarithm of the image's volume, from the typical one.
    pub per_log_image_volume: Vec<f64>,
    /// Covariance, row by row.
    pub covariance: Vec<Vec<f64>>,
}

/// Knowledge about a law before the first beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawPrior {
    /// Coefficients of the pressure.
    pub pressure: Gaussian,
    /// Coefficients of the stretch.
    pub stretch: Gaussian,
    /// Coefficients of the stretch's deviation over the wall.
    pub deviation: Gaussian,
    /// Standard deviation of a sample's pressure from the law \[mmHg\].
    #[serde(rename = "pressure_sd_mmHg")]
    pub pressure_sd_mmhg: f64,
    /// Standard deviation of a sample's mean stretch from the law.
    pub stretch_sd: f64,
    /// Standard deviation of a sample's stretch deviation from the law.
    pub deviation_sd: f64,
    /// Compliance between groups, dimensionless.
    pub compliance: f64,
    /// Typical logarithm of the image's volume over the end-diastolic volume.
    pub typical_log_image_volume: f64,
    /// Smallest and largest logarithm of the exponents' factor that the mean's slope covers.
    pub log_exponent_factor_range: [f64; 2],
    /// Number of organs from which the prior was learned. It is the prior's weight when further organs
    /// teach.
    pub n_organs: f64,
}
