//! Loads to which the cavity is coupled, and effects beyond the base model.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use cardiotwin_vocabulary::circulation::{LoopContents, WindkesselParameters};

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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ClosedLoopSpec {
    /// Output of a beat at the start.
    #[serde(rename = "stroke_volume_mL")]
    pub stroke_volume_ml: f64,
    /// Share of the body's resistance that lies between veins and right atrium; absent for the share of
    /// the loop's source.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub venous_share: Option<f64>,
    /// State from which the loop's own values follow; absent where it is that of the beat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<LoopRest>,
    /// What the blood volume follows from; absent where it is the one of the balance at the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filling: Option<LoopFilling>,
    /// Contents of the loop at the beginning of a 3D beat. Where they are absent the worker takes those
    /// of the periodic beat in the organ's law of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contents: Option<LoopContents>,
}

/// Loads and pacing of the patient at rest, from which a loop's resistances, start and times follow.
/// A beat with other loads or pacing differs from the beat at rest by that change alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LoopRest {
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// Filling pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Resistance between arteries and veins of the body.
    #[serde(rename = "peripheral_resistance_mmHg_s_per_mL")]
    pub peripheral_resistance_mmhg_s_per_ml: f64,
}

/// What the blood volume of a loop follows from. The volume is found with the periodic beat.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "by", rename_all = "kebab-case")]
#[schemars(deny_unknown_fields)]
pub enum LoopFilling {
    /// The blood volume itself: what ventricle and chambers hold, and what vessels hold above their
    /// volume without pressure.
    BloodVolume {
        /// Volume.
        #[serde(rename = "volume_mL")]
        volume_ml: f64,
    },
    /// The largest volume of the ventricle in the periodic beat.
    EndDiastolicVolume {
        /// Volume.
        #[serde(rename = "volume_mL")]
        volume_ml: f64,
    },
    /// The mean pressure of the left atrium over the periodic beat.
    LeftAtrialPressure {
        /// Pressure.
        #[serde(rename = "mean_mmHg")]
        mean_mmhg: f64,
    },
}
