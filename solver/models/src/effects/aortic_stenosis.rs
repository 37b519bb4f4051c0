//! Aortic stenosis: a Bernoulli loss in the aortic valve.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::{EffectError, Surroundings};
use crate::circulation::left_heart::AORTIC_VALVE;
use crate::circulation::valve::Inertia;
use crate::circulation::{Circulation, FlowPath, TimeStep};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of aortic stenosis.
pub const EFFECT: Effect = Effect {
    name: "aortic_stenosis",
    kind: Kind::Physiology,
    meaning: "A narrow aortic valve costs a pressure that grows with the square of the flow.",
    equation: "P_lv − P_ao = R Q + B Q² for Q > 0",
    source: "Our values. The abstract of Garcia et al. 2000, Circulation 101:765 (energy loss of the jet), does not have them. Baumgartner et al. 2017, J Am Soc Echocardiogr 30:372, was not read beyond its abstract",
    parameters: &[Parameter {
        name: "loss_mmHg_s2_per_mL2",
        unit: "mmHg s²/mL²",
        meaning: "quadratic loss B; 1e-4 is 16 mmHg at 400 mL/s",
        range: (0.0, 6e-4),
        off: Some(0.0),
        smallest: 2e-5,
        typical: 1.5e-4,
        prior_scale: 1e-4,
        role: Role::Strength,
    }],
    signature: "mid ejection: a rounded late peak of the pressure, well above the systolic cuff pressure; slower early ejection",
    marks: &[
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::VolumeRate,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::LateEjection,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
    ],
    confused_with: &["wave_reflection", "dyssynchrony"],
    separated_by: &[
        Measurement::AorticPressure.words(),
        Measurement::Cuff.words(),
        "jet velocity by Doppler",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: None,
    action: Action::Circulation(add),
};

/// A diode with a quadratic forward loss.
#[derive(Debug)]
struct StenoticValve {
    forward: f64,
    backward: f64,
    loss: f64,
    inertia: Inertia,
}

impl FlowPath for StenoticValve {
    fn name(&self) -> &'static str {
        AORTIC_VALVE
    }

    fn set_inertance(&mut self, inertance: f64) {
        self.inertia = Inertia::new(inertance);
    }

    fn prepare(&mut self, step: TimeStep, flow_ml_per_s: f64) {
        self.inertia.prepare(step, flow_ml_per_s);
    }

    fn flow(&self, difference_mmhg: f64) -> (f64, f64) {
        let driven = difference_mmhg + self.inertia.drive_mmhg;
        if driven <= 0.0 {
            return (driven / self.backward, 1.0 / self.backward);
        }
        let forward = self.forward + self.inertia.resistance;
        let root = (forward * forward + 4.0 * self.loss * driven).sqrt();
        (2.0 * driven / (forward + root), 1.0 / root)
    }

    fn is_open(&self, difference_mmhg: f64) -> bool {
        difference_mmhg + self.inertia.drive_mmhg > 0.0
    }
}

fn add(
    values: &[f64],
    around: &Surroundings,
    circulation: &mut Circulation,
) -> Result<(), EffectError> {
    let valve = circulation
        .path_idx(AORTIC_VALVE)
        .ok_or(EffectError::NoPart {
            effect: EFFECT.name,
            part: AORTIC_VALVE,
        })?;
    let stenotic = StenoticValve {
        forward: around.heart.aortic_forward.0,
        backward: around.heart.aortic_backward.0,
        loss: values[0],
        inertia: Inertia::default(),
    };
    circulation.replace_path(valve, Box::new(stenotic));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn flow_costs_its_linear_and_quadratic_part(difference in 0.01..100.0f64, loss in 0.0..6e-4f64) {
            let valve = StenoticValve { forward: 0.01, backward: 1000.0, loss, inertia: Inertia::default() };
            let (q, slope) = valve.flow(difference);
            prop_assert!((0.01 * q + loss * q * q - difference).abs() < 1e-10 * (1.0 + difference));
            prop_assert!((slope * (0.01 + 2.0 * loss * q) - 1.0).abs() < 1e-10);
        }
    }
}
