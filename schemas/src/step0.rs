//! Result of step 0: the input that all simulations of a patient share.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::{Biomarkers, NoiseWindows, TimePoints};
use crate::organ::{CirculationSpec, OrganSpec};
use crate::samples::BeatSamples;

/// A quantity that the patient's file lacks and that was estimated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Estimate {
    /// Key of the patient file that the estimate replaces.
    pub key: String,
    /// Value in the unit of the key.
    pub value: f64,
    /// Standard deviation of the value, where the method gives one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Method of the estimate.
    pub method: String,
}

/// Result of step 0: the input that all simulations of this patient share.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PassiveStateResult {
    /// Organ with the fitted passive state.
    pub organ: OrganSpec,
    /// Arterial load, filling pressure and effects.
    pub circulation: CirculationSpec,
    /// Measured biomarkers, from the traces or as given, multiplied by `biomarker_factors`.
    pub measured: Biomarkers,
    /// Factors contained in `measured` if it is a sample of uncertain data instead of the
    /// measurement.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub biomarker_factors: BTreeMap<String, f64>,
    /// Windows over which biomarkers of noisy traces are read, both measured and simulated ones;
    /// absent if the measured traces are smooth.
    #[serde(default, skip_serializing_if = "NoiseWindows::are_none")]
    pub noise_windows: NoiseWindows,
    /// Time points of the measured biomarkers.
    pub time_points: TimePoints,
    /// Samples of the measured traces.
    #[serde(default)]
    pub samples: BeatSamples,
    /// Quantities that were estimated for lack of data.
    pub estimates: Vec<Estimate>,
    /// Volume at the diastasis pressure minus the measured diastasis volume, if both are known.
    #[serde(rename = "diastasis_volume_error_mL")]
    pub diastasis_volume_error_ml: Option<f64>,
    /// Remarks, such as biomarkers with levels that were not reached before the end of the beat.
    pub remarks: Vec<String>,
    /// Effort of step 0 for a finite-element ventricle, by name: iterations, passes, seconds of
    /// each phase.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub counters: BTreeMap<String, f64>,
}
