//! Atrial kick: contraction of the left atrium before systole.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, Parameter, Phase, Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::circulation::left_heart::LEFT_ATRIUM;
use crate::circulation::{Circulation, Compartment, TimeStep};
use cardiotwin_vocabulary::measurements::Measurement;
use std::f64::consts::PI;

/// Catalogue entry of the atrial kick.
pub const EFFECT: Effect = Effect {
    name: "atrial_kick",
    kind: Kind::Physiology,
    meaning: "The left atrium contracts before systole and pushes a last share of blood into the ventricle.",
    equation: "P_la(t) = P_0 + A sin²(π (t − t_a)/d) for t_a < t < t_a + d, t_a = onset − lead, each cycle",
    source: "Our values. Jung et al. 2022, section 4.2, name the kick as missing. 0.6 % of men and 0.4 % of women have atrial fibrillation (Chugh et al. 2014, Circulation 129:837, abstract). Our odds, for patients, are more cautious. Hoit 2014, J Am Coll Cardiol 63:493, was not read",
    parameters: &[
        Parameter {
            name: "amplitude_mmHg",
            unit: "mmHg",
            meaning: "rise A of the atrial pressure",
            range: (0.0, 25.0),
            off: Some(0.0),
            smallest: 2.0,
            typical: 8.0,
            prior_scale: 6.0,
            role: Role::Strength,
        },
        Parameter {
            name: "lead_ms",
            unit: "ms",
            meaning: "begin of the atrial contraction before the first activation of the ventricle",
            range: (80.0, 220.0),
            off: None,
            smallest: 0.0,
            typical: 140.0,
            prior_scale: 30.0,
            role: Role::Shape,
        },
        Parameter {
            name: "duration_ms",
            unit: "ms",
            meaning: "duration d of the atrial contraction",
            range: (90.0, 180.0),
            off: None,
            smallest: 0.0,
            typical: 130.0,
            prior_scale: 20.0,
            role: Role::Shape,
        },
    ],
    signature: "atrial systole: a second rise of the volume after a plateau in diastasis, and an a-wave in the pressure; \
                end-diastolic volume and pressure too small in the model, its early filling too large",
    marks: &[
        Mark {
            phase: Phase::AtrialSystole,
            signal: Signal::VolumeRate,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::AtrialSystole,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::IsovolumicContraction,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
    ],
    confused_with: &["aortic_regurgitation", "viscoelasticity", "pv_misalignment"],
    separated_by: &[
        Measurement::AtrialPressure.words(),
        Measurement::MitralFlow.words(),
        "electrocardiogram (P-wave)",
    ],
    prior_odds: 10.0,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: None,
    action: Action::Circulation(add),
};

/// An atrium whose pressure rises once per cycle.
#[derive(Debug)]
struct ContractingAtrium {
    rest_mmhg: f64,
    amplitude_mmhg: f64,
    begin_ms: f64,
    duration_ms: f64,
    cycle_ms: f64,
}

impl Compartment for ContractingAtrium {
    fn name(&self) -> &'static str {
        LEFT_ATRIUM
    }

    fn n_states(&self) -> usize {
        0
    }

    fn start(&self, _state: &mut [f64]) {}

    fn pressure(&self, _state: &[f64], _inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64) {
        let phase = (step.end_ms - self.begin_ms).rem_euclid(self.cycle_ms) / self.duration_ms;
        let kick = if phase < 1.0 {
            (PI * phase).sin().powi(2)
        } else {
            0.0
        };
        (self.rest_mmhg + self.amplitude_mmhg * kick, 0.0)
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
    let atrium = circulation
        .compartment_idx(LEFT_ATRIUM)
        .ok_or(EffectError::NoPart {
            effect: EFFECT.name,
            part: LEFT_ATRIUM,
        })?;
    let contracting = ContractingAtrium {
        rest_mmhg: around.heart.left_atrial_pressure.0,
        amplitude_mmhg: values[0],
        begin_ms: around.onset.0 - values[1],
        duration_ms: values[2],
        cycle_ms: around.cycle_length().0,
    };
    circulation.replace_compartment(atrium, Box::new(contracting));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressure_is_a_squared_sine_once_a_cycle() {
        let atrium = ContractingAtrium {
            rest_mmhg: 7.0,
            amplitude_mmhg: 8.0,
            begin_ms: -100.0,
            duration_ms: 120.0,
            cycle_ms: 800.0,
        };
        let at = |end_ms| atrium.pressure(&[], 0.0, TimeStep { end_ms, dt_ms: 1.0 }).0;
        for beat in [0.0, 800.0, 8000.0] {
            assert!((at(beat + 700.0) - 7.0).abs() < 1e-12);
            assert!((at(beat + 730.0) - 11.0).abs() < 1e-9);
            assert!((at(beat + 760.0) - 15.0).abs() < 1e-9);
            assert!((at(beat + 400.0) - 7.0).abs() < 1e-12);
            assert!(
                (at(beat + 10.0) - (7.0 + 8.0 * (PI * 110.0 / 120.0).sin().powi(2))).abs() < 1e-9
            );
        }
    }
}
