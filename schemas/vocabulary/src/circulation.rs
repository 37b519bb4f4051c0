//! Parameters of the circulation.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Three-element Windkessel: P = R1 Q + Pc, C dPc/dt = Q − Pc/R2.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct WindkesselParameters {
    /// Characteristic resistance R1.
    #[serde(rename = "characteristic_resistance_mmHg_s_per_mL")]
    pub characteristic_resistance_mmhg_s_per_ml: f64,
    /// Peripheral resistance R2.
    #[serde(rename = "peripheral_resistance_mmHg_s_per_mL")]
    pub peripheral_resistance_mmhg_s_per_ml: f64,
    /// Compliance C.
    #[serde(rename = "compliance_mL_per_mmHg")]
    pub compliance_ml_per_mmhg: f64,
}
