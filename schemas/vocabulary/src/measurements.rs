//! Measurements that the search for missing effects reads, besides pressure and volume of the
//! ventricle, as suggestions name them.

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
