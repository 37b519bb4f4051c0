//! Three-element Windkessel, `P = R1 Q + Pc`, `C dPc/dt = Q − Pc/R2` (Westerhof 1971; Jung 2022,
//! section 2.2.3).

use super::{CirculationError, Compartment, TimeStep, positive};
use cardiotwin_units::{Mmhg, Ms};
pub use cardiotwin_vocabulary::circulation::WindkesselParameters;

/// Three-element Windkessel, integrated exactly for a flow that is constant over a step. Its state
/// is Pc \[mmHg\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Windkessel3 {
    name: &'static str,
    r1: f64,
    r2: f64,
    /// Time constant R2 C \[ms\].
    tau_ms: f64,
    start_mmhg: f64,
    /// Length of the last prepared step, and `1 − e^{−dt/τ}` for it.
    prepared: (f64, f64),
}

/// Time constant R2 C.
#[must_use]
pub fn time_constant(p: &WindkesselParameters) -> Ms {
    Ms(p.peripheral_resistance_mmhg_s_per_ml * p.compliance_ml_per_mmhg * 1e3)
}

/// Value of Pc at the start of each cycle when the flow repeats every `cycle_length`:
/// `Pc(0) = ∫ Q e^{−(T−s)/τ} ds / (C (1 − e^{−T/τ}))`.
///
/// - `flow_ml_per_s`: flow as a function of the time in the cycle \[ms\], integrated by Simpson's rule on 2000 intervals
#[must_use]
pub fn periodic_start(
    p: &WindkesselParameters,
    cycle_length: Ms,
    flow_ml_per_s: impl Fn(f64) -> f64,
) -> Mmhg {
    const N: usize = 2000;
    let (length, tau) = (cycle_length.0, time_constant(p).0);
    let h = length / N as f64;
    let integral: f64 = (0..=N)
        .map(|i| {
            let weight = if i == 0 || i == N {
                1.0
            } else if i % 2 == 1 {
                4.0
            } else {
                2.0
            };
            let t = i as f64 * h;
            weight * flow_ml_per_s(t) * (-(length - t) / tau).exp()
        })
        .sum::<f64>()
        * h
        / 3.0;
    Mmhg(integral * 1e-3 / (p.compliance_ml_per_mmhg * -(-length / tau).exp_m1()))
}

impl Windkessel3 {
    /// A load called `name` with the initial pressure `start` on its compliance.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if a parameter is not positive (R1 may be zero) or the
    /// initial pressure is not finite.
    pub fn new(
        name: &'static str,
        p: &WindkesselParameters,
        start: Mmhg,
    ) -> Result<Self, CirculationError> {
        let r1 = p.characteristic_resistance_mmhg_s_per_ml;
        if !(r1 >= 0.0 && r1.is_finite()) {
            let expected = "zero or more";
            return Err(CirculationError::Parameter {
                component: name,
                name: "characteristic resistance",
                value: r1,
                expected,
            });
        }
        positive(
            name,
            "peripheral resistance",
            p.peripheral_resistance_mmhg_s_per_ml,
        )?;
        positive(name, "compliance", p.compliance_ml_per_mmhg)?;
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
            r1,
            r2: p.peripheral_resistance_mmhg_s_per_ml,
            tau_ms: time_constant(p).0,
            start_mmhg: start.0,
            prepared: (0.0, 0.0),
        })
    }
}

impl Windkessel3 {
    /// Share of the way to the steady state that the compliance covers in a step.
    #[inline]
    fn filled(&self, dt_ms: f64) -> f64 {
        if dt_ms == self.prepared.0 {
            self.prepared.1
        } else {
            -(-dt_ms / self.tau_ms).exp_m1()
        }
    }
}

impl Compartment for Windkessel3 {
    fn name(&self) -> &'static str {
        self.name
    }

    fn n_states(&self) -> usize {
        1
    }

    fn start(&self, state: &mut [f64]) {
        state[0] = self.start_mmhg;
    }

    fn prepare(&mut self, step: TimeStep) {
        self.prepared = (step.dt_ms, self.filled(step.dt_ms));
    }

    #[inline]
    fn pressure(&self, state: &[f64], inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64) {
        let filled = self.filled(step.dt_ms);
        let slope = self.r1 + self.r2 * filled;
        (state[0] * (1.0 - filled) + slope * inflow_ml_per_s, slope)
    }

    fn series_resistance(&self) -> f64 {
        self.r1
    }

    fn advance(&self, state: &mut [f64], inflow_ml_per_s: f64, step: TimeStep) {
        let filled = self.filled(step.dt_ms);
        state[0] += filled * (self.r2 * inflow_ml_per_s - state[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const LOAD: WindkesselParameters = WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: 0.03,
        peripheral_resistance_mmhg_s_per_ml: 0.9,
        compliance_ml_per_mmhg: 1.6,
    };

    /// Runs the load with a given flow and returns the pressures at the ends of the steps.
    fn run(
        p: &WindkesselParameters,
        start: f64,
        dt_ms: f64,
        n: usize,
        flow: impl Fn(f64) -> f64,
    ) -> Vec<f64> {
        let load = Windkessel3::new("aorta", p, Mmhg(start)).unwrap();
        let mut state = [0.0];
        load.start(&mut state);
        (1..=n)
            .map(|i| {
                let step = TimeStep {
                    end_ms: i as f64 * dt_ms,
                    dt_ms,
                };
                // The mean over the step, which is of second order for a smooth flow.
                let q = flow(step.end_ms - 0.5 * dt_ms);
                let (pressure, _) = load.pressure(&state, q, step);
                load.advance(&mut state, q, step);
                pressure
            })
            .collect()
    }

    #[test]
    fn constant_flow_ends_at_the_sum_of_resistances() {
        let p = run(&LOAD, 60.0, 1.0, 40_000, |_| 80.0);
        assert!((p[39_999] - 80.0 * 0.93).abs() < 1e-9);
    }

    #[test]
    fn diastole_is_exponential_to_round_off_at_any_step() {
        for dt in [0.1, 1.0, 50.0] {
            let n = (500.0 / dt) as usize;
            let p = run(&LOAD, 90.0, dt, n, |_| 0.0);
            assert!((p[n - 1] - 90.0 * (-500.0f64 / 1440.0).exp()).abs() < 1e-10);
        }
    }

    #[test]
    fn sinusoid_has_the_closed_form_gain_and_phase() {
        let (w, mean, amplitude) = (TAU / 800.0, 80.0, 50.0);
        let n = 24_000;
        let p = run(&LOAD, 72.0, 1.0, n, |t| mean + amplitude * (w * t).sin());
        let product = w * 1440.0;
        for (i, found) in p.iter().enumerate().skip(n - 800) {
            let t = (i + 1) as f64;
            let pc = mean * 0.9
                + amplitude * 0.9 / (1.0 + product * product).sqrt()
                    * (w * t - product.atan()).sin();
            let expected = pc + 0.03 * (mean + amplitude * (w * (t - 0.5)).sin());
            assert!((found - expected).abs() < 2e-4, "{i} {found} {expected}");
        }
    }

    #[test]
    fn svzerod_pulsatile_case() {
        // benchmarks.json, windkessel.svzerod_pulsatile (cgs numbers): Q = 2.2 + 2.5 sin(2πt), R1 =
        // R2 = 1000, C = 1e-4.
        let p = WindkesselParameters {
            characteristic_resistance_mmhg_s_per_ml: 1000.0,
            peripheral_resistance_mmhg_s_per_ml: 1000.0,
            compliance_ml_per_mmhg: 1e-4,
        };
        let flow = |t_ms: f64| 2.2 + 2.5 * (TAU * t_ms * 1e-3).sin();
        let trace = run(&p, 2200.0, 0.5, 20_000, flow);
        let last = &trace[18_000..];
        let (low, high) = last
            .iter()
            .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
        assert!(
            (low + 37.673).abs() < 1.0 && (high - 8837.673).abs() < 1.0,
            "{low} {high}"
        );
        assert!(
            (periodic_start(&p, Ms(1000.0), flow).0 - (2200.0 + 2116.8325 * (-0.560_982f64).sin()))
                .abs()
                < 0.01
        );
    }

    #[test]
    fn periodic_start_returns_after_a_cycle() {
        let flow = |t: f64| {
            if (50.0..350.0).contains(&t) {
                400.0 * ((t - 50.0) / 300.0 * TAU / 2.0).sin()
            } else {
                0.0
            }
        };
        let start = periodic_start(&LOAD, Ms(900.0), flow).0;
        let end = run(&LOAD, start, 0.5, 1800, flow)[1799];
        assert!((end - start).abs() < 1e-3, "{start} {end}");
    }

    #[test]
    fn each_parameter_moves_pressure_or_slope() {
        let at = |p: WindkesselParameters| {
            Windkessel3::new("a", &p, Mmhg(80.0)).unwrap().pressure(
                &[80.0],
                200.0,
                TimeStep {
                    end_ms: 1.0,
                    dt_ms: 1.0,
                },
            )
        };
        let moved = [
            WindkesselParameters {
                characteristic_resistance_mmhg_s_per_ml: 0.04,
                ..LOAD
            },
            WindkesselParameters {
                peripheral_resistance_mmhg_s_per_ml: 1.0,
                ..LOAD
            },
            WindkesselParameters {
                compliance_ml_per_mmhg: 1.7,
                ..LOAD
            },
        ];
        for p in moved {
            assert_ne!(at(p), at(LOAD), "{p:?}");
        }
        assert!(
            Windkessel3::new(
                "a",
                &WindkesselParameters {
                    compliance_ml_per_mmhg: 0.0,
                    ..LOAD
                },
                Mmhg(80.0)
            )
            .is_err()
        );
    }
}
