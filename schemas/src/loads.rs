//! Loads to which the cavity is coupled, and effects beyond the base model.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use cardiotwin_vocabulary::circulation::WindkesselParameters;

/// An effect beyond the base model with its parameters. The keys of the parameters carry their
/// units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct EffectSpec {
    /// Name in the catalogue, for example `atrial_kick`.
    pub name: String,
    /// Parameters of the effect.
    pub parameters: BTreeMap<String, f64>,
}

/// Loads to which the cavity is coupled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CirculationSpec {
    /// Load of the arteries on the ventricle.
    pub afterload: WindkesselParameters,
    /// Windkessel pressure Pc at the start of the beat.
    #[serde(rename = "initial_windkessel_pressure_mmHg")]
    pub initial_windkessel_pressure_mmhg: f64,
    /// Constant filling pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Accepted effects, in the order of acceptance.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
    /// Loop that closes the circulation; absent for the open circuit, whose atrium has a constant
    /// pressure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closed: Option<ClosedLoopSpec>,
}

/// A loop from the aorta through body, right heart and lungs to a left atrium that contracts. At the
/// start the pressures are in balance with the filling pressure and the output.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ClosedLoopSpec {
    /// Output of a beat at the start.
    #[serde(rename = "stroke_volume_mL")]
    pub stroke_volume_ml: f64,
}
