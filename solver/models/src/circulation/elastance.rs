//! A heart chamber with a time-varying elastance: both atria and the right ventricle of a closed loop.

use super::{CirculationError, Compartment, TimeStep, positive};
use cardiotwin_units::{Ml, Ms};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// `P = (E_B + E_A φ(t)) (V − V₀)`, with φ a raised cosine that rises over the contraction and falls
/// over the relaxation (Regazzoni et al. 2022, J Comput Phys 457:111083, as in the public program
/// cardioemulator).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Elastance {
    /// Elastance added at the peak of the contraction, E_A \[mmHg/mL\].
    pub active_mmhg_per_ml: f64,
    /// Elastance of the resting chamber, E_B \[mmHg/mL\].
    pub passive_mmhg_per_ml: f64,
    /// Volume without pressure, V₀.
    pub unloaded: Ml,
    /// Time in the cycle at which the contraction begins; any value, counted modulo the cycle.
    pub begins: Ms,
    /// Time from the beginning to the peak of the contraction.
    pub contraction: Ms,
    /// Time from the peak to rest.
    pub relaxation: Ms,
}

impl Elastance {
    /// Activation φ, between 0 and 1, at a time \[ms\].
    #[must_use]
    pub fn activation(&self, time_ms: f64, cycle_length: Ms) -> f64 {
        let since = (time_ms - self.begins.0).rem_euclid(cycle_length.0);
        if since < self.contraction.0 {
            0.5 * (1.0 - (PI * since / self.contraction.0).cos())
        } else if since < self.contraction.0 + self.relaxation.0 {
            0.5 * (1.0 + (PI * (since - self.contraction.0) / self.relaxation.0).cos())
        } else {
            0.0
        }
    }

    /// Elastance \[mmHg/mL\] at a time \[ms\].
    #[must_use]
    pub fn at(&self, time_ms: f64, cycle_length: Ms) -> f64 {
        self.passive_mmhg_per_ml + self.active_mmhg_per_ml * self.activation(time_ms, cycle_length)
    }
}

/// A chamber in a circuit. Its state is the volume \[mL\], which changes by what flows in over a step
/// and by nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElastanceChamber {
    name: &'static str,
    law: Elastance,
    cycle_length: Ms,
    start_ml: f64,
}

impl ElastanceChamber {
    /// A chamber called `name` with this volume at the start.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if an elastance, a duration, the cycle or the volume at the start
    /// is not positive (the active elastance may be zero), or if contraction and relaxation together
    /// exceed the cycle.
    pub fn new(
        name: &'static str,
        law: Elastance,
        cycle_length: Ms,
        start: Ml,
    ) -> Result<Self, CirculationError> {
        positive(name, "passive elastance", law.passive_mmhg_per_ml)?;
        positive(name, "contraction", law.contraction.0)?;
        positive(name, "relaxation", law.relaxation.0)?;
        positive(name, "cycle length", cycle_length.0)?;
        positive(name, "volume at the start", start.0)?;
        let refused = |parameter, value, expected| {
            Err(CirculationError::Parameter {
                component: name,
                name: parameter,
                value,
                expected,
            })
        };
        let active = law.active_mmhg_per_ml;
        if !(active >= 0.0 && active.is_finite()) {
            return refused("active elastance", active, "zero or more");
        }
        if !(law.unloaded.0.is_finite() && law.begins.0.is_finite()) {
            let sum = law.unloaded.0 + law.begins.0;
            return refused("unloaded volume or beginning", sum, "finite");
        }
        let twitch = law.contraction.0 + law.relaxation.0;
        if twitch > cycle_length.0 {
            return refused("twitch", twitch, "no longer than the cycle");
        }
        Ok(Self {
            name,
            law,
            cycle_length,
            start_ml: start.0,
        })
    }
}

impl Compartment for ElastanceChamber {
    fn name(&self) -> &'static str {
        self.name
    }

    fn n_states(&self) -> usize {
        1
    }

    fn start(&self, state: &mut [f64]) {
        state[0] = self.start_ml;
    }

    fn pressure(&self, state: &[f64], inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64) {
        let elastance = self.law.at(step.end_ms, self.cycle_length);
        let dt_s = step.dt_ms * 1e-3;
        let volume = state[0] + inflow_ml_per_s * dt_s;
        (elastance * (volume - self.law.unloaded.0), elastance * dt_s)
    }

    fn advance(&self, state: &mut [f64], inflow_ml_per_s: f64, step: TimeStep) {
        state[0] += inflow_ml_per_s * step.dt_ms * 1e-3;
    }

    fn volume_ml(&self, state: &[f64]) -> Option<f64> {
        Some(state[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ATRIUM: Elastance = Elastance {
        active_mmhg_per_ml: 0.07,
        passive_mmhg_per_ml: 0.18,
        unloaded: Ml(4.0),
        begins: Ms(720.0),
        contraction: Ms(136.0),
        relaxation: Ms(136.0),
    };
    const CYCLE: Ms = Ms(800.0);

    #[test]
    fn contraction_runs_over_the_end_of_the_cycle() {
        let at = |t| ATRIUM.activation(t, CYCLE);
        assert_eq!((at(720.0), at(500.0), at(56.0)), (0.0, 0.0, 1.0));
        assert!((at(788.0) - 0.5).abs() < 1e-12 && (at(124.0) - 0.5).abs() < 1e-12);
        assert!((at(856.0) - at(56.0)).abs() < 1e-12 && at(192.1) == 0.0);
        assert!((ATRIUM.at(56.0, CYCLE) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn pressure_is_that_of_the_volume_at_the_end_of_the_step() {
        let chamber = ElastanceChamber::new("atrium", ATRIUM, CYCLE, Ml(60.0)).unwrap();
        let step = TimeStep {
            end_ms: 856.0,
            dt_ms: 2.0,
        };
        let mut state = [0.0];
        chamber.start(&mut state);
        let (pressure, slope) = chamber.pressure(&state, 500.0, step);
        chamber.advance(&mut state, 500.0, step);
        assert_eq!(chamber.volume_ml(&state), Some(61.0));
        assert!((pressure - 0.25 * 57.0).abs() < 1e-12 && (slope - 0.25 * 2e-3).abs() < 1e-15);
    }

    #[test]
    fn refuses_what_is_no_chamber() {
        let refused = |law| ElastanceChamber::new("a", law, CYCLE, Ml(60.0)).is_err();
        assert!(refused(Elastance {
            passive_mmhg_per_ml: 0.0,
            ..ATRIUM
        }));
        assert!(refused(Elastance {
            active_mmhg_per_ml: -0.1,
            ..ATRIUM
        }));
        assert!(refused(Elastance {
            relaxation: Ms(700.0),
            ..ATRIUM
        }));
        assert!(ElastanceChamber::new("a", ATRIUM, CYCLE, Ml(-1.0)).is_err());
    }
}
