//! Settings of the steps from continuous recordings to one beat, and the whole-heart image.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Volume in the whole-heart image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawImage {
    /// Time from the trigger in the cycle of the cine series.
    pub time_ms: f64,
    /// Volume of the ventricle's cavity.
    #[serde(rename = "volume_mL")]
    pub volume_ml: f64,
    /// Standard deviation of the volume.
    #[serde(rename = "sd_mL", default, skip_serializing_if = "Option::is_none")]
    pub sd_ml: Option<f64>,
}

/// Settings of the steps, in their order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawSteps {
    /// Beginnings of the beats.
    pub beats: BeatsStep,
    /// Rejection of beats.
    pub reject: RejectStep,
    /// Correction of drift in the catheter's zero.
    pub drift: DriftStep,
    /// Averaging of the beats.
    pub average: AverageStep,
    /// Noise of the traces.
    pub noise: NoiseStep,
    /// Adjustment of the volumes to the whole-heart image.
    pub volume: VolumeStep,
    /// Adjustment of the cine series to the cycle of the catheter.
    pub cycle: CycleStep,
    /// Removal of the lag between pressure and volume.
    pub synchronise: SynchroniseStep,
    /// Fit of the Windkessel.
    pub afterload: AfterloadStep,
}

/// Event with which beats begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BeatSource {
    /// R wave of the electrocardiogram.
    RWave,
    /// Rise of the pressure.
    PressureRise,
    /// Times in `onsets_ms`.
    Given,
}

/// Beginnings of the beats.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BeatsStep {
    /// Event with which beats begin; by default the R wave if there is an electrocardiogram.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<BeatSource>,
    /// Beginnings of the beats on the recording's clock, for `source = "given"`.
    pub onsets_ms: Vec<f64>,
}

/// Rejection of beats.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RejectStep {
    /// Whether beats are checked. Beats with missing samples are always left out.
    pub enabled: bool,
    /// Numbers of the beats, from 1, that are kept even if a check rejects them, unless samples are
    /// missing.
    pub keep: Vec<u32>,
    /// Numbers of the beats, from 1, that are always left out.
    pub leave_out: Vec<u32>,
    /// Intervals on the recording's clock whose beats are left out.
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

/// Time at which the zero of the catheter is right.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ZeroAt {
    /// Beginning of the recording.
    #[default]
    Begin,
    /// Middle of the recording.
    Middle,
    /// End of the recording.
    End,
}

/// Correction of drift in the catheter's zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DriftStep {
    /// Whether drift is removed.
    pub enabled: bool,
    /// Time at which the zero is right.
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

/// Averaging of the beats.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AverageStep {
    /// Whether beats are averaged. Otherwise a single beat is used.
    pub enabled: bool,
    /// Whether the rises and falls of the pressure are aligned before averaging.
    pub align: bool,
    /// Cycle length of the mean beat; by default the median.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle_length_ms: Option<f64>,
    /// Number of the beat that is used if beats are not averaged; by default the beat closest to
    /// the mean.
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

/// Quantity to which the stated noise refers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoiseOf {
    /// Uncertainty of the mean beat.
    #[default]
    Mean,
    /// Difference of a single beat from the mean.
    Beat,
}

/// Noise of the traces as stated in the patient file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseStep {
    /// Whether the noise is estimated from the recordings.
    pub enabled: bool,
    /// Quantity to which the noise refers.
    pub of: NoiseOf,
    /// Root mean square of the pressure noise; by default from the differences between beats.
    #[serde(rename = "pressure_rms_mmHg", skip_serializing_if = "Option::is_none")]
    pub pressure_rms_mmhg: Option<f64>,
    /// Correlation time of the pressure noise; by default from the differences between beats.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_correlation_ms: Option<f64>,
    /// Root mean square of the volume noise of a frame; by default from the frames.
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

/// Method to adjust the volumes of the cine series to the whole-heart image.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VolumeAdjustment {
    /// Multiplication by a factor.
    #[default]
    Scale,
    /// Addition of a constant.
    Shift,
}

/// Adjustment of the volumes to the whole-heart image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VolumeStep {
    /// Whether volumes are adjusted.
    pub enabled: bool,
    /// Method of the adjustment.
    pub adjust: VolumeAdjustment,
    /// Factor on the volumes; by default the factor from the whole-heart image.
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

/// Adjustment of the cine series to the cycle of the catheter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CycleStep {
    /// Whether systole and diastole are scaled separately. Otherwise the whole cycle is scaled
    /// uniformly.
    pub enabled: bool,
    /// Factor on systole; by default the ratio of the ejection times.
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

/// Removal of the lag between pressure and volume.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SynchroniseStep {
    /// Whether the lag is removed.
    pub enabled: bool,
    /// Time by which the volume lags behind the pressure; by default from the times at which the
    /// valves open and close.
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

/// Fit of the Windkessel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AfterloadStep {
    /// Whether the Windkessel is fitted.
    pub enabled: bool,
}

impl Default for AfterloadStep {
    fn default() -> Self {
        Self { enabled: true }
    }
}

/// Format of a laboratory's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FileFormat {
    /// Text export of LabChart (ADInstruments).
    Labchart,
    /// Text export of AcqKnowledge (BIOPAC).
    Acqknowledge,
    /// Text table with any separator, decimal sign and encoding.
    Csv,
    /// Text table as Excel saves it: separator and decimal sign of the country.
    ExcelCsv,
    /// Workbook of Excel or OpenDocument.
    Excel,
    /// Text table of Millar's software, with pressure and volume of the catheter.
    Millar,
    /// Report of cvi42 as text.
    Cvi42,
    /// Volume curve of Segment.
    Segment,
    /// Header of a PhysioNet record in WFDB format.
    Wfdb,
    /// European Data Format, or BDF.
    Edf,
}

impl FileFormat {
    /// Name in settings.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Labchart => "labchart",
            Self::Acqknowledge => "acqknowledge",
            Self::Csv => "csv",
            Self::ExcelCsv => "excel-csv",
            Self::Excel => "excel",
            Self::Millar => "millar",
            Self::Cvi42 => "cvi42",
            Self::Segment => "segment",
            Self::Wfdb => "wfdb",
            Self::Edf => "edf",
        }
    }
}
