//! The file `prepare.toml`: contents of a folder of recordings, and settings for the derivation of
//! its beat. `cardiotwin prepare` reads it and never edits it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::patient::Preload;

/// A folder of recordings. Every table and key may be absent: files have usual names, steps usual settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawFile {
    /// Pseudonym of the patient; without one the name of the patient's folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Continuous recording of the catheter laboratory.
    pub catheter: RawCatheter,
    /// Volumes of a cine series.
    pub cine: RawCine,
    /// Aortic flow of one cycle, as phase contrast gives it, where it is not among the catheter's columns.
    pub flow: RawFlow,
    /// The whole-heart image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub whole_heart: Option<RawImage>,
    /// Arm cuff.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cuff: Option<RawCuff>,
    /// Anatomy.
    pub anatomy: RawAnatomy,
    /// Filling, taken to the patient as it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preload: Option<Preload>,
    /// How each step is done.
    pub steps: RawSteps,
}

/// The catheter's recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawCatheter {
    /// Its file; `catheter.csv` where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Names of its columns where they are not the keys' own.
    pub columns: CatheterColumns,
}

/// Columns of a catheter's file: for each quantity and unit the column that holds it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CatheterColumns {
    /// Time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<String>,
    /// Time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<String>,
    /// Pressure of the left ventricle.
    #[serde(rename = "lv_pressure_mmHg", skip_serializing_if = "Option::is_none")]
    pub lv_pressure_mmhg: Option<String>,
    /// Pressure of the left ventricle.
    #[serde(rename = "lv_pressure_kPa", skip_serializing_if = "Option::is_none")]
    pub lv_pressure_kpa: Option<String>,
    /// Pressure in the aorta.
    #[serde(
        rename = "aortic_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub aortic_pressure_mmhg: Option<String>,
    /// Pressure in the aorta.
    #[serde(
        rename = "aortic_pressure_kPa",
        skip_serializing_if = "Option::is_none"
    )]
    pub aortic_pressure_kpa: Option<String>,
    /// Flow in the ascending aorta, positive out of the heart.
    #[serde(rename = "flow_mL_per_s", skip_serializing_if = "Option::is_none")]
    pub flow_ml_per_s: Option<String>,
    /// Flow in the ascending aorta, positive out of the heart.
    #[serde(rename = "flow_L_per_min", skip_serializing_if = "Option::is_none")]
    pub flow_l_per_min: Option<String>,
    /// Electrocardiogram.
    #[serde(rename = "ecg_mV", skip_serializing_if = "Option::is_none")]
    pub ecg_mv: Option<String>,
    /// Electrocardiogram.
    #[serde(rename = "ecg_uV", skip_serializing_if = "Option::is_none")]
    pub ecg_uv: Option<String>,
}

/// The cine series.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawCine {
    /// Its file, a line a frame; `cine.csv` where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Its cycle length; without it one frame's step after the last frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle_length_ms: Option<f64>,
    /// Names of its columns where they are not the keys' own.
    pub columns: VolumeColumns,
}

/// Columns of a file of volumes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VolumeColumns {
    /// Time from the trigger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<String>,
    /// Time from the trigger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<String>,
    /// Cavity volume.
    #[serde(rename = "volume_mL", skip_serializing_if = "Option::is_none")]
    pub volume_ml: Option<String>,
}

/// Aortic flow of one cycle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawFlow {
    /// Its file; `flow.csv` where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Standard deviation of the volume of a beat that it gives.
    #[serde(rename = "sd_mL", skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
    /// Names of its columns where they are not the keys' own.
    pub columns: FlowColumns,
}

/// Columns of a file of flow.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlowColumns {
    /// Time from the trigger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_ms: Option<String>,
    /// Time from the trigger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<String>,
    /// Flow in the ascending aorta, positive out of the heart.
    #[serde(rename = "flow_mL_per_s", skip_serializing_if = "Option::is_none")]
    pub flow_ml_per_s: Option<String>,
    /// Flow in the ascending aorta, positive out of the heart.
    #[serde(rename = "flow_L_per_min", skip_serializing_if = "Option::is_none")]
    pub flow_l_per_min: Option<String>,
}

/// The whole-heart image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawImage {
    /// Time from the trigger, in the cine's cycle.
    pub time_ms: f64,
    /// Cavity volume.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Standard deviation.
    #[serde(rename = "sd_mL", default, skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
}

/// Arm cuff.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawCuff {
    /// Systolic.
    #[serde(rename = "systolic_mmHg")]
    pub systolic_mmhg: f64,
    /// Diastolic.
    #[serde(rename = "diastolic_mmHg")]
    pub diastolic_mmhg: f64,
    /// Mean, where the device measures it.
    #[serde(rename = "mean_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub mean_mmhg: Option<f64>,
    /// Standard deviation of each.
    #[serde(rename = "sd_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub sd_mmhg: Option<f64>,
}

/// Anatomy.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawAnatomy {
    /// Volume of the left ventricular wall.
    #[serde(rename = "wall_volume_mL", skip_serializing_if = "Option::is_none")]
    pub wall_volume_ml: Option<f64>,
}

/// The steps, in their order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawSteps {
    /// Where each beat begins.
    pub beats: BeatsStep,
    /// Which beats are left out.
    pub reject: RejectStep,
    /// The catheter's wandering zero.
    pub drift: DriftStep,
    /// The mean beat.
    pub average: AverageStep,
    /// Its noise.
    pub noise: NoiseStep,
    /// The volumes' size.
    pub volume: VolumeStep,
    /// The cine's cycle.
    pub cycle: CycleStep,
    /// The lag between pressure and volume.
    pub synchronise: SynchroniseStep,
    /// The Windkessel.
    pub afterload: AfterloadStep,
}

/// What beats begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BeatSource {
    /// The R wave.
    RWave,
    /// The rise of the pressure.
    PressureRise,
    /// The times in `onsets_ms`.
    Given,
}

/// Where each beat begins.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BeatsStep {
    /// From what; without it from the R wave where there is an electrocardiogram.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<BeatSource>,
    /// Beginnings on the recording's clock, for `source = "given"`.
    pub onsets_ms: Vec<f64>,
}

/// Which beats are left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RejectStep {
    /// Whether beats are judged; those with missing samples are left out always.
    pub enabled: bool,
    /// Numbers of beats, from 1, that are kept.
    pub keep: Vec<u32>,
    /// Numbers of beats, from 1, that are left out.
    pub leave_out: Vec<u32>,
    /// Stretches on the recording's clock whose beats are left out.
    pub leave_out_ms: Vec<[f64; 2]>,
}

impl Default for RejectStep {
    fn default() -> Self {
        Self {
            enabled: true,
            keep: Vec::new(),
            leave_out: Vec::new(),
            leave_out_ms: Vec::new(),
        }
    }
}

/// Where a catheter's zero is right.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ZeroAt {
    /// At the recording's begin.
    #[default]
    Begin,
    /// In its middle.
    Middle,
    /// At its end.
    End,
}

/// The catheter's wandering zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DriftStep {
    /// Whether drift is taken out.
    pub enabled: bool,
    /// Where the zero is right.
    pub zero_at: ZeroAt,
}

impl Default for DriftStep {
    fn default() -> Self {
        Self {
            enabled: true,
            zero_at: ZeroAt::Begin,
        }
    }
}

/// The mean beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AverageStep {
    /// Whether beats are averaged; if not, one is taken.
    pub enabled: bool,
    /// Whether rises and falls of pressure are laid on each other.
    pub align: bool,
    /// Cycle length of the mean; without it the median.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle_length_ms: Option<f64>,
    /// Number of the beat that is taken where none are averaged; without it the one nearest to the mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beat: Option<u32>,
}

impl Default for AverageStep {
    fn default() -> Self {
        Self {
            enabled: true,
            align: true,
            cycle_length_ms: None,
            beat: None,
        }
    }
}

/// Whose noise is stated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseOf {
    /// What the mean is uncertain by.
    #[default]
    Mean,
    /// What one beat differs from the mean by.
    Beat,
}

/// Noise, as the patient's file states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseStep {
    /// Whether it is taken from the recordings.
    pub enabled: bool,
    /// Whose.
    pub of: NoiseOf,
    /// Of the pressure, instead of what the beats show.
    #[serde(rename = "pressure_rms_mmHg", skip_serializing_if = "Option::is_none")]
    pub pressure_rms_mmhg: Option<f64>,
    /// Its correlation time, instead of what the beats show.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_correlation_ms: Option<f64>,
    /// Of a frame's volume, instead of what the frames show.
    #[serde(rename = "volume_rms_mL", skip_serializing_if = "Option::is_none")]
    pub volume_rms_ml: Option<f64>,
}

impl Default for NoiseStep {
    fn default() -> Self {
        Self {
            enabled: true,
            of: NoiseOf::Mean,
            pressure_rms_mmhg: None,
            pressure_correlation_ms: None,
            volume_rms_ml: None,
        }
    }
}

/// How cine volumes are brought to the whole-heart image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VolumeAdjustment {
    /// By a factor.
    #[default]
    Scale,
    /// By a shift.
    Shift,
}

/// The volumes' size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VolumeStep {
    /// Whether volumes are adjusted.
    pub enabled: bool,
    /// How.
    pub adjust: VolumeAdjustment,
    /// The factor, instead of the whole-heart image's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor: Option<f64>,
}

impl Default for VolumeStep {
    fn default() -> Self {
        Self {
            enabled: true,
            adjust: VolumeAdjustment::Scale,
            factor: None,
        }
    }
}

/// The cine's cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CycleStep {
    /// Whether systole and diastole are scaled apart; if not, the whole cycle is scaled alike.
    pub enabled: bool,
    /// The factor on systole, instead of the ratio of the ejections.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub systole_factor: Option<f64>,
}

impl Default for CycleStep {
    fn default() -> Self {
        Self {
            enabled: true,
            systole_factor: None,
        }
    }
}

/// The lag between pressure and volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SynchroniseStep {
    /// Whether it is taken out.
    pub enabled: bool,
    /// By so much the volume comes after the pressure, instead of what the valves' events say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lag_ms: Option<f64>,
}

impl Default for SynchroniseStep {
    fn default() -> Self {
        Self {
            enabled: true,
            lag_ms: None,
        }
    }
}

/// The Windkessel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AfterloadStep {
    /// Whether it is fitted.
    pub enabled: bool,
}

impl Default for AfterloadStep {
    fn default() -> Self {
        Self { enabled: true }
    }
}
