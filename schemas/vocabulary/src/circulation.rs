//! Parameters of the circulation and pressures measured on it.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Effects that put a part of their own in the place of one that a closed loop has, and that part of
/// the open circuit.
pub const OPEN_CIRCUIT_EFFECTS: [(&str, &str); 3] = [
    ("atrial_kick", "an atrium at constant pressure"),
    ("wave_reflection", "a Windkessel that drains"),
    (
        "ventricular_septal_defect",
        "a right ventricle of given pressure",
    ),
];

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
    /// Compliance C of the arteries.
    #[serde(rename = "compliance_mL_per_mmHg")]
    pub compliance_ml_per_mmhg: f64,
}

/// What the parts of a closed loop hold at one time, by name. All that the loop does later follows from it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LoopContents {
    /// Volume of each chamber and vessel; of a vessel what it holds above its volume without pressure.
    #[serde(rename = "volumes_mL")]
    pub volumes_ml: BTreeMap<String, f64>,
    /// Flow of each path whose blood has inertia, positive in its direction.
    #[serde(rename = "flows_mL_per_s")]
    pub flows_ml_per_s: BTreeMap<String, f64>,
}

/// Arm cuff pressures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CuffPressures {
    /// Systolic pressure.
    #[serde(rename = "systolic_mmHg")]
    pub systolic_mmhg: f64,
    /// Diastolic pressure.
    #[serde(rename = "diastolic_mmHg")]
    pub diastolic_mmhg: f64,
    /// Mean pressure, if the device measures it.
    #[serde(rename = "mean_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub mean_mmhg: Option<f64>,
    /// Standard deviation of each pressure.
    #[serde(rename = "sd_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub sd_mmhg: Option<f64>,
}
