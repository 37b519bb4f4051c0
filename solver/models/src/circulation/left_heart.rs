//! Circulation of the base model: an atrium at constant pressure, two diode valves and a
//! three-element Windkessel.

use super::windkessel;
use super::{Circulation, CirculationError, ConstantPressure, DiodeValve, Direction, Windkessel3};
use cardiotwin_units::{Ml, Mmhg, MmhgSPerMl, Ms};
use cardiotwin_vocabulary::circulation::WindkesselParameters;
use serde::{Deserialize, Serialize};

/// Name of the atrial compartment.
pub const LEFT_ATRIUM: &str = "left_atrium";
/// Name of the arterial compartment.
pub const AORTA: &str = "aorta";
/// Name of the path into the ventricle.
pub const MITRAL_VALVE: &str = "mitral_valve";
/// Name of the path out of the ventricle.
pub const AORTIC_VALVE: &str = "aortic_valve";

/// Initial pressure of the arterial compliance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartPressure {
    /// The diastolic cuff pressure.
    DiastolicCuff(Mmhg),
    /// The periodic value for this stroke volume, ejected as a half sine over a third of the cycle
    /// from 50 ms.
    StrokeVolume(Ml),
}

/// Parameters of the base model's circulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LeftHeart {
    /// Pressure of the left atrium, constant over the cycle.
    pub left_atrial_pressure: Mmhg,
    /// Forward resistance of the mitral valve.
    pub mitral_forward: MmhgSPerMl,
    /// Backward resistance of the mitral valve.
    pub mitral_backward: MmhgSPerMl,
    /// Forward resistance of the aortic valve.
    pub aortic_forward: MmhgSPerMl,
    /// Backward resistance of the aortic valve.
    pub aortic_backward: MmhgSPerMl,
    /// Three-element Windkessel behind the aortic valve.
    pub windkessel: WindkesselParameters,
    /// Initial pressure of the arterial load.
    pub start: StartPressure,
    /// Cycle length, the period of the beat.
    pub cycle_length: Ms,
}

impl LeftHeart {
    /// Forward resistance at the start of step 1 (Jung 2022, section 2.3.1).
    pub const FORWARD: MmhgSPerMl = MmhgSPerMl(0.01);
    /// Backward resistance (Jung 2022, section 2.3.1).
    pub const BACKWARD: MmhgSPerMl = MmhgSPerMl(1000.0);

    /// Circulation of an adult at rest with our own round numbers, for benchmarks, examples and
    /// tests without a patient.
    #[must_use]
    pub fn of_an_adult(left_atrial_pressure: Mmhg, cycle_length: Ms) -> Self {
        Self {
            left_atrial_pressure,
            mitral_forward: Self::FORWARD,
            mitral_backward: Self::BACKWARD,
            aortic_forward: Self::FORWARD,
            aortic_backward: Self::BACKWARD,
            windkessel: WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.05,
                peripheral_resistance_mmhg_s_per_ml: 0.9,
                compliance_ml_per_mmhg: 1.6,
            },
            start: StartPressure::DiastolicCuff(Mmhg(70.0)),
            cycle_length,
        }
    }

    /// Initial pressure of the arterial compliance.
    #[must_use]
    pub fn start_pressure(&self) -> Mmhg {
        match self.start {
            StartPressure::DiastolicCuff(pressure) => pressure,
            StartPressure::StrokeVolume(Ml(stroke_volume)) => {
                let duration = self.cycle_length.0 / 3.0;
                let peak = stroke_volume * 1e3 / duration * std::f64::consts::FRAC_PI_2;
                windkessel::periodic_start(&self.windkessel, self.cycle_length, |t| {
                    let phase = (t - 50.0) / duration;
                    if (0.0..1.0).contains(&phase) {
                        peak * (phase * std::f64::consts::PI).sin()
                    } else {
                        0.0
                    }
                })
            }
        }
    }

    /// Assembles the circulation.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if a parameter is outside its range.
    pub fn build(&self) -> Result<Circulation, CirculationError> {
        let mut circulation = Circulation::new();
        let atrium = circulation.add_compartment(Box::new(ConstantPressure::new(
            LEFT_ATRIUM,
            self.left_atrial_pressure,
        )?));
        let load = Windkessel3::new(AORTA, &self.windkessel, self.start_pressure())?;
        let aorta = circulation.add_compartment(Box::new(load));
        let mitral = DiodeValve::new(MITRAL_VALVE, self.mitral_forward, self.mitral_backward)?;
        circulation.connect(Box::new(mitral), atrium, Direction::IntoVentricle);
        let aortic = DiodeValve::new(AORTIC_VALVE, self.aortic_forward, self.aortic_backward)?;
        circulation.connect(Box::new(aortic), aorta, Direction::OutOfVentricle);
        Ok(circulation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::circulation::FlowPath;

    use proptest::prelude::*;

    pub(crate) fn heart() -> LeftHeart {
        LeftHeart::of_an_adult(Mmhg(7.0), Ms(800.0))
    }

    #[test]
    fn periodic_start_grows_with_the_stroke_volume() {
        let at = |sv| {
            LeftHeart {
                start: StartPressure::StrokeVolume(Ml(sv)),
                ..heart()
            }
            .start_pressure()
            .0
        };
        let mean = 0.9 * 80.0 / 0.8;
        assert!(
            at(80.0) > 0.6 * mean && at(80.0) < mean,
            "{} {mean}",
            at(80.0)
        );
        assert!((at(160.0) / at(80.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn rolled_back_and_restored_steps_leave_no_trace() {
        let mut circulation = heart().build().unwrap();
        circulation.try_step(Mmhg(120.0), Ms(1.0)).unwrap();
        circulation.commit();
        let before = circulation.snapshot();
        circulation.try_step(Mmhg(90.0), Ms(1.0)).unwrap();
        circulation.roll_back();
        circulation.commit();
        assert_eq!(circulation.snapshot(), before);
        let flow = circulation.try_step(Mmhg(100.0), Ms(0.5)).unwrap();
        circulation.commit();
        assert_ne!(circulation.snapshot(), before);
        circulation.restore(&before).unwrap();
        assert_eq!(circulation.try_step(Mmhg(100.0), Ms(0.5)).unwrap(), flow);
        let text = serde_json::to_string(&before).unwrap();
        assert_eq!(
            serde_json::from_str::<super::super::CirculationState>(&text).unwrap(),
            before
        );
        let mut foreign = before.clone();
        foreign.states.push(0.0);
        assert!(matches!(
            circulation.restore(&foreign),
            Err(CirculationError::ForeignSnapshot { .. })
        ));
    }

    /// A quadratic leak in the form in which an effect adds it; nothing else changes.
    #[derive(Debug)]
    struct Leak(f64);
    impl FlowPath for Leak {
        fn name(&self) -> &'static str {
            "leak"
        }
        fn flow(&self, difference_mmhg: f64) -> (f64, f64) {
            let root = (difference_mmhg.abs() + 1e-6).sqrt();
            (
                self.0 * difference_mmhg / root,
                self.0 * (difference_mmhg.abs() * 0.5 + 1e-6) / root.powi(3),
            )
        }
    }

    proptest! {
        #[test]
        fn slope_is_that_of_the_net_flow(pressure in 0.0..200.0f64, dt in 0.05..2.0f64, leak in 0.0..20.0f64) {
            let mut circulation = heart().build().unwrap();
            let aorta = circulation.compartment_idx(AORTA).unwrap();
            circulation.connect(Box::new(Leak(leak)), aorta, Direction::IntoVentricle);
            let mut at = |p: f64| circulation.try_step(Mmhg(p), Ms(dt)).unwrap();
            let h = 1e-4;
            let (up, down, here) = (at(pressure + h), at(pressure - h), at(pressure));
            let slope = (up.inflow_ml_per_s - down.inflow_ml_per_s) / (2.0 * h);
            // A valve that changes state within the difference has two slopes.
            let kink = (up.slope_ml_per_s_per_mmhg - down.slope_ml_per_s_per_mmhg).abs();
            prop_assert!((slope - here.slope_ml_per_s_per_mmhg).abs() < 1e-4 * (1.0 + slope.abs()) + kink);
            prop_assert!(here.slope_ml_per_s_per_mmhg <= 0.0);
        }

        #[test]
        fn what_leaves_the_ventricle_is_what_passed(pressures in prop::collection::vec(0.0..150.0f64, 1..50)) {
            let mut circulation = heart().build().unwrap();
            let mut volume = 0.0;
            for p in pressures {
                volume += circulation.try_step(Mmhg(p), Ms(1.0)).unwrap().inflow_ml_per_s * 1e-3;
                circulation.commit();
            }
            prop_assert!((circulation.net_volume_in().0 - volume).abs() < 1e-9);
        }
    }
}
