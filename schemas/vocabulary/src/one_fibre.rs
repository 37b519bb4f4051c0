//! Passive law of the one-fibre ventricle.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Passive one-fibre ventricle after step 0 (Arts 1991; SPEC section 4).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OneFibrePassive {
    /// Volume of the left ventricular wall.
    #[serde(rename = "wall_volume_mL")]
    pub wall_volume_ml: f64,
    /// Cavity volume at zero pressure.
    #[serde(rename = "unloaded_volume_mL")]
    pub unloaded_volume_ml: f64,
    /// Cavity volume at end-diastole, where the beat starts and the stretch of the active law is 1.
    #[serde(rename = "end_diastolic_volume_mL")]
    pub end_diastolic_volume_ml: f64,
    /// Cavity pressure at end-diastole.
    #[serde(rename = "end_diastolic_pressure_mmHg")]
    pub end_diastolic_pressure_mmhg: f64,
    /// Scale s in σ_p = s (e^{bE} − 1).
    #[serde(rename = "stiffness_kPa")]
    pub stiffness_kpa: f64,
    /// Exponent b in σ_p = s (e^{bE} − 1).
    pub exponent: f64,
}
