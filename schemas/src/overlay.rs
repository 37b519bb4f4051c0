//! The file `model.toml`: results of the program for a patient. It is versioned and older versions
//! are kept; the measured input is never changed.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::discover::{SearchSettings, held_out_confirm};
use crate::organ::{
    EffectSpec, OneFibrePassive, TanhParameters, ValveParameters, WindkesselParameters,
};

/// One version of the values learned about a patient (`model.toml`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelOverlay {
    /// Number of the version, from 1.
    pub version: u32,
    /// Pseudonym of the patient.
    pub patient: String,
    /// Time at which the version was written, UTC, RFC 3339.
    pub written: String,
    /// Tasks on which the version is based: the key of each, by step.
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
    /// Personalised parameters of the cell model, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cell: BTreeMap<String, f64>,
    /// Accepted effects of heart and vessels.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
    /// Artefacts that are removed from the measured traces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub corrections: Vec<EffectSpec>,
    /// Evidence for the accepted effects and corrections.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accepted: Option<Acceptance>,
}

/// Evidence and settings of an acceptance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Acceptance {
    /// Version of the program that wrote it.
    pub program: String,
    /// Version of this file that was current before; absent if there was none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<u32>,
    /// Seed of the search.
    pub seed: u64,
    /// Evidence that an effect needed to be named.
    pub threshold: f64,
    /// Probability that data of the base model alone give evidence as large as this.
    pub p_value: f64,
    /// Rms standardised residual of the base model.
    pub gap_before: f64,
    /// Rms standardised residual with the accepted effects.
    pub gap_after: f64,
    /// Rms standardised residual of the base model on held-out data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_heldout_before: Option<f64>,
    /// Rms standardised residual with the accepted effects on held-out data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_heldout_after: Option<f64>,
    /// Settings of the search that affect its answer.
    pub settings: SearchSettings,
    /// SHA-256 of each measured file, by role.
    pub data: BTreeMap<String, String>,
    /// Evidence for each accepted effect.
    pub evidence: Vec<AcceptedEvidence>,
}

impl Acceptance {
    /// Whether held-out data confirmed the effects.
    #[must_use]
    pub fn is_confirmed(&self) -> bool {
        held_out_confirm(self.gap_heldout_before, self.gap_heldout_after)
    }
}

/// Evidence of an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AcceptedEvidence {
    /// Name in the catalogue.
    pub name: String,
    /// Probability among all candidates, the nameless competitors and "nothing".
    pub probability: f64,
    /// Fall of the deviance less k ln n, where k is the number of the effect's parameters.
    pub delta_bic: f64,
    /// Twice the logarithm of the Bayes factor against the model without the effect.
    pub log_evidence: f64,
    /// Intervals of 95 % by parameter.
    pub interval: BTreeMap<String, [f64; 2]>,
}
