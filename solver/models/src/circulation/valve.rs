//! Valves as diodes (Jung 2022, section 2.2.3) with a small forward and a large backward
//! resistance.

use super::{CirculationError, FlowPath, TimeStep, positive};
use cardiotwin_units::MmhgSPerMl;

/// Inertia of the blood in a valve, by the implicit Euler rule: L (Q − Q₀)/Δt = Δp − R Q acts as a
/// resistance L/Δt in series, and as a pressure L Q₀/Δt that keeps the blood moving.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Inertia {
    inertance_mmhg_s2_per_ml: f64,
    /// Resistance L/Δt of the present step \[mmHg·s/mL\].
    pub resistance: f64,
    /// Pressure L Q₀/Δt of the present step \[mmHg\]; zero in a closed valve.
    pub drive_mmhg: f64,
}

impl Inertia {
    /// Blood of an inertance \[mmHg·s²/mL\], at rest.
    #[must_use]
    pub fn new(inertance_mmhg_s2_per_ml: f64) -> Self {
        Self {
            inertance_mmhg_s2_per_ml,
            ..Self::default()
        }
    }

    /// Prepares a step before which the valve had this flow \[mL/s\].
    pub fn prepare(&mut self, step: TimeStep, flow_ml_per_s: f64) {
        if self.inertance_mmhg_s2_per_ml > 0.0 && step.dt_ms > 0.0 {
            self.resistance = 1e3 * self.inertance_mmhg_s2_per_ml / step.dt_ms;
            self.drive_mmhg = self.resistance * flow_ml_per_s.max(0.0);
        }
    }

    /// As [`Self::prepare`], for a vessel without a valve: blood continues backwards, too.
    pub fn prepare_both_ways(&mut self, step: TimeStep, flow_ml_per_s: f64) {
        self.prepare(step, flow_ml_per_s);
        self.drive_mmhg = self.resistance * flow_ml_per_s;
    }
}

/// Q = Δp/R_f forward and Δp/R_b backward; continuous and monotone, with a kink at Δp = 0. With
/// inertia, blood continues forward until the pressure has stopped it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiodeValve {
    name: &'static str,
    forward_resistance: f64,
    forward_per_resistance: f64,
    backward_per_resistance: f64,
    inertia: Inertia,
}

impl DiodeValve {
    /// A valve called `name` with its two resistances.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if a resistance is not positive and finite.
    pub fn new(
        name: &'static str,
        forward: MmhgSPerMl,
        backward: MmhgSPerMl,
    ) -> Result<Self, CirculationError> {
        positive(name, "forward resistance", forward.0)?;
        positive(name, "backward resistance", backward.0)?;
        Ok(Self {
            name,
            forward_resistance: forward.0,
            forward_per_resistance: 1.0 / forward.0,
            backward_per_resistance: 1.0 / backward.0,
            inertia: Inertia::default(),
        })
    }
}

impl FlowPath for DiodeValve {
    fn name(&self) -> &'static str {
        self.name
    }

    fn set_inertance(&mut self, inertance: f64) {
        self.inertia = Inertia::new(inertance);
    }

    fn prepare(&mut self, step: TimeStep, flow_ml_per_s: f64) {
        self.inertia.prepare(step, flow_ml_per_s);
        self.forward_per_resistance = 1.0 / (self.forward_resistance + self.inertia.resistance);
    }

    #[inline]
    fn flow(&self, difference_mmhg: f64) -> (f64, f64) {
        let driven = difference_mmhg + self.inertia.drive_mmhg;
        let conductance = if driven > 0.0 {
            self.forward_per_resistance
        } else {
            self.backward_per_resistance
        };
        (driven * conductance, conductance)
    }

    fn is_open(&self, difference_mmhg: f64) -> bool {
        difference_mmhg + self.inertia.drive_mmhg > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaks_a_tenth_of_a_millilitre_per_second_at_100_mmhg() {
        let valve = DiodeValve::new("v", MmhgSPerMl(0.01), MmhgSPerMl(1000.0)).unwrap();
        assert!((valve.flow(-100.0).0 + 0.1).abs() < 1e-15);
        assert!((valve.flow(2.0).0 - 200.0).abs() < 1e-12);
        assert_eq!(valve.flow(0.0).0, 0.0);
        assert!(valve.is_open(1e-9) && !valve.is_open(-1e-9));
    }

    /// Under a constant pressure the flow rises as Δp/R (1 − exp(−R t/L)); against it, it continues
    /// until it is stopped, and then the valve holds.
    #[test]
    fn blood_with_inertia_starts_and_stops_late() {
        let (resistance, inertance) = (0.01, 4e-4);
        let mut valve = DiodeValve::new("v", MmhgSPerMl(resistance), MmhgSPerMl(1000.0)).unwrap();
        valve.set_inertance(inertance);
        let step = TimeStep {
            end_ms: 0.0,
            dt_ms: 0.01,
        };
        let mut flow = 0.0;
        let mut run = |flow: &mut f64, difference: f64, steps: usize| {
            for _ in 0..steps {
                valve.prepare(step, *flow);
                *flow = valve.flow(difference).0;
            }
        };
        run(&mut flow, 3.0, 4000);
        let exact = 3.0 / resistance * (1.0 - (-resistance * 0.04 / inertance).exp());
        assert!((flow / exact - 1.0).abs() < 1e-3, "{flow} {exact}");
        run(&mut flow, -3.0, 500);
        assert!(flow > 100.0, "{flow}");
        run(&mut flow, -3.0, 4000);
        assert!((flow + 0.003).abs() < 1e-9, "{flow}");
    }

    #[test]
    fn refuses_a_resistance_of_zero() {
        let error =
            DiodeValve::new("aortic_valve", MmhgSPerMl(0.0), MmhgSPerMl(1000.0)).unwrap_err();
        assert!(matches!(
            error,
            CirculationError::Parameter {
                component: "aortic_valve",
                ..
            }
        ));
    }
}
