//! Arterial load of two compartments joined by an inertance, for coarctation and reflected waves.

use super::{CirculationError, Compartment, TimeStep, Windkessel3};
use cardiotwin_units::Mmhg;
use cardiotwin_vocabulary::circulation::WindkesselParameters;

/// Junction between the proximal and the distal part of the arteries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArterialJunction {
    /// Inertance L of the blood between the two parts \[mmHg·s²/mL\].
    pub inertance: f64,
    /// Proximal share f of the compliance, between 0 and 1.
    pub proximal_share: f64,
    /// Linear resistance R_l of the junction \[mmHg·s/mL\].
    pub resistance: f64,
    /// Quadratic loss K of the junction \[mmHg·s²/mL²\].
    pub loss: f64,
}

/// `P = R1 Q_in + P1`, `f C dP1/dt = Q_in − Q`, `L dQ/dt = P1 − P2 − R_l Q − K Q|Q|`,
/// `(1−f) C dP2/dt = Q − P2/R2`.
///
/// With L = R_l = K = 0 it is the three-element Windkessel. The states are P1, Q and P2. A step
/// uses the two-stage L-stable diagonally implicit Runge–Kutta method of order two (Alexander 1977,
/// SIAM J Numer Anal 14:1006) for a flow that is constant over the step. Each stage has a closed
/// form, so that no iteration is needed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplitWindkessel {
    name: &'static str,
    r1: f64,
    r2: f64,
    proximal: f64,
    distal: f64,
    junction: ArterialJunction,
    start_mmhg: f64,
}

/// Coefficient of both stages, 1 − 1/√2.
const GAMMA: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;

impl SplitWindkessel {
    /// A load called `name` with the initial pressure `start` on both compliances.
    ///
    /// # Errors
    /// [`CirculationError::Parameter`] if a Windkessel parameter is outside its range, the share is
    /// not between 0 and 1, or a junction parameter is negative.
    pub fn new(
        name: &'static str,
        p: &WindkesselParameters,
        junction: ArterialJunction,
        start: Mmhg,
    ) -> Result<Self, CirculationError> {
        Windkessel3::new(name, p, start)?;
        let bad = |parameter, value, expected| {
            Err(CirculationError::Parameter {
                component: name,
                name: parameter,
                value,
                expected,
            })
        };
        let share = junction.proximal_share;
        if !(share > 0.0 && share < 1.0) {
            return bad("proximal share", share, "between 0 and 1");
        }
        let losses = [
            ("inertance", junction.inertance),
            ("resistance", junction.resistance),
            ("quadratic loss", junction.loss),
        ];
        for (parameter, value) in losses {
            if !(value >= 0.0 && value.is_finite()) {
                return bad(parameter, value, "zero or more");
            }
        }
        Ok(Self {
            name,
            r1: p.characteristic_resistance_mmhg_s_per_ml,
            r2: p.peripheral_resistance_mmhg_s_per_ml,
            proximal: share * p.compliance_ml_per_mmhg,
            distal: (1.0 - share) * p.compliance_ml_per_mmhg,
            junction,
            start_mmhg: start.0,
        })
    }

    /// Solves `y = r + h f(y)` for an inflow; returns `y` and its derivative with respect to the
    /// inflow, given that of `r`.
    fn stage(&self, r: [f64; 3], dr: [f64; 3], h: f64, inflow: f64) -> ([f64; 3], [f64; 3]) {
        let ArterialJunction {
            inertance,
            resistance,
            loss,
            ..
        } = self.junction;
        let leak = 1.0 + h / (self.r2 * self.distal);
        let linear = inertance + h * (resistance + h / self.proximal + h / (self.distal * leak));
        let driven = |r: [f64; 3], inflow: f64| {
            inertance * r[1] + h * (r[0] + h * inflow / self.proximal - r[2] / leak)
        };
        let b = driven(r, inflow);
        let root = (linear * linear + 4.0 * h * loss * b.abs()).sqrt();
        let flow = 2.0 * b / (linear + root);
        let dflow = driven(dr, 1.0) / root;
        let at = |r: [f64; 3], inflow: f64, flow: f64| {
            [
                r[0] + h * (inflow - flow) / self.proximal,
                flow,
                (r[2] + h * flow / self.distal) / leak,
            ]
        };
        (at(r, inflow, flow), at(dr, 1.0, dflow))
    }

    /// States at the end of a step, and their derivatives with respect to the inflow.
    fn step(&self, state: &[f64], inflow: f64, dt_ms: f64) -> ([f64; 3], [f64; 3]) {
        let h = GAMMA * dt_ms * 1e-3;
        let start = [state[0], state[1], state[2]];
        let (first, dfirst) = self.stage(start, [0.0; 3], h, inflow);
        // h f(y1) = y1 − y0; the second stage starts from y0 + (1 − γ) dt f(y1).
        let share = (1.0 - GAMMA) / GAMMA;
        let second: [f64; 3] = std::array::from_fn(|i| start[i] + share * (first[i] - start[i]));
        self.stage(second, dfirst.map(|d| share * d), h, inflow)
    }
}

impl Compartment for SplitWindkessel {
    fn name(&self) -> &'static str {
        self.name
    }

    fn n_states(&self) -> usize {
        3
    }

    /// Both parts discharge together: the proximal share of the distal resistance's flow passes
    /// through the junction.
    fn start(&self, state: &mut [f64]) {
        state[0] = self.start_mmhg;
        state[1] = self.junction.proximal_share * self.start_mmhg / self.r2;
        state[2] = self.start_mmhg;
    }

    fn pressure(&self, state: &[f64], inflow_ml_per_s: f64, step: TimeStep) -> (f64, f64) {
        if step.dt_ms == 0.0 {
            return (state[0] + self.r1 * inflow_ml_per_s, self.r1);
        }
        let (end, slope) = self.step(state, inflow_ml_per_s, step.dt_ms);
        (end[0] + self.r1 * inflow_ml_per_s, slope[0] + self.r1)
    }

    fn series_resistance(&self) -> f64 {
        self.r1
    }

    fn advance(&self, state: &mut [f64], inflow_ml_per_s: f64, step: TimeStep) {
        let (end, _) = self.step(state, inflow_ml_per_s, step.dt_ms);
        state.copy_from_slice(&end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LOAD: WindkesselParameters = WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: 0.05,
        peripheral_resistance_mmhg_s_per_ml: 0.9,
        compliance_ml_per_mmhg: 1.5,
    };
    const JUNCTION: ArterialJunction = ArterialJunction {
        inertance: 0.01,
        proximal_share: 0.3,
        resistance: 0.05,
        loss: 2e-4,
    };

    fn load(junction: ArterialJunction) -> SplitWindkessel {
        SplitWindkessel::new("aorta", &LOAD, junction, Mmhg(80.0)).unwrap()
    }

    fn flow(t_ms: f64) -> f64 {
        if (50.0..350.0).contains(&t_ms) {
            400.0 * ((t_ms - 50.0) / 300.0 * std::f64::consts::PI).sin()
        } else {
            0.0
        }
    }

    fn run(load: &dyn Compartment, dt_ms: f64) -> Vec<f64> {
        let mut state = vec![0.0; load.n_states()];
        load.start(&mut state);
        (1..=(800.0 / dt_ms) as usize)
            .map(|i| {
                let step = TimeStep {
                    end_ms: i as f64 * dt_ms,
                    dt_ms,
                };
                let q = flow(step.end_ms - 0.5 * dt_ms);
                let (pressure, _) = load.pressure(&state, q, step);
                load.advance(&mut state, q, step);
                pressure
            })
            .collect()
    }

    #[test]
    fn without_a_junction_it_is_the_three_element_windkessel() {
        let whole = run(&Windkessel3::new("aorta", &LOAD, Mmhg(80.0)).unwrap(), 1.0);
        for inertance in [0.0, 1e-7] {
            let open = ArterialJunction {
                inertance,
                resistance: 0.0,
                loss: 0.0,
                ..JUNCTION
            };
            let split = run(&load(open), 1.0);
            let largest = whole
                .iter()
                .zip(&split)
                .fold(0.0f64, |l, (a, b)| l.max((a - b).abs()));
            assert!(largest < 2e-3, "{inertance} {largest}");
        }
    }

    #[test]
    fn a_lossless_junction_rings_at_its_own_frequency() {
        // With R2 infinite and no inflow: Q = Q0 cos(ωt), ω² = (1/C1 + 1/C2)/L.
        let closed = WindkesselParameters {
            peripheral_resistance_mmhg_s_per_ml: 1e12,
            ..LOAD
        };
        let junction = ArterialJunction {
            resistance: 0.0,
            loss: 0.0,
            ..JUNCTION
        };
        let load = SplitWindkessel::new("aorta", &closed, junction, Mmhg(80.0)).unwrap();
        let omega = ((1.0 / 0.45 + 1.0 / 1.05) / 0.01f64).sqrt();
        let mut state = [80.0, 100.0, 80.0];
        for i in 1..=400 {
            load.advance(
                &mut state,
                0.0,
                TimeStep {
                    end_ms: f64::from(i),
                    dt_ms: 1.0,
                },
            );
            let expected = 100.0 * (omega * f64::from(i) * 1e-3).cos();
            assert!(
                (state[1] - expected).abs() < 0.05,
                "{i} {} {expected}",
                state[1]
            );
        }
        let volume = 0.45 * state[0] + 1.05 * state[2];
        assert!((volume - 1.5 * 80.0).abs() < 1e-9);
    }

    #[test]
    fn converges_with_order_two() {
        // Pressures are compared at common times, flows at the middle of each step.
        let fine = run(&load(JUNCTION), 0.0625);
        let error = |dt: f64| {
            let trace = run(&load(JUNCTION), dt);
            let every = (dt / 0.0625) as usize;
            let tail = trace.iter().enumerate().skip((400.0 / dt) as usize);
            tail.fold(0.0f64, |l, (i, p)| {
                l.max((p - fine[(i + 1) * every - 1]).abs())
            })
        };
        let order = (error(4.0) / error(2.0)).log2();
        assert!((order - 2.0).abs() < 0.3, "{order}");
    }

    #[test]
    fn each_parameter_moves_the_pressure_and_nonsense_is_refused() {
        let base = run(&load(JUNCTION), 1.0);
        for moved in [
            ArterialJunction {
                inertance: 0.02,
                ..JUNCTION
            },
            ArterialJunction {
                proximal_share: 0.4,
                ..JUNCTION
            },
            ArterialJunction {
                resistance: 0.1,
                ..JUNCTION
            },
            ArterialJunction {
                loss: 4e-4,
                ..JUNCTION
            },
        ] {
            assert!(
                run(&load(moved), 1.0)
                    .iter()
                    .zip(&base)
                    .any(|(a, b)| (a - b).abs() > 0.5),
                "{moved:?}"
            );
        }
        for bad in [
            ArterialJunction {
                proximal_share: 1.0,
                ..JUNCTION
            },
            ArterialJunction {
                inertance: -1.0,
                ..JUNCTION
            },
            ArterialJunction {
                loss: f64::NAN,
                ..JUNCTION
            },
        ] {
            assert!(SplitWindkessel::new("aorta", &LOAD, bad, Mmhg(80.0)).is_err());
        }
    }

    proptest! {
        #[test]
        fn slope_is_a_slope(
            p1 in 40.0..140.0f64, q in -100.0..500.0f64, p2 in 40.0..140.0f64, inflow in -50.0..500.0f64, dt in 0.05..4.0f64
        ) {
            let (load, step) = (load(JUNCTION), TimeStep { end_ms: dt, dt_ms: dt });
            let at = |inflow| load.pressure(&[p1, q, p2], inflow, step);
            let slope = (at(inflow + 1e-2).0 - at(inflow - 1e-2).0) / 2e-2;
            prop_assert!((slope - at(inflow).1).abs() < 1e-6 * (1.0 + slope.abs()), "{slope} {}", at(inflow).1);
            prop_assert!(slope > 0.0);
        }
    }
}
