//! Measurements that the search for missing effects reads, besides pressure and volume of the
//! ventricle: the quantities of further traces, and all measurements as suggestions name them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Quantity of a further trace.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum FurtherQuantity {
    /// Pressure in the aorta, mmHg.
    AorticPressure,
    /// Flow through the aortic valve, mL/s.
    AorticFlow,
    /// Flow through the mitral valve, mL/s.
    MitralFlow,
    /// Pressure in the left atrium, mmHg.
    AtrialPressure,
    /// Strain of the whole wall, %.
    Strain,
}

impl FurtherQuantity {
    /// All quantities, in the order of their tables in results.
    pub const ALL: [Self; 5] = [
        Self::AorticPressure,
        Self::AorticFlow,
        Self::MitralFlow,
        Self::AtrialPressure,
        Self::Strain,
    ];

    /// Name in files and results, such as a table's name in `patient.toml`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::AorticPressure => "aortic_pressure",
            Self::AorticFlow => "aortic_flow",
            Self::MitralFlow => "mitral_flow",
            Self::AtrialPressure => "atrial_pressure",
            Self::Strain => "strain",
        }
    }

    /// Unit of the values.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::AorticPressure | Self::AtrialPressure => "mmHg",
            Self::AorticFlow | Self::MitralFlow => "mL/s",
            Self::Strain => "%",
        }
    }

    /// The quantity as a measurement that is suggested.
    #[must_use]
    pub const fn measurement(self) -> Measurement {
        match self {
            Self::AorticPressure => Measurement::AorticPressure,
            Self::AorticFlow => Measurement::AorticFlow,
            Self::MitralFlow => Measurement::MitralFlow,
            Self::AtrialPressure => Measurement::AtrialPressure,
            Self::Strain => Measurement::Strain,
        }
    }
}

/// A measurement with a place in `patient.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Measurement {
    /// Pressure trace of the aorta.
    AorticPressure,
    /// Flow trace of the aortic valve.
    AorticFlow,
    /// Flow trace of the mitral valve.
    MitralFlow,
    /// Pressure trace of the left atrium.
    AtrialPressure,
    /// Strain trace of the whole wall.
    Strain,
    /// Times at which valves open and close.
    ValveTimes,
    /// Duration of QRS.
    Qrs,
    /// A beat under changed load.
    Loaded,
    /// Arm cuff pressure.
    Cuff,
    /// Net forward stroke volume.
    ForwardStrokeVolume,
    /// Volume of a whole-heart image.
    WholeHeartVolume,
}

impl Measurement {
    /// All measurements.
    pub const ALL: [Self; 11] = [
        Self::AorticPressure,
        Self::AorticFlow,
        Self::MitralFlow,
        Self::AtrialPressure,
        Self::Strain,
        Self::ValveTimes,
        Self::Qrs,
        Self::Loaded,
        Self::Cuff,
        Self::ForwardStrokeVolume,
        Self::WholeHeartVolume,
    ];

    /// The measurement in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::AorticPressure => "aortic pressure trace",
            Self::AorticFlow => "aortic flow trace by flow MRI or Doppler",
            Self::MitralFlow => "mitral flow trace by flow MRI or Doppler",
            Self::AtrialPressure => "left atrial or wedge pressure trace",
            Self::Strain => "strain trace of the wall",
            Self::ValveTimes => "times of the valves by echo or heart sounds",
            Self::Qrs => "electrocardiogram (width of QRS)",
            Self::Loaded => "a steady beat at a lower load (partial caval occlusion)",
            Self::Cuff => "arm cuff pressure",
            Self::ForwardStrokeVolume => "forward stroke volume by flow MRI",
            Self::WholeHeartVolume => "volume of a whole-heart image",
        }
    }

    /// Table of `patient.toml` that holds it.
    #[must_use]
    pub const fn table(self) -> &'static str {
        match self {
            Self::AorticPressure => "measured.traces.aortic_pressure",
            Self::AorticFlow => "measured.traces.aortic_flow",
            Self::MitralFlow => "measured.traces.mitral_flow",
            Self::AtrialPressure => "measured.traces.atrial_pressure",
            Self::Strain => "measured.traces.strain",
            Self::ValveTimes => "measured.valve_times",
            Self::Qrs => "measured.qrs",
            Self::Loaded => "measured.loaded",
            Self::Cuff => "measured.aortic_pressure",
            Self::ForwardStrokeVolume => "measured.forward_stroke_volume",
            Self::WholeHeartVolume => "measured.diastasis",
        }
    }

    /// The measurement that these words name, if the program can read it.
    #[must_use]
    pub fn of_words(words: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.words() == words)
    }
}
