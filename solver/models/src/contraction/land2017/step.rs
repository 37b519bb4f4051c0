//! One time step of Land 2017 with a candidate stretch: two-stage, second order, L-stable, with its exact tangent.
//!
//! SDIRK2 (Alexander 1977, γ = 1 − 1/√2, stiffly accurate). Given calcium and stretch, each stage is a chain of linear
//! problems: troponin, then the distortions, then the three bridge states. The derivative with respect to the candidate
//! stretch is carried along next to every value, so that Newton in the organ sees the model's whole answer.
//!
//! The elimination is by hand; its terms are those of [`super::equations`], and a test puts the stages back into the equations.
//!
//! The step of one node has no branches: nodes are lanes of SIMD vectors. Products are not
//! fused with sums, so that every processor gives the same bits.

use cardiotwin_vector_math::{Dual, Lane, Number, max, min};
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
    /// Values at two stretches that nobody has checked, without branches.
    #[inline(always)]
    fn unchecked(cell: &Land2017, dt_ms: f64, lambda_prev: f64, lambda: f64) -> Self {
        let sensitivity = |lambda: f64, share: f64| Dual {
            v: cell.k.ca50(lambda),
            d: cell.ca50_slope(lambda) * share,
        };
        Self {
            rate: Dual {
                v: (lambda - lambda_prev) / dt_ms,
                d: 1.0 / dt_ms,
            },
            ca50: [
                sensitivity(lambda_prev + GAMMA * (lambda - lambda_prev), GAMMA),
                sensitivity(lambda, 1.0),
            ],
            scale: Dual {
                v: cell.k.stress_scale * cell.k.overlap(lambda),
                d: cell.k.stress_scale * cell.overlap_slope(lambda),
            },
        }
    }

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
        let stretched = Self::unchecked(cell, dt_ms, lambda_prev, lambda);
        let between = lambda_prev + GAMMA * (lambda - lambda_prev);
        for (ca50, lambda) in stretched.ca50.iter().zip([between, lambda]) {
            if ca50.v.is_nan() || ca50.v <= 0.0 {
                let ca50_um = ca50.v;
                return Err(ContractionError::Sensitivity { ca50_um, lambda });
            }
        }
        Ok(stretched)
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
    /// Stretch at the start and at the end of the step.
    lambda: [[f64; LANES]; 2],
    stress: [[f64; LANES]; 2],
}

/// Steps of many nodes, to be compiled for each instruction set. The result tells whether all
/// stretches and calcium sensitivities were positive.
struct Blocks<'a, L> {
    cell: &'a Land2017,
    dt_ms: f64,
    /// Stretch of a node at the start and at the end of the step.
    lambda: L,
    calcium_um: [&'a [f64]; 2],
    states: &'a [f64],
    trials: &'a mut [f64],
    stress: &'a mut [ActiveStress],
}

impl<L: Fn(usize) -> [f64; 2]> WithSimd for Blocks<'_, L> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        let Self {
            cell,
            dt_ms,
            lambda: lambda_of,
            calcium_um,
            states,
            trials,
            stress: stresses,
        } = self;
        let shared = Shared::new(cell, dt_ms);
        let n = stresses.len();
        let (calcium_start, calcium_end) = (&calcium_um[0][..n], &calcium_um[1][..n]);
        let (states, trials) = (&states[..N * n], &mut trials[..N * n]);
        let mut block = Block {
            states: [[0.0; LANES]; N],
            calcium_um: [[0.0; LANES]; 2],
            lambda: [[0.0; LANES]; 2],
            stress: [[0.0; LANES]; 2],
        };
        let mut is_sound = true;
        for first in (0..n).step_by(LANES) {
            let n_here = LANES.min(n - first);
            for lane in 0..LANES {
                // Lanes beyond the last node repeat it.
                let node = first + lane.min(n_here - 1);
                for i in 0..N {
                    block.states[i][lane] = states[node * N + i];
                }
                block.calcium_um[0][lane] = calcium_start[node];
                block.calcium_um[1][lane] = calcium_end[node];
                [block.lambda[0][lane], block.lambda[1][lane]] = lambda_of(node);
            }
            is_sound &= step_block(&mut block, &shared, dt_ms);
            for lane in 0..n_here {
                let node = first + lane;
                for i in 0..N {
                    trials[node * N + i] = block.states[i][lane];
                }
                stresses[node] = ActiveStress {
                    sa_kpa: block.stress[0][lane],
                    dsa_dlambda_kpa: block.stress[1][lane],
                };
            }
        }
        is_sound
    }
}

/// A step of a block; whether all stretches and sensitivities are positive.
#[inline(always)]
fn step_block(block: &mut Block, shared: &Shared, dt_ms: f64) -> bool {
    let Block {
        states: [c, b, w, s, zeta_w, zeta_s],
        calcium_um: [ca_start, ca_end],
        lambda: [lambda_prev, lambda],
        stress: [sa, dsa],
    } = block;
    let shared = *shared;
    let mut least = [f64::INFINITY; LANES];
    for lane in 0..LANES {
        let state = [
            c[lane],
            b[lane],
            w[lane],
            s[lane],
            zeta_w[lane],
            zeta_s[lane],
        ];
        let stretched = Stretched::unchecked(&shared.cell, dt_ms, lambda_prev[lane], lambda[lane]);
        let (end, stress) = shared.step(state, [ca_start[lane], ca_end[lane]], &stretched);
        c[lane] = end[0];
        b[lane] = end[1];
        w[lane] = end[2];
        s[lane] = end[3];
        zeta_w[lane] = end[4];
        zeta_s[lane] = end[5];
        (sa[lane], dsa[lane]) = (stress.sa_kpa, stress.dsa_dlambda_kpa);
        let sensitivity = min(stretched.ca50[0].v, stretched.ca50[1].v);
        least[lane] = min(sensitivity, min(lambda_prev[lane], lambda[lane]));
    }
    least.iter().all(|least| *least > 0.0)
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
    let calcium_um = [step.ca_start_um, step.ca_end_um];
    let stretches = [step.lambda_prev, step.lambda];
    let made = Arch::new().dispatch(Blocks {
        cell,
        dt_ms: step.dt_ms,
        lambda: |_| stretches,
        calcium_um,
        states,
        trials: &mut *trials,
        stress: &mut *stress,
    });
    if made && are_sound(calcium_um, trials, stress) {
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
    let n = stress.len();
    let (lambda_prev, lambda) = (&step.lambda_prev[..n], &step.lambda[..n]);
    let made = Arch::new().dispatch(Blocks {
        cell,
        dt_ms: step.dt_ms,
        lambda: |node: usize| [lambda_prev[node], lambda[node]],
        calcium_um,
        states,
        trials: &mut *trials,
        stress: &mut *stress,
    });
    if made && are_sound(calcium_um, trials, stress) {
        return Ok(());
    }
    // For the error of the first one that fails.
    in_turn(cell, |node| step.node(node), states, trials, stress)
}

#[cfg(test)]
#[path = "step_tests.rs"]
mod tests;
