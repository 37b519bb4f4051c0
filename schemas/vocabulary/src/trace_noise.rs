//! Noise of averaged pressure and volume traces.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Noise of averaged traces.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// Root mean square of the pressure noise.
    #[serde(rename = "pressure_rms_mmHg", skip_serializing_if = "Option::is_none")]
    pub pressure_rms_mmhg: Option<f64>,
    /// Exponential correlation time of the pressure noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_correlation_ms: Option<f64>,
    /// Root mean square of the volume noise of a frame.
    #[serde(rename = "volume_rms_mL", skip_serializing_if = "Option::is_none")]
    pub volume_rms_ml: Option<f64>,
    /// Number of frames from which the volume trace was interpolated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_frames: Option<u32>,
}

impl Noise {
    /// Values above zero. A value of zero counts as not stated.
    #[must_use]
    pub fn stated(&self) -> Self {
        let stated = |value: Option<f64>| value.filter(|value| *value > 0.0);
        Self {
            pressure_rms_mmhg: stated(self.pressure_rms_mmhg),
            pressure_correlation_ms: stated(self.pressure_correlation_ms),
            volume_rms_ml: stated(self.volume_rms_ml),
            volume_frames: self.volume_frames.filter(|n| *n > 0),
        }
    }
}
