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
    /// Arterial load.
    pub afterload: WindkesselParameters,
    /// Windkessel pressure Pc at the start of the beat.
    #[serde(rename = "initial_windkessel_pressure_mmHg")]
    pub initial_windkessel_pressure_mmhg: f64,
    /// Constant filling pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Accepted effects, in the order in which they were accepted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
}
