//! `model.toml`: what the program learned about a patient. Versioned; older versions are kept; measured input is
//! never touched.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::organ::{EffectSpec, OneFibrePassive, TanhParameters, ValveParameters, WindkesselParameters};

/// One version of what was learned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelOverlay {
    /// 1 for the first, raised by one at each change.
    pub version: u32,
    /// The patient.
    pub patient: String,
    /// UTC, RFC 3339.
    pub written: String,
    /// Which step wrote it, with the task keys that it rests on.
    pub from: BTreeMap<String, String>,
    /// Fitted or estimated afterload.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub afterload: Option<WindkesselParameters>,
    /// Fitted or estimated filling pressure.
    #[serde(default, rename = "left_atrial_pressure_mmHg", skip_serializing_if = "Option::is_none")]
    pub left_atrial_pressure_mmhg: Option<f64>,
    /// Fitted passive state of the reduced ventricle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passive: Option<OneFibrePassive>,
    /// Personalised Tanh model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tanh: Option<TanhParameters>,
    /// Personalised valves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valves: Option<ValveParameters>,
    /// Personalised cell model, by the names of `organ::CELL_PARAMETERS`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cell: BTreeMap<String, f64>,
    /// Accepted effects.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
}
