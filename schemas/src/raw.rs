//! The file `prepare.toml`: contents of a folder of recordings, and settings for the derivation of
//! its beat. `cardiotwin prepare` reads it and never edits it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::patient::Preload;

pub use cardiotwin_vocabulary::circulation::CuffPressures;
pub use cardiotwin_vocabulary::preparation::{
    AfterloadStep, AverageStep, BeatSource, BeatsStep, CycleStep, DriftStep, FileFormat, NoiseOf,
    NoiseStep, RawImage, RawSteps, RejectStep, SynchroniseStep, VolumeAdjustment, VolumeStep,
    ZeroAt,
};

/// A folder of recordings. All tables and keys are optional: files have default names, and steps
/// have default settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawFile {
    /// Pseudonym of the patient; by default the name of the patient's folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Continuous recording of the catheter laboratory.
    pub catheter: RawCatheter,
    /// Volumes of a cine series.
    pub cine: RawCine,
    /// Aortic flow over one cycle from phase contrast, if flow is not among the columns of the
    /// catheter.
    pub flow: RawFlow,
    /// Volume in the whole-heart image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub whole_heart: Option<RawImage>,
    /// Arm cuff pressures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cuff: Option<CuffPressures>,
    /// Size of the wall.
    pub anatomy: RawAnatomy,
    /// Filling pressure, which is copied to the patient file unchanged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preload: Option<Preload>,
    /// Rules of consistency that these recordings may break, by name (docs/prepare.md lists them).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub accept: Vec<String>,
    /// Settings of each step.
    pub steps: RawSteps,
}

/// Recording of the catheter.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawCatheter {
    /// Name of the file; by default `catheter` with the ending of a
    /// known format.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Format of the file; by default seen from its content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<FileFormat>,
    /// Sheet of a workbook; by default the first one with the columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheet: Option<String>,
    /// Block of a LabChart export, from 1; by default all blocks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub block: Option<usize>,
    /// Names of the columns, if they differ from the keys.
    pub columns: CatheterColumns,
}

/// Columns of a catheter's file: the name of the column for each quantity and unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CatheterColumns {
    /// Column with the time, ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<String>,
    /// Column with the time, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<String>,
    /// Column with the left ventricular pressure, mmHg.
    #[serde(rename = "lv_pressure_mmHg", skip_serializing_if = "Option::is_none")]
    pub lv_pressure_mmhg: Option<String>,
    /// Column with the left ventricular pressure, kPa.
    #[serde(rename = "lv_pressure_kPa", skip_serializing_if = "Option::is_none")]
    pub lv_pressure_kpa: Option<String>,
    /// Column with the aortic pressure, mmHg.
    #[serde(
        rename = "aortic_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub aortic_pressure_mmhg: Option<String>,
    /// Column with the aortic pressure, kPa.
    #[serde(
        rename = "aortic_pressure_kPa",
        skip_serializing_if = "Option::is_none"
    )]
    pub aortic_pressure_kpa: Option<String>,
    /// Column with the flow in the ascending aorta, positive out of the heart, mL/s.
    #[serde(rename = "flow_mL_per_s", skip_serializing_if = "Option::is_none")]
    pub flow_ml_per_s: Option<String>,
    /// Column with the flow in the ascending aorta, positive out of the heart, L/min.
    #[serde(rename = "flow_L_per_min", skip_serializing_if = "Option::is_none")]
    pub flow_l_per_min: Option<String>,
    /// Column with the electrocardiogram, mV.
    #[serde(rename = "ecg_mV", skip_serializing_if = "Option::is_none")]
    pub ecg_mv: Option<String>,
    /// Column with the electrocardiogram, µV.
    #[serde(rename = "ecg_uV", skip_serializing_if = "Option::is_none")]
    pub ecg_uv: Option<String>,
}

/// Volumes of a cine series.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawCine {
    /// Name of the file, which has one line per frame; by default `cine` with the
    /// ending of a known format.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Format of the file; by default seen from its content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<FileFormat>,
    /// Sheet of a workbook; by default the first one with the columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheet: Option<String>,
    /// Cycle length of the cine series; by default the last frame's time plus the step between
    /// frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle_length_ms: Option<f64>,
    /// Names of the columns, if they differ from the keys.
    pub columns: VolumeColumns,
}

/// Columns of a file of volumes: the name of the column for each quantity and unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VolumeColumns {
    /// Column with the time from the trigger, ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<String>,
    /// Column with the time from the trigger, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<String>,
    /// Column with the cavity volume, mL.
    #[serde(rename = "volume_mL", skip_serializing_if = "Option::is_none")]
    pub volume_ml: Option<String>,
}

/// Aortic flow over one cycle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawFlow {
    /// Name of the file; by default `flow` with the ending of a known format.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Format of the file; by default seen from its content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<FileFormat>,
    /// Sheet of a workbook; by default the first one with the columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheet: Option<String>,
    /// Standard deviation of the stroke volume that the flow gives.
    #[serde(rename = "sd_mL", skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
    /// Names of the columns, if they differ from the keys.
    pub columns: FlowColumns,
}

/// Columns of a file of flow: the name of the column for each quantity and unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlowColumns {
    /// Column with the time from the trigger, ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<String>,
    /// Column with the time from the trigger, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<String>,
    /// Column with the flow in the ascending aorta, positive out of the heart, mL/s.
    #[serde(rename = "flow_mL_per_s", skip_serializing_if = "Option::is_none")]
    pub flow_ml_per_s: Option<String>,
    /// Column with the flow in the ascending aorta, positive out of the heart, L/min.
    #[serde(rename = "flow_L_per_min", skip_serializing_if = "Option::is_none")]
    pub flow_l_per_min: Option<String>,
}

/// Size of the wall.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawAnatomy {
    /// Volume of the left ventricular wall.
    #[serde(rename = "wall_volume_mL", skip_serializing_if = "Option::is_none")]
    pub wall_volume_ml: Option<f64>,
}
