//! Measurements of a patient besides pressure and volume of one steady beat, which the search for
//! missing effects uses where they are there.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::input_file::InputFile;

pub use cardiotwin_vocabulary::measurements::FurtherQuantity;

/// Further traces over the same cycle, on the clock of pressure and volume.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FurtherTraces {
    /// Pressure in the aorta above the valve, by a catheter of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aortic_pressure: Option<PressureTrace>,
    /// Flow through the aortic valve, positive out of the ventricle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aortic_flow: Option<FlowTrace>,
    /// Flow through the mitral valve, positive into the ventricle; blood that leaks back is negative.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mitral_flow: Option<FlowTrace>,
    /// Pressure in the left atrium, or a wedge pressure with its delay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub atrial_pressure: Option<AtrialPressureTrace>,
    /// Strain of the whole wall, circumferential or longitudinal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strain: Option<StrainTrace>,
}

/// A pressure trace in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PressureTrace {
    /// File with the columns `time_ms,pressure_mmHg`, relative to `patient.toml`.
    pub file: String,
    /// Root mean square of the noise.
    #[serde(rename = "rms_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub rms_mmhg: Option<f64>,
    /// Exponential correlation time of the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_ms: Option<f64>,
}

/// Pressure of the left atrium in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AtrialPressureTrace {
    /// File with the columns `time_ms,pressure_mmHg`, relative to `patient.toml`.
    pub file: String,
    /// Root mean square of the noise.
    #[serde(rename = "rms_mmHg", default, skip_serializing_if = "Option::is_none")]
    pub rms_mmhg: Option<f64>,
    /// Exponential correlation time of the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_ms: Option<f64>,
    /// Delay of a wedge pressure against the atrium; absent for a catheter in the atrium.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_ms: Option<f64>,
    /// Standard deviation of the delay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_sd_ms: Option<f64>,
}

/// A flow trace in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlowTrace {
    /// File with the columns `time_ms,flow_mL_per_s`, relative to `patient.toml`.
    pub file: String,
    /// Root mean square of the noise of a frame.
    #[serde(
        rename = "rms_mL_per_s",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub rms_ml_per_s: Option<f64>,
    /// Exponential correlation time of the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_ms: Option<f64>,
}

/// A strain trace in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StrainTrace {
    /// File with the columns `time_ms,strain_percent`, relative to `patient.toml`; zero at time zero,
    /// negative where the wall is shorter.
    pub file: String,
    /// Root mean square of the noise of a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_percent: Option<f64>,
    /// Exponential correlation time of the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_ms: Option<f64>,
}

/// Times of the valves by heart sounds or echo, from the zero of the traces.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ValveTimes {
    /// Time at which the aortic valve opens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aortic_opening_ms: Option<f64>,
    /// Time at which the aortic valve closes (second heart sound).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aortic_closure_ms: Option<f64>,
    /// Time at which the mitral valve opens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mitral_opening_ms: Option<f64>,
    /// Time at which the mitral valve closes (first heart sound).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mitral_closure_ms: Option<f64>,
    /// Standard deviation of the times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sd_ms: Option<f64>,
}

/// Width of QRS in the electrocardiogram.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct QrsWidth {
    /// Duration of QRS.
    pub duration_ms: f64,
    /// Standard deviation of the duration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd_ms: Option<f64>,
}

/// A steady beat of the same heart under another load, with its own filling pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadedBeat {
    /// File with the columns `time_ms,pressure_mmHg`, relative to `patient.toml`.
    pub pressure: String,
    /// File with the columns `time_ms,volume_mL`, relative to `patient.toml`.
    pub volume: String,
    /// Cycle length of this beat; the patient's if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cycle_length_ms: Option<f64>,
}

/// A further trace of a patient's file, whatever its quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatedTrace<'a> {
    /// Quantity of the trace.
    pub quantity: FurtherQuantity,
    /// File of the trace.
    pub file: &'a str,
    /// Root mean square of the noise, in the unit of the quantity.
    pub rms: Option<f64>,
    /// Exponential correlation time of the noise.
    pub correlation_ms: Option<f64>,
    /// Delay against the heart.
    pub delay_ms: Option<f64>,
    /// Standard deviation of the delay.
    pub delay_sd_ms: Option<f64>,
}

impl StatedTrace<'_> {
    /// The trace as a task reads it, in this file.
    #[must_use]
    pub fn with_file(&self, file: InputFile) -> FurtherTraceSpec {
        FurtherTraceSpec {
            quantity: self.quantity,
            file,
            rms: self.rms,
            correlation_ms: self.correlation_ms,
            delay_ms: self.delay_ms,
            delay_sd_ms: self.delay_sd_ms,
        }
    }
}

impl FurtherTraces {
    /// The traces that are there.
    #[must_use]
    pub fn stated(&self) -> Vec<StatedTrace<'_>> {
        let trace = |quantity, file, rms, correlation_ms| StatedTrace {
            quantity,
            file,
            rms,
            correlation_ms,
            delay_ms: None,
            delay_sd_ms: None,
        };
        let pressure = self.aortic_pressure.as_ref().map(|t| {
            let quantity = FurtherQuantity::AorticPressure;
            trace(quantity, t.file.as_str(), t.rms_mmhg, t.correlation_ms)
        });
        let flows = [
            (FurtherQuantity::AorticFlow, &self.aortic_flow),
            (FurtherQuantity::MitralFlow, &self.mitral_flow),
        ];
        let flows = flows.into_iter().filter_map(|(quantity, flow)| {
            let t = flow.as_ref()?;
            Some(trace(
                quantity,
                t.file.as_str(),
                t.rms_ml_per_s,
                t.correlation_ms,
            ))
        });
        let atrial = self.atrial_pressure.as_ref().map(|t| StatedTrace {
            delay_ms: t.delay_ms,
            delay_sd_ms: t.delay_sd_ms,
            ..trace(
                FurtherQuantity::AtrialPressure,
                t.file.as_str(),
                t.rms_mmhg,
                t.correlation_ms,
            )
        });
        let strain = self.strain.as_ref().map(|t| {
            let quantity = FurtherQuantity::Strain;
            trace(quantity, t.file.as_str(), t.rms_percent, t.correlation_ms)
        });
        (pressure.into_iter().chain(flows))
            .chain(atrial)
            .chain(strain)
            .collect()
    }
}

/// A further trace as a search reads it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FurtherTraceSpec {
    /// Quantity of the trace.
    pub quantity: FurtherQuantity,
    /// File with the trace.
    pub file: InputFile,
    /// Root mean square of the noise, in the unit of the quantity; a usual one if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms: Option<f64>,
    /// Exponential correlation time of the noise; a usual one if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation_ms: Option<f64>,
    /// Delay against the heart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_ms: Option<f64>,
    /// Standard deviation of the delay; a usual one if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_sd_ms: Option<f64>,
}

/// A beat under changed load as a search reads it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LoadedBeatSpec {
    /// Cycle length of this beat.
    pub cycle_length_ms: f64,
    /// File with the measured pressure trace.
    pub pressure: InputFile,
    /// File with the measured volume frames.
    pub volume: InputFile,
}
