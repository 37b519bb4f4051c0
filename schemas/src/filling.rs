//! What a patient's file holds of the ventricle's filling and its net output, for step 0.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::further::FurtherTraceSpec;
use crate::patient::VolumeWithError;

/// Measurements of filling and output besides pressure and volume of the ventricle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlowMeasurements {
    /// Pressure of the left atrium, or a wedge pressure with its delay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub atrial_pressure: Option<FurtherTraceSpec>,
    /// Flow through the mitral valve.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mitral_flow: Option<FurtherTraceSpec>,
    /// Net forward volume of a beat in the aorta.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forward_stroke_volume: Option<VolumeWithError>,
}

impl FlowMeasurements {
    /// Whether nothing was measured.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Files of the traces, to change where they are.
    pub fn files_mut(&mut self) -> impl Iterator<Item = &mut crate::task::InputFile> {
        [&mut self.atrial_pressure, &mut self.mitral_flow]
            .into_iter()
            .flatten()
            .map(|trace| &mut trace.file)
    }
}
