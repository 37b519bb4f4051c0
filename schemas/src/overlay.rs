//! The file `model.toml`: results of the program for a patient. It is versioned and older versions
//! are kept; the measured input is never changed.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::discover::SearchSettings;
use crate::organ::{
    EffectSpec, OneFibrePassive, TanhParameters, ValveParameters, WindkesselParameters,
};

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
    #[serde(
        default,
        rename = "left_atrial_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
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
    /// Artefacts that the measured traces are corrected for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub corrections: Vec<EffectSpec>,
    /// Why effects and corrections were accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accepted: Option<Acceptance>,
}

/// What an acceptance rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Acceptance {
    /// Version of the program that wrote it.
    pub program: String,
    /// The version of this file that was current before; absent where there was none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<u32>,
    /// Seed of the search.
    pub seed: u64,
    /// Evidence that a name needed.
    pub threshold: f64,
    /// Probability that data of the base model alone give evidence as large.
    pub p_value: f64,
    /// Rms standardised residual of the base model.
    pub gap_before: f64,
    /// The same with the accepted effects.
    pub gap_after: f64,
    /// The base model's on data held out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_heldout_before: Option<f64>,
    /// The same with the accepted effects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_heldout_after: Option<f64>,
    /// Settings of the search.
    pub settings: SearchSettings,
    /// SHA-256 of each measured file, by role.
    pub data: BTreeMap<String, String>,
    /// Each accepted effect.
    pub evidence: Vec<AcceptedEvidence>,
}

/// Evidence of an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AcceptedEvidence {
    /// Name in the catalogue.
    pub name: String,
    /// See [`crate::discover::RankedEffect::probability`].
    pub probability: f64,
    /// See [`crate::discover::RankedEffect::delta_bic`].
    pub delta_bic: f64,
    /// See [`crate::discover::RankedEffect::log_evidence`].
    pub log_evidence: f64,
    /// Intervals of 95 %.
    pub interval: BTreeMap<String, [f64; 2]>,
}
