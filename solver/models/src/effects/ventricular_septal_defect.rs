//! Ventricular septal defect: a hole between the ventricles.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::{EffectError, Surroundings};
use crate::circulation::{Circulation, Compartment, Direction, Orifice, TimeStep};
use cardiotwin_vocabulary::measurements::Measurement;
use std::f64::consts::PI;

/// Catalogue entry of the ventricular septal defect.
pub const EFFECT: Effect = Effect {
    name: "ventricular_septal_defect",
    kind: Kind::Physiology,
    meaning: "A hole in the septum lets blood from the left into the right ventricle.",
    equation: "Q = 50 A √(P_lv − P_rv) for P_lv > P_rv; P_rv = P_d + (P_s − P_d) sin²(π (t − onset)/d) in systole (A in cm², Q in mL/s)",
    source: "Our values. A third of the frequency of mitral regurgitation is ours, too. The abstract of Nkomo et al. 2006, Lancet 368:1005, does not split valve diseases (2.5 % of adults). The abstract of Hoffman and Kaplan 2002, J Am Coll Cardiol 39:1890, counts births. Gorlin and Gorlin 1951, Am Heart J 41:1, was not read",
    parameters: &[
        Parameter {
            name: "orifice_cm2",
            unit: "cm²",
            meaning: "effective area A of the hole",
            range: (0.0, 0.6),
            off: Some(0.0),
            smallest: 0.04,
            typical: 0.2,
            prior_scale: 0.15,
            role: Role::Strength,
        },
        Parameter {
            name: "right_systolic_mmHg",
            unit: "mmHg",
            meaning: "systolic pressure P_s of the right ventricle",
            range: (20.0, 45.0),
            off: None,
            smallest: 0.0,
            typical: 30.0,
            prior_scale: 6.0,
            role: Role::Held,
        },
        Parameter {
            name: "right_diastolic_mmHg",
            unit: "mmHg",
            meaning: "diastolic pressure P_d of the right ventricle",
            range: (0.0, 8.0),
            off: None,
            smallest: 0.0,
            typical: 3.0,
            prior_scale: 2.0,
            role: Role::Held,
        },
        Parameter {
            name: "right_systole_ms",
            unit: "ms",
            meaning: "duration d of the right ventricle's pressure, from the first activation on",
            range: (250.0, 500.0),
            off: None,
            smallest: 0.0,
            typical: 380.0,
            prior_scale: 40.0,
            role: Role::Held,
        },
    ],
    signature: "as mitral regurgitation, a little weaker late in systole",
    marks: &[
        Mark {
            phase: Phase::IsovolumicContraction,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
    ],
    confused_with: &["mitral_regurgitation", "volume_scaling"],
    separated_by: &[
        Measurement::MitralFlow.words(),
        Measurement::AorticFlow.words(),
        "colour Doppler of septum and mitral valve",
        "right-ventricular oxygen saturation",
    ],
    prior_odds: ONE_OF_MANY / 3.0,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: None,
    action: Action::Circulation(add),
};

/// A right ventricle with prescribed pressure.
#[derive(Debug)]
struct RightVentricle {
    diastolic_mmhg: f64,
    systolic_mmhg: f64,
    onset_ms: f64,
    duration_ms: f64,
    cycle_ms: f64,
}

impl Compartment for RightVentricle {
    fn name(&self) -> &'static str {
        "right_ventricle"
    }

    fn n_states(&self) -> usize {
        0
    }

    fn start(&self, _state: &mut [f64]) {}

    fn pressure(&self, _state: &[f64], _inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64) {
        let phase = (step.end_ms - self.onset_ms).rem_euclid(self.cycle_ms) / self.duration_ms;
        let systole = if phase < 1.0 {
            (PI * phase).sin().powi(2)
        } else {
            0.0
        };
        (
            self.diastolic_mmhg + (self.systolic_mmhg - self.diastolic_mmhg) * systole,
            0.0,
        )
    }

    fn advance(&self, _state: &mut [f64], _inflow_ml_per_s: f64, _step: TimeStep) {}

    fn is_source(&self) -> bool {
        true
    }
}

fn add(
    values: &[f64],
    around: &Surroundings,
    circulation: &mut Circulation,
) -> Result<(), EffectError> {
    let right = circulation.add_compartment(Box::new(RightVentricle {
        diastolic_mmhg: values[2],
        systolic_mmhg: values[1],
        onset_ms: around.onset.0,
        duration_ms: values[3],
        cycle_ms: around.cycle_length().0,
    }));
    let hole = Orifice::new(EFFECT.name, values[0])?;
    circulation.connect(Box::new(hole), right, Direction::OutOfVentricle);
    Ok(())
}
