//! Pressure offset: a wrong zero of the pressure transducer.

use super::EffectError;
use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::measurement::{MeasurementTerm, PeriodicTraces};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of the pressure offset.
pub const EFFECT: Effect = Effect {
    name: "pressure_offset",
    kind: Kind::Artefact,
    meaning: "The transducer's zero is wrong: every pressure is too high or too low by the same amount.",
    equation: "P_measured = P + d",
    source: "Our values. The abstract of Gardner 1981, Anesthesiology 54:227, has no offset. Courtois et al. 1995, Circulation 92:1994 (zero level of catheter transducers), was not read",
    parameters: &[Parameter {
        name: "offset_mmHg",
        unit: "mmHg",
        meaning: "offset d; negative where the measured pressure is too low",
        range: (-20.0, 20.0),
        off: Some(0.0),
        smallest: 2.0,
        typical: 6.0,
        prior_scale: 5.0,
        role: Role::Strength,
    }],
    signature: "all phases alike: least pressure below zero or far above, a passive curve through no sensible zero, peak against the cuff",
    marks: &[
        Mark {
            phase: Phase::Diastasis,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
    ],
    confused_with: &[
        "pericardial_constraint",
        "viscoelasticity",
        "passive_stiffening",
    ],
    separated_by: &[
        Measurement::AtrialPressure.words(),
        Measurement::Cuff.words(),
        "zero of the transducer before and after",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: Some(
        "subtract this offset from the pressure trace and from the end-diastolic pressure, then run again",
    ),
    action: Action::Measurement(make),
};

#[derive(Debug)]
struct Offset {
    mmhg: f64,
}

impl MeasurementTerm for Offset {
    fn apply(&self, traces: &mut PeriodicTraces) {
        traces
            .pressure_mmhg
            .iter_mut()
            .for_each(|p| *p += self.mmhg);
    }

    fn remove(&self, traces: &mut PeriodicTraces) {
        traces
            .pressure_mmhg
            .iter_mut()
            .for_each(|p| *p -= self.mmhg);
    }
}

fn make(values: &[f64]) -> Result<Box<dyn MeasurementTerm>, EffectError> {
    Ok(Box::new(Offset { mmhg: values[0] }))
}
