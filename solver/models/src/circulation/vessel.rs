//! Vessels of a closed loop: a compliance that stores blood, and a resistance through which it flows
//! on.

use super::valve::Inertia;
use super::{CirculationError, Compartment, FlowPath, TimeStep, positive};
use cardiotwin_units::{Mmhg, MmhgSPerMl};

/// A compliance, `P = V/C` with V the stressed volume. Its state is V \[mL\], which changes by what
/// flows in over a step and by nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    name: &'static str,
    ml_per_mmhg: f64,
    start_ml: f64,
}

impl Compliance {
    /// A compliance \[mL/mmHg\] called `name` with this pressure at the start.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if the compliance is not positive or the pressure not finite.
    pub fn new(
        name: &'static str,
        ml_per_mmhg: f64,
        start: Mmhg,
    ) -> Result<Self, CirculationError> {
        positive(name, "compliance", ml_per_mmhg)?;
        if !start.0.is_finite() {
            return Err(CirculationError::Parameter {
                component: name,
                name: "start",
                value: start.0,
                expected: "finite",
            });
        }
        Ok(Self {
            name,
            ml_per_mmhg,
            start_ml: ml_per_mmhg * start.0,
        })
    }
}

impl Compartment for Compliance {
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
        let dt_s = step.dt_ms * 1e-3;
        (
            (state[0] + inflow_ml_per_s * dt_s) / self.ml_per_mmhg,
            dt_s / self.ml_per_mmhg,
        )
    }

    fn advance(&self, state: &mut [f64], inflow_ml_per_s: f64, step: TimeStep) {
        state[0] += inflow_ml_per_s * step.dt_ms * 1e-3;
    }

    fn volume_ml(&self, state: &[f64]) -> Option<f64> {
        Some(state[0])
    }
}

/// A vessel without a valve, `L dQ/dt = Δp − R Q`, by the implicit Euler rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resistance {
    name: &'static str,
    resistance: f64,
    inertia: Inertia,
    per_resistance: f64,
}

impl Resistance {
    /// A resistance called `name`.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if it is not positive and finite.
    pub fn new(name: &'static str, resistance: MmhgSPerMl) -> Result<Self, CirculationError> {
        positive(name, "resistance", resistance.0)?;
        Ok(Self {
            name,
            resistance: resistance.0,
            inertia: Inertia::default(),
            per_resistance: 1.0 / resistance.0,
        })
    }
}

impl FlowPath for Resistance {
    fn name(&self) -> &'static str {
        self.name
    }

    fn set_inertance(&mut self, inertance: f64) {
        self.inertia = Inertia::new(inertance);
    }

    fn prepare(&mut self, step: TimeStep, flow_ml_per_s: f64) {
        self.inertia.prepare_both_ways(step, flow_ml_per_s);
        self.per_resistance = 1.0 / (self.resistance + self.inertia.resistance);
    }

    fn flow(&self, difference_mmhg: f64) -> (f64, f64) {
        (
            (difference_mmhg + self.inertia.drive_mmhg) * self.per_resistance,
            self.per_resistance,
        )
    }

    fn is_open(&self, _difference_mmhg: f64) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inertia_carries_blood_both_ways() {
        let mut vessel = Resistance::new("artery", MmhgSPerMl(0.8)).unwrap();
        vessel.set_inertance(5e-3);
        let (dt_s, mut flow, difference) = (1e-4, -40.0, 16.0);
        // L dQ/dt = Δp − R Q relaxes to Δp/R with L/R = 6.25 ms.
        for k in 1..=100 {
            let step = TimeStep {
                end_ms: f64::from(k) * 0.1,
                dt_ms: 0.1,
            };
            vessel.prepare(step, flow);
            flow = vessel.flow(difference).0;
        }
        let exact = 20.0 - 60.0 * (-100.0 * dt_s / 6.25e-3_f64).exp();
        assert!((flow - exact).abs() < 0.3, "{flow} {exact}");
        assert!(vessel.is_open(-1.0) && Resistance::new("a", MmhgSPerMl(0.0)).is_err());
    }

    #[test]
    fn compliance_holds_what_flows_in() {
        let veins = Compliance::new("veins", 60.0, Mmhg(5.0)).unwrap();
        let step = TimeStep {
            end_ms: 10.0,
            dt_ms: 10.0,
        };
        let mut state = [0.0];
        veins.start(&mut state);
        let (pressure, slope) = veins.pressure(&state, 600.0, step);
        veins.advance(&mut state, 600.0, step);
        assert!((pressure - 5.1).abs() < 1e-12 && (slope - 0.01 / 60.0).abs() < 1e-15);
        assert_eq!(veins.volume_ml(&state), Some(306.0));
        assert!(Compliance::new("a", -1.0, Mmhg(5.0)).is_err());
    }
}
