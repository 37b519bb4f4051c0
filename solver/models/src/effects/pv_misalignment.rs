//! Pressure-volume misalignment: traces of different heart beats combined with a wrong delay.

use super::EffectError;
use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::measurement::{MeasurementTerm, PeriodicTraces, delay};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of the pressure-volume misalignment.
pub const EFFECT: Effect = Effect {
    name: "pv_misalignment",
    kind: Kind::Artefact,
    meaning: "The volume trace is early or late against the pressure trace.",
    equation: "V_measured(t) = V(t − D)",
    source: "Our values. The abstract of Xi et al. 2013, Med Image Anal 17:133 (catheter pressure put together with MRI), has no delay",
    parameters: &[Parameter {
        name: "volume_delay_ms",
        unit: "ms",
        meaning: "delay D of the volume; negative where it is early",
        range: (-70.0, 70.0),
        off: Some(0.0),
        smallest: 8.0,
        typical: 25.0,
        prior_scale: 25.0,
        role: Role::Strength,
    }],
    signature: "sheared loop: the volume moves in both isovolumic phases, with opposite sign, against the valve events in the pressure",
    marks: &[
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Volume,
            sign: Sign::Down,
        },
    ],
    confused_with: &[
        "catheter_response",
        "mitral_regurgitation",
        "ventricular_septal_defect",
        "atrial_kick",
    ],
    separated_by: &[
        Measurement::ValveTimes.words(),
        Measurement::Strain.words(),
        "electrocardiogram recorded with both traces",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: Some(
        "shift the volume trace back by this delay (align both to the R wave), then run again",
    ),
    action: Action::Measurement(make),
};

#[derive(Debug)]
struct Delay {
    delay_ms: f64,
}

impl MeasurementTerm for Delay {
    fn apply(&self, traces: &mut PeriodicTraces) {
        let spacing = traces.spacing_ms();
        delay(&mut traces.volume_ml, self.delay_ms / spacing);
    }

    fn remove(&self, traces: &mut PeriodicTraces) {
        let spacing = traces.spacing_ms();
        delay(&mut traces.volume_ml, -self.delay_ms / spacing);
    }
}

fn make(values: &[f64]) -> Result<Box<dyn MeasurementTerm>, EffectError> {
    Ok(Box::new(Delay {
        delay_ms: values[0],
    }))
}
