//! Volume scaling: a common factor of all measured volumes.

use super::EffectError;
use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::measurement::{MeasurementTerm, PeriodicTraces};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of the volume scaling.
pub const EFFECT: Effect = Effect {
    name: "volume_scaling",
    kind: Kind::Artefact,
    meaning: "Every segmented volume is too large or too small by the same factor.",
    equation: "V_measured = s V",
    source: "Our values. End-diastolic volumes of seven laboratories differ by 15 to 28 mL (Suinesiaputra et al. 2015, J Cardiovasc Magn Reson 17:63, abstract). The abstract of Schulz-Menger et al. 2020, J Cardiovasc Magn Reson 22:19, has no errors",
    parameters: &[Parameter {
        name: "volume_factor",
        unit: "1",
        meaning: "factor s",
        range: (0.7, 1.4),
        off: Some(1.0),
        smallest: 0.04,
        typical: 1.15,
        prior_scale: 0.12,
        role: Role::Strength,
    }],
    signature: "none in the traces (loads and reference volumes absorb it); forward stroke volume and whole-heart volume differ by the same factor",
    marks: &[
        Mark {
            phase: Phase::Diastasis,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
    ],
    confused_with: &["mitral_regurgitation", "ventricular_septal_defect"],
    separated_by: &[
        Measurement::ForwardStrokeVolume.words(),
        Measurement::WholeHeartVolume.words(),
        Measurement::AorticFlow.words(),
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: Some(
        "divide the volume trace by this factor (slices, papillary muscles, basal plane), then run again",
    ),
    action: Action::Measurement(make),
};

#[derive(Debug)]
struct Factor {
    factor: f64,
}

impl MeasurementTerm for Factor {
    fn apply(&self, traces: &mut PeriodicTraces) {
        traces.volume_ml.iter_mut().for_each(|v| *v *= self.factor);
    }

    fn remove(&self, traces: &mut PeriodicTraces) {
        traces.volume_ml.iter_mut().for_each(|v| *v /= self.factor);
    }
}

fn make(values: &[f64]) -> Result<Box<dyn MeasurementTerm>, EffectError> {
    Ok(Box::new(Factor { factor: values[0] }))
}
