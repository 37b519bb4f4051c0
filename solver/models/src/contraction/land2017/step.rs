//! One time step of Land 2017 with a candidate stretch: two-stage, second order, L-stable, with its exact tangent.
//!
//! SDIRK2 (Alexander 1977, γ = 1 − 1/√2, stiffly accurate). Given calcium and stretch, each stage is a chain of linear
//! problems: troponin, then the distortions, then the three bridge states. The derivative with respect to the candidate
//! stretch is carried along beside every value, so that Newton in the organ sees the model's whole answer.
//!
//! The elimination is by hand; its terms are those of [`super::equations`], and a test puts the stages back into the equations.
//!
//! The step of one node has no branches: nodes are lanes of SIMD vectors. Products are not
//! fused with sums, so that every processor gives the same bits.

use cardiotwin_vector_math::{Dual, Lane, Number, max};
use pulp::{Arch, Simd, WithSimd};

use super::Land2017;
use super::equations::{LEAST_OCCUPANCY, UNBLOCKING_CAP, gamma_su};
use crate::contraction::{
    ActiveStress, ContractionError, EachStep, NodeStep, UniformStep, in_turn,
};

/// γ of the method, 1 − 1/√2.
const GAMMA: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
/// Nodes that advance together: two vectors of eight, so that one hides the latency of the other.
const LANES: usize = 16;
/// States of a node.
const N: usize = 6;

/// Values that all nodes of a step share.
#[derive(Clone, Copy)]
struct Shared {
    cell: Land2017,
    /// γ times the step's length \[ms\].
    gh: f64,
}

/// Values of a step that follow from the stretch.
#[derive(Clone, Copy)]
struct Stretched {
    /// Rate of the stretch \[1/ms\].
    rate: Dual,
    /// Ca50 at the two stages \[µM\].
    ca50: [Dual; 2],
    /// Stress per pull \[kPa\].
    scale: Dual,
}

impl Stretched {
    fn new(
        cell: &Land2017,
        dt_ms: f64,
        lambda_prev: f64,
        lambda: f64,
    ) -> Result<Self, ContractionError> {
        for lambda in [lambda, lambda_prev] {
            if !(lambda > 0.0 && lambda.is_finite()) {
                return Err(ContractionError::Stretch { lambda });
            }
        }
        let sensitivity = |lambda: f64, share: f64| {
            let v = cell.k.ca50(lambda);
            if v > 0.0 {
                Ok(Dual {
                    v,
                    d: cell.ca50_slope(lambda) * share,
                })
            } else {
                Err(ContractionError::Sensitivity { ca50_um: v, lambda })
            }
        };
        Ok(Self {
            rate: Dual {
                v: (lambda - lambda_prev) / dt_ms,
                d: 1.0 / dt_ms,
            },
            ca50: [
                sensitivity(lambda_prev + GAMMA * (lambda - lambda_prev), GAMMA)?,
                sensitivity(lambda, 1.0)?,
            ],
            scale: Dual {
                v: cell.k.stress_scale * cell.k.overlap(lambda),
                d: cell.k.stress_scale * cell.overlap_slope(lambda),
            },
        })
    }
}

impl Shared {
    fn new(cell: &Land2017, dt_ms: f64) -> Self {
        Self {
            cell: *cell,
            gh: GAMMA * dt_ms,
        }
    }

    /// Solves `x = base + gh f(x)` for one stage; `base` and the result are the six states with their derivatives.
    #[inline(always)]
    fn stage(&self, base: [Dual; N], ca_um: f64, rate: Dual, ca50: Dual) -> [Dual; N] {
        let Self { cell, gh } = *self;
        let (p, constants) = (cell.p, cell.k);
        let ln_ca = Lane::<false>(ca_um).ln_ratio(Lane(ca50.v));
        let r = cell.k.binding(ln_ca).0;
        let dr = -p.n_trpn * r / ca50.v * ca50.d;

        // Troponin: linear in its state.
        let k = gh * p.k_trpn_per_ms;
        let denominator = 1.0 / (1.0 + k * (r + 1.0));
        let trpn = (base[0].v + k * r) * denominator;
        let dtrpn = (base[0].d + k * dr * (1.0 - trpn)) * denominator;

        // Distortions.
        let (scale_w, scale_s) = (
            1.0 / (1.0 + gh * constants.c_w),
            1.0 / (1.0 + gh * constants.c_s),
        );
        let distort = |base: Dual, scale: f64| Dual {
            v: (base.v + gh * constants.a * rate.v) * scale,
            d: (base.d + gh * constants.a * rate.d) * scale,
        };
        let (zeta_w, zeta_s) = (distort(base[4], scale_w), distort(base[5], scale_s));

        // Bridges: linear in (B, W, S), by Cramer's rule for two right-hand sides at once.
        let (down, ddown, up, dup) = blocking(&cell, trpn);
        let (gamma_wu, dgamma_wu) = (cell.k.gamma_wu(zeta_w.v), cell.gamma_wu_slope(zeta_w.v));
        let (gamma_su, dgamma_su) = gamma_su(p.gamma_s_per_ms, zeta_s.v);
        let m00 = 1.0 + gh * (constants.k_b * down + p.k_u_per_ms * up);
        let m01 = gh * (constants.k_b * down);
        let m10 = gh * p.k_uw_per_ms;
        let m11 = 1.0 + gh * (p.k_uw_per_ms + constants.k_wu + p.k_ws_per_ms + gamma_wu);
        let m21 = -gh * p.k_ws_per_ms;
        let m22 = 1.0 + gh * (constants.k_su + gamma_su);
        // First row (m00, m01, m01), second (m10, m11, m10), third (0, m21, m22).
        let (c00, c01, c02) = (
            m11 * m22 - m10 * m21,
            -(m01 * m22 - m01 * m21),
            m01 * m10 - m01 * m11,
        );
        let (c10, c11, c12) = (-(m10 * m22), m00 * m22, -(m00 * m10 - m01 * m10));
        let (c20, c21, c22) = (m10 * m21, -(m00 * m21), m00 * m11 - m01 * m10);
        let inverse = 1.0 / (m00 * c00 + m01 * c10 + m01 * c20);
        let solve = |x: f64, y: f64, z: f64| {
            let product =
                |a: f64, b: f64, c: f64| inverse * a * x + inverse * b * y + inverse * c * z;
            (
                product(c00, c01, c02),
                product(c10, c11, c12),
                product(c20, c21, c22),
            )
        };
        let (b, w, s) = solve(base[1].v + m01, base[2].v + m10, base[3].v);
        let dunblock = constants.k_b * ddown * dtrpn;
        let dblock = p.k_u_per_ms * dup * dtrpn;
        let (db, dw, ds) = solve(
            base[1].d + gh * (dunblock * (1.0 - b - w - s) - dblock * b),
            base[2].d - gh * dgamma_wu * zeta_w.d * w,
            base[3].d - gh * dgamma_su * zeta_s.d * s,
        );
        [
            Dual { v: trpn, d: dtrpn },
            Dual { v: b, d: db },
            Dual { v: w, d: dw },
            Dual { v: s, d: ds },
            zeta_w,
            zeta_s,
        ]
    }

    /// One node's step from `state`: its end and its stress.
    #[inline(always)]
    fn step(
        &self,
        state: [f64; N],
        [ca_start_um, ca_end_um]: [f64; 2],
        stretched: &Stretched,
    ) -> ([f64; N], ActiveStress) {
        let Stretched { rate, ca50, scale } = *stretched;
        let [c, b, w, s, zeta_w, zeta_s] = state;
        let start = [
            Dual::of(c),
            Dual::of(b),
            Dual::of(w),
            Dual::of(s),
            Dual::of(zeta_w),
            Dual::of(zeta_s),
        ];
        let ca_between = ca_start_um + GAMMA * (ca_end_um - ca_start_um);
        let first = self.stage(start, ca_between, rate, ca50[0]);
        // h f(first) follows from the stage equation itself.
        let share = (1.0 - GAMMA) / GAMMA;
        let further = |from: Dual, to: Dual| Dual {
            v: from.v + share * (to.v - from.v),
            d: share * to.d,
        };
        let base = [
            further(start[0], first[0]),
            further(start[1], first[1]),
            further(start[2], first[2]),
            further(start[3], first[3]),
            further(start[4], first[4]),
            further(start[5], first[5]),
        ];
        let end = self.stage(base, ca_end_um, rate, ca50[1]);
        let [c, b, w, s, zeta_w, zeta_s] = end;
        let pull = (zeta_s.v + 1.0) * s.v + zeta_w.v * w.v;
        let dpull = zeta_s.d * s.v + (zeta_s.v + 1.0) * s.d + zeta_w.d * w.v + zeta_w.v * w.d;
        let stress = ActiveStress {
            sa_kpa: scale.v * pull,
            dsa_dlambda_kpa: scale.d * pull + scale.v * dpull,
        };
        ([c.v, b.v, w.v, s.v, zeta_w.v, zeta_s.v], stress)
    }
}

/// Unblocking factor, its slope with CaTRPN, blocking factor and its slope, in the numbers of vector code.
#[inline(always)]
fn blocking(cell: &Land2017, ca_trpn: f64) -> (f64, f64, f64, f64) {
    let occupied = max(ca_trpn, LEAST_OCCUPANCY);
    let ln_trpn = Lane::<false>(occupied).ln_ratio(Lane(1.0));
    let (Lane(down), Lane(up)) = cell.k.blocking(ln_trpn);
    let slope = cell.k.half_n_tm / occupied;
    let is_capped = cell.p.cap_unblocking & (down >= UNBLOCKING_CAP);
    let ddown = if is_capped { 0.0 } else { -down * slope };
    (down, ddown, up, up * slope)
}

/// Makes the step of [`crate::contraction::Contraction::try_step`].
pub(super) fn try_step(
    cell: &Land2017,
    step: &NodeStep,
    state: &[f64],
    trial: &mut [f64],
) -> Result<ActiveStress, ContractionError> {
    let shared = Shared::new(cell, step.dt_ms);
    let stretched = Stretched::new(cell, step.dt_ms, step.lambda_prev, step.lambda)?;
    if !(step.ca_start_um > 0.0 && step.ca_end_um > 0.0) {
        return Err(ContractionError::Sensitivity {
            ca50_um: stretched.ca50[1].v,
            lambda: step.lambda,
        });
    }
    let (end, stress) = shared.step(
        std::array::from_fn(|i| state[i]),
        [step.ca_start_um, step.ca_end_um],
        &stretched,
    );
    trial.copy_from_slice(&end);
    if !(is_finite(&stress) && trial.iter().all(|x| x.is_finite())) {
        return Err(ContractionError::NotFinite {
            since_activation_ms: step.since_activation_ms,
            lambda: step.lambda,
        });
    }
    Ok(stress)
}

fn is_finite(stress: &ActiveStress) -> bool {
    stress.sa_kpa.is_finite() && stress.dsa_dlambda_kpa.is_finite()
}

/// States, calcium, stretch and results of the nodes that advance together.
#[repr(align(64))]
struct Block {
    states: [[f64; LANES]; N],
    calcium_um: [[f64; LANES]; 2],
    /// Rate, Ca50 at both stages and stress per pull, each with its derivative.
    stretched: [[[f64; LANES]; 2]; 4],
    stress: [[f64; LANES]; 2],
}

/// A step of a block, to be compiled for each instruction set.
struct BlockStep<'a> {
    block: &'a mut Block,
    shared: &'a Shared,
}

impl WithSimd for BlockStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Block {
            states: [c, b, w, s, zeta_w, zeta_s],
            calcium_um: [ca_start, ca_end],
            stretched: [rate, first, second, scale],
            stress: [sa, dsa],
        } = self.block;
        let shared = *self.shared;
        for lane in 0..LANES {
            let state = [
                c[lane],
                b[lane],
                w[lane],
                s[lane],
                zeta_w[lane],
                zeta_s[lane],
            ];
            let dual = |[v, d]: &[[f64; LANES]; 2]| Dual {
                v: v[lane],
                d: d[lane],
            };
            let stretched = Stretched {
                rate: dual(rate),
                ca50: [dual(first), dual(second)],
                scale: dual(scale),
            };
            let (end, stress) = shared.step(state, [ca_start[lane], ca_end[lane]], &stretched);
            [
                c[lane],
                b[lane],
                w[lane],
                s[lane],
                zeta_w[lane],
                zeta_s[lane],
            ] = end;
            (sa[lane], dsa[lane]) = (stress.sa_kpa, stress.dsa_dlambda_kpa);
        }
    }
}

/// Steps of nodes with the stretch that `stretched` gives for each: the same bits as node after node.
fn try_step_blocks(
    cell: &Land2017,
    dt_ms: f64,
    mut stretched: impl FnMut(usize) -> Result<Stretched, ContractionError>,
    [ca_start_um, ca_end_um]: [&[f64]; 2],
    states: &[f64],
    (trials, stress): (&mut [f64], &mut [ActiveStress]),
) -> Result<(), ContractionError> {
    let shared = Shared::new(cell, dt_ms);
    let n = stress.len();
    let mut block = Block {
        states: [[0.0; LANES]; N],
        calcium_um: [[0.0; LANES]; 2],
        stretched: [[[0.0; LANES]; 2]; 4],
        stress: [[0.0; LANES]; 2],
    };
    let arch = Arch::new();
    for first in (0..n).step_by(LANES) {
        let n_here = LANES.min(n - first);
        for lane in 0..LANES {
            // Lanes beyond the last node repeat it.
            let node = first + lane.min(n_here - 1);
            for i in 0..N {
                block.states[i][lane] = states[node * N + i];
            }
            block.calcium_um[0][lane] = ca_start_um[node];
            block.calcium_um[1][lane] = ca_end_um[node];
            let Stretched { rate, ca50, scale } = stretched(node)?;
            for (to, from) in block
                .stretched
                .iter_mut()
                .zip([rate, ca50[0], ca50[1], scale])
            {
                to[0][lane] = from.v;
                to[1][lane] = from.d;
            }
        }
        arch.dispatch(BlockStep {
            block: &mut block,
            shared: &shared,
        });
        for lane in 0..n_here {
            let node = first + lane;
            for i in 0..N {
                trials[node * N + i] = block.states[i][lane];
            }
            stress[node] = ActiveStress {
                sa_kpa: block.stress[0][lane],
                dsa_dlambda_kpa: block.stress[1][lane],
            };
        }
    }
    Ok(())
}

/// Whether each node's calcium and result are numbers that [`try_step`] accepts.
fn are_sound(calcium_um: [&[f64]; 2], trials: &[f64], stress: &[ActiveStress]) -> bool {
    stress.iter().all(is_finite)
        && trials.iter().all(|x| x.is_finite())
        && calcium_um.into_iter().flatten().all(|ca| *ca > 0.0)
}

/// See [`crate::contraction::Contraction::try_step_uniform`]: the same bits as node after node.
pub(super) fn try_step_uniform(
    cell: &Land2017,
    step: &UniformStep<'_>,
    states: &[f64],
    trials: &mut [f64],
    stress: &mut [ActiveStress],
) -> Result<(), ContractionError> {
    let stretched = Stretched::new(cell, step.dt_ms, step.lambda_prev, step.lambda)?;
    let calcium_um = [step.ca_start_um, step.ca_end_um];
    let of_node = |_| Ok(stretched);
    let out = (&mut *trials, &mut *stress);
    try_step_blocks(cell, step.dt_ms, of_node, calcium_um, states, out)?;
    if are_sound(calcium_um, trials, stress) {
        return Ok(());
    }
    // For the error of the first one that fails.
    in_turn(cell, |node| step.node(node), states, trials, stress)
}

/// See [`crate::contraction::Contraction::try_step_each`]: the same bits as node after node.
pub(super) fn try_step_each(
    cell: &Land2017,
    step: &EachStep<'_>,
    states: &[f64],
    trials: &mut [f64],
    stress: &mut [ActiveStress],
) -> Result<(), ContractionError> {
    let calcium_um = [step.ca_start_um, step.ca_end_um];
    let of_node =
        |node| Stretched::new(cell, step.dt_ms, step.lambda_prev[node], step.lambda[node]);
    let out = (&mut *trials, &mut *stress);
    let made = try_step_blocks(cell, step.dt_ms, of_node, calcium_um, states, out);
    if made.is_ok() && are_sound(calcium_um, trials, stress) {
        return Ok(());
    }
    // For the error of the first one that fails.
    in_turn(cell, |node| step.node(node), states, trials, stress)
}

#[cfg(test)]
mod tests {
    use super::super::Land2017Parameters;
    use super::*;
    use crate::calcium::{Calcium, Rice2008, Rice2008Parameters};
    use crate::contraction::Contraction;
    use cardiotwin_units::{MicroMolar, Stretch};
    use cardiotwin_vocabulary::cell::cell_parameter;
    use proptest::prelude::*;

    fn cell(p: Land2017Parameters) -> Land2017 {
        Land2017::new(p).unwrap()
    }

    const STEP: NodeStep = NodeStep {
        since_activation_ms: 60.0,
        dt_ms: 1.0,
        ca_start_um: 0.5,
        ca_end_um: 0.51,
        lambda_prev: 0.97,
        lambda: 0.967,
    };
    const STATE: [f64; 6] = [0.25, 0.6, 0.1, 0.05, 0.12, -0.2];

    fn stress(p: Land2017Parameters, step: NodeStep) -> ActiveStress {
        cell(p).try_step(&step, &STATE, &mut [0.0; 6]).unwrap()
    }

    #[test]
    fn steady_state_stays() {
        let land = cell(Land2017Parameters::default());
        let state = land.steady_state(MicroMolar(0.6), Stretch(0.95)).unwrap();
        let step = NodeStep {
            ca_start_um: 0.6,
            ca_end_um: 0.6,
            lambda_prev: 0.95,
            lambda: 0.95,
            ..STEP
        };
        let mut trial = [0.0; 6];
        land.try_step(&step, &state, &mut trial).unwrap();
        for (a, b) in trial.iter().zip(state) {
            assert!((a - b).abs() < 1e-14);
        }
    }

    #[test]
    fn is_second_order_in_time() {
        let land = cell(Land2017Parameters::default());
        let rice = Rice2008::new(Rice2008Parameters::default()).unwrap();
        let run = |n: usize| {
            let dt = 200.0 / n as f64;
            let mut state = land.steady_state(MicroMolar(0.15), Stretch(1.0)).unwrap();
            let lambda = |t: f64| 1.0 - 0.15 * (t / 200.0).powi(2);
            let mut sa = 0.0;
            for k in 0..n {
                let (t0, t1) = (k as f64 * dt, (k + 1) as f64 * dt);
                let step = NodeStep {
                    since_activation_ms: t1,
                    dt_ms: dt,
                    ca_start_um: rice.concentration_um(t0),
                    ca_end_um: rice.concentration_um(t1),
                    lambda_prev: lambda(t0),
                    lambda: lambda(t1),
                };
                let mut trial = [0.0; 6];
                sa = land.try_step(&step, &state, &mut trial).unwrap().sa_kpa;
                state = trial;
            }
            sa
        };
        let exact = run(6400);
        let errors = [100, 200, 400].map(|n| (run(n) - exact).abs());
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 2.0).abs() < 0.2, "{errors:?}");
        }
        assert!(errors[1] < 0.05, "1 ms steps: {errors:?}");
    }

    #[test]
    fn each_parameter_moves_stress_and_tangent() {
        let b = Land2017Parameters::default();
        let reference = stress(b, STEP);
        let moved = [
            Land2017Parameters {
                k_trpn_per_ms: 0.11,
                ..b
            },
            Land2017Parameters { n_trpn: 2.1, ..b },
            Land2017Parameters {
                ca50_ref_um: 0.79,
                ..b
            },
            Land2017Parameters {
                k_u_per_ms: 1.1,
                ..b
            },
            Land2017Parameters { n_tm: 5.1, ..b },
            Land2017Parameters { trpn50: 0.36, ..b },
            Land2017Parameters {
                k_uw_per_ms: 0.19,
                ..b
            },
            Land2017Parameters {
                k_ws_per_ms: 0.013,
                ..b
            },
            Land2017Parameters { r_w: 0.51, ..b },
            Land2017Parameters { r_s: 0.26, ..b },
            Land2017Parameters {
                gamma_w_per_ms: 0.63,
                ..b
            },
            Land2017Parameters { phi: 2.3, ..b },
            Land2017Parameters { a_eff: 26.0, ..b },
            Land2017Parameters { beta0: 2.4, ..b },
            Land2017Parameters {
                beta1_um: -2.5,
                ..b
            },
            Land2017Parameters {
                smax_ref_kpa: 121.0,
                ..b
            },
        ];
        for p in moved {
            let other = stress(p, STEP);
            assert!((other.sa_kpa - reference.sa_kpa).abs() > 1e-7, "{p:?}");
            assert!(
                (other.dsa_dlambda_kpa - reference.dsa_dlambda_kpa).abs() > 1e-7,
                "{p:?}"
            );
        }
        // γ_S acts outside −1 < ζ_S < 0 only.
        let lengthening = NodeStep {
            lambda: 1.0,
            ..STEP
        };
        let other = stress(
            Land2017Parameters {
                gamma_s_per_ms: 0.02,
                ..b
            },
            lengthening,
        );
        assert!((other.sa_kpa - stress(b, lengthening).sa_kpa).abs() > 1e-7);
    }

    #[test]
    fn bad_input_is_an_error() {
        let land = cell(Land2017Parameters::default());
        let mut trial = [0.0; 6];
        let bad = NodeStep {
            lambda: f64::NAN,
            ..STEP
        };
        assert!(matches!(
            land.try_step(&bad, &STATE, &mut trial),
            Err(ContractionError::Stretch { .. })
        ));
        let far = cell(Land2017Parameters {
            beta1_um: -6.0,
            ..Default::default()
        });
        let long = NodeStep {
            lambda: 1.2,
            lambda_prev: 1.19,
            ..STEP
        };
        assert!(matches!(
            far.try_step(&long, &STATE, &mut trial),
            Err(ContractionError::Sensitivity { .. })
        ));
    }

    #[test]
    fn nodes_of_one_stretch_step_as_each_alone_to_the_bit() {
        let land = cell(Land2017Parameters::default());
        for n in [1, 7, 16, 32, 37] {
            let ca: Vec<f64> = (0..n).map(|i| 0.1 + 0.02 * i as f64).collect();
            let ca_end: Vec<f64> = ca.iter().map(|ca| 1.05 * ca).collect();
            let since = vec![60.0; n];
            let states: Vec<f64> = (0..n)
                .flat_map(|i| STATE.map(|x| x * (1.0 - 0.01 * i as f64)))
                .collect();
            let step = UniformStep {
                dt_ms: 1.0,
                lambda_prev: 0.97,
                lambda: 0.967,
                since_activation_ms: &since,
                ca_start_um: &ca,
                ca_end_um: &ca_end,
            };
            let (mut trials, mut stress) = (vec![0.0; 6 * n], vec![ActiveStress::default(); n]);
            land.try_step_uniform(&step, &states, &mut trials, &mut stress)
                .unwrap();
            for (node, stress) in stress.iter().enumerate() {
                let (range, mut trial) = (6 * node..6 * node + 6, [0.0; 6]);
                let alone = land
                    .try_step(&step.node(node), &states[range.clone()], &mut trial)
                    .unwrap();
                assert_eq!(
                    (alone, &trial[..]),
                    (*stress, &trials[range]),
                    "node {node} of {n}"
                );
            }
        }
    }

    #[test]
    fn nodes_with_stretches_of_their_own_step_as_each_alone_to_the_bit() {
        let land = cell(Land2017Parameters::default());
        for n in [1, 16, 37] {
            let ca: Vec<f64> = (0..n).map(|i| 0.1 + 0.02 * i as f64).collect();
            let lambda_prev: Vec<f64> = (0..n).map(|i| 1.1 - 0.01 * i as f64).collect();
            let lambda: Vec<f64> = lambda_prev.iter().map(|l| 0.997 * l).collect();
            let states: Vec<f64> = (0..n)
                .flat_map(|i| STATE.map(|x| x * (1.0 - 0.01 * i as f64)))
                .collect();
            let step = EachStep {
                dt_ms: 1.0,
                lambda_prev: &lambda_prev,
                lambda: &lambda,
                since_activation_ms: &vec![60.0; n],
                ca_start_um: &ca,
                ca_end_um: &ca,
            };
            let (mut trials, mut stress) = (vec![0.0; 6 * n], vec![ActiveStress::default(); n]);
            land.try_step_each(&step, &states, &mut trials, &mut stress)
                .unwrap();
            for (node, stress) in stress.iter().enumerate() {
                let (range, mut trial) = (6 * node..6 * node + 6, [0.0; 6]);
                let alone = land
                    .try_step(&step.node(node), &states[range.clone()], &mut trial)
                    .unwrap();
                assert_eq!(
                    (alone, &trial[..]),
                    (*stress, &trials[range]),
                    "{node} of {n}"
                );
            }
        }
    }

    #[test]
    fn the_first_node_that_fails_is_named() {
        let land = cell(Land2017Parameters::default());
        let (ca, states) = ([0.3, 0.3, -1.0], STATE.repeat(3));
        let step = UniformStep {
            dt_ms: 1.0,
            lambda_prev: 0.97,
            lambda: 0.967,
            since_activation_ms: &[60.0; 3],
            ca_start_um: &ca,
            ca_end_um: &ca,
        };
        let (mut trials, mut stress) = ([0.0; 18], [ActiveStress::default(); 3]);
        let error = land
            .try_step_uniform(&step, &states, &mut trials, &mut stress)
            .unwrap_err();
        assert!(
            matches!(error, ContractionError::Sensitivity { .. }),
            "{error:?}"
        );
    }

    proptest! {
        /// A stage solves x = base + γh f(x) of the equations, and so does its derivative with the candidate stretch.
        #[test]
        fn stages_solve_the_equations(
            place in prop::array::uniform17(0.0..1.0f64), capped in any::<bool>(),
            lambda in 0.7..1.25f64, lambda_prev in 0.7..1.25f64, dt in 0.05..2.0f64, ca in 0.1..1.0f64,
            trpn in 0.05..0.9f64, w in 0.0..0.3f64, s in 0.0..0.3f64, zw in -0.5..0.5f64, zs in -1.5..0.5f64,
        ) {
            let mut i = 0;
            let mut p = Land2017Parameters::from_values(Land2017Parameters::TABLE.map(|row| {
                let [low, high] = cell_parameter(row.name).unwrap().interval.unwrap();
                i += 1;
                low + place[i - 1] * (high - low)
            }));
            p.cap_unblocking = capped;
            p.allow_negative_k_wu = true;
            let land = cell(p);
            let shared = Shared::new(&land, dt);
            let Ok(stretched) = Stretched::new(&land, dt, lambda_prev, lambda) else {
                // Ca50 is not positive at this stretch.
                return Ok(());
            };
            // Any derivative of the base will do: the stage is linear in it.
            let base = [trpn, 0.4, w, s, zw, zs].map(|v| Dual { v, d: 0.3 - v });
            for (ca50, share) in stretched.ca50.into_iter().zip([GAMMA, 1.0]) {
                let x = shared.stage(base, ca, stretched.rate, ca50);
                let at = Dual { v: lambda_prev + share * (lambda - lambda_prev), d: share };
                let rates = land.k.rates(&x, Dual::of(ca), at, stretched.rate);
                // The rate of B is a difference of large terms.
                let stiff = shared.gh * land.k.k_b * land.k.blocking(x[0].v.ln()).0;
                // So is the rate of CaTRPN where little of Ca50 is left.
                let binding = shared.gh * land.k.k_trpn * land.k.binding((ca / ca50.v).ln());
                for i in 0..N {
                    let (change, slope) = (shared.gh * rates[i].v, shared.gh * rates[i].d);
                    let size = 1.0 + change.abs() + stiff + if i == 0 { binding } else { 0.0 };
                    let dsize = 1.0 + slope.abs() + x[i].d.abs() + 100.0 * stiff;
                    let miss = x[i].v - base[i].v - change;
                    let dmiss = x[i].d - base[i].d - slope;
                    prop_assert!(miss.abs() < 1e-12 * size, "state {}: {} of {}", i, miss, change);
                    prop_assert!(dmiss.abs() < 1e-11 * dsize, "slope {}: {} of {}", i, dmiss, slope);
                }
            }
        }

        #[test]
        fn tangent_is_the_slope(
            lambda in 0.75..1.15f64, lambda_prev in 0.75..1.15f64, dt in 0.05..2.0f64, ca in 0.1..1.0f64,
            trpn in 0.05..0.9f64, w in 0.0..0.3f64, s in 0.0..0.3f64, zw in -0.5..0.5f64, zs in -1.2..0.5f64
        ) {
            let land = cell(Land2017Parameters::default());
            let state = [trpn, 0.4, w, s, zw, zs];
            let at = |lambda: f64| {
                let step = NodeStep { lambda, lambda_prev, dt_ms: dt, ca_start_um: ca, ca_end_um: 1.02 * ca, ..STEP };
                land.try_step(&step, &state, &mut [0.0; 6]).unwrap()
            };
            let h = 1e-7;
            let slope = (at(lambda + h).sa_kpa - at(lambda - h).sa_kpa) / (2.0 * h);
            let tangent = at(lambda).dsa_dlambda_kpa;
            // Kinks of the distortion rates inside the difference are allowed to miss, everything else is not.
            let one_sided = (at(lambda + h).dsa_dlambda_kpa - at(lambda - h).dsa_dlambda_kpa).abs();
            prop_assert!((slope - tangent).abs() < 1e-4 * (1.0 + tangent.abs()) + one_sided, "{slope} {tangent}");
        }
    }
}
