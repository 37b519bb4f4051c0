//! One time step of Land 2017 with a candidate stretch: two-stage, second order, L-stable, with its exact tangent.
//!
//! SDIRK2 (Alexander 1977, γ = 1 − 1/√2, stiffly accurate). Given calcium and stretch, each stage is a chain of linear
//! problems: troponin, then the distortions, then the three bridge states. The derivative with respect to the candidate
//! stretch is carried along beside every value, so that Newton in the organ sees the model's whole answer.

use super::land2017::Land2017;
use super::{ActiveStress, ContractionError, NodeStep};

/// γ of the method, 1 − 1/√2.
const GAMMA: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;

/// A value and its derivative with respect to the candidate stretch.
#[derive(Clone, Copy, Default)]
struct Dual {
    v: f64,
    d: f64,
}

impl Dual {
    const fn fixed(v: f64) -> Self {
        Self { v, d: 0.0 }
    }
    fn plus(self, other: Self, factor: f64) -> Self {
        Self { v: self.v + factor * other.v, d: self.d + factor * other.d }
    }
}

/// Solves the 3 × 3 system `m x = b` by Cramer's rule for two right-hand sides at once.
fn solve3(m: &[[f64; 3]; 3], b: &[f64; 3], inverse: &mut [[f64; 3]; 3]) -> [f64; 3] {
    let minor = |r0: usize, r1: usize, c0: usize, c1: usize| m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
    let c = [
        [minor(1, 2, 1, 2), -minor(0, 2, 1, 2), minor(0, 1, 1, 2)],
        [-minor(1, 2, 0, 2), minor(0, 2, 0, 2), -minor(0, 1, 0, 2)],
        [minor(1, 2, 0, 1), -minor(0, 2, 0, 1), minor(0, 1, 0, 1)],
    ];
    let det = m[0][0] * c[0][0] + m[0][1] * c[1][0] + m[0][2] * c[2][0];
    let scale = 1.0 / det;
    *inverse = c.map(|row| row.map(|x| x * scale));
    apply3(inverse, b)
}

fn apply3(m: &[[f64; 3]; 3], b: &[f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * b[0] + row[1] * b[1] + row[2] * b[2])
}

/// Solves `x = base + gh f(x)` for one stage; `base` and the result are the six states with their derivatives.
fn stage(
    cell: &Land2017,
    base: &[Dual; 6],
    gh: f64,
    ca_um: f64,
    lambda: Dual,
    rate: Dual,
) -> Result<[Dual; 6], ContractionError> {
    let p = &cell.p;
    let (ca50, dca50) = cell.ca50(lambda.v);
    if !(ca50 > 0.0 && ca_um > 0.0) {
        return Err(ContractionError::Sensitivity { ca50_um: ca50, lambda: lambda.v });
    }
    let r = (p.n_trpn * (ca_um / ca50).ln()).exp();
    let dr = -p.n_trpn * r / ca50 * dca50 * lambda.d;

    // Troponin: linear in its state.
    let k = gh * p.k_trpn_per_ms;
    let denominator = 1.0 / (1.0 + k * (r + 1.0));
    let trpn = (base[0].v + k * r) * denominator;
    let dtrpn = (base[0].d + k * dr * (1.0 - trpn)) * denominator;

    // Distortions.
    let distort = |base: Dual, c: f64| {
        let scale = 1.0 / (1.0 + gh * c);
        Dual { v: (base.v + gh * cell.a * rate.v) * scale, d: (base.d + gh * cell.a * rate.d) * scale }
    };
    let zeta_w = distort(base[4], cell.c_w);
    let zeta_s = distort(base[5], cell.c_s);

    // Bridges: linear in (B, W, S) with these coefficients.
    let (down, ddown, up, dup) = cell.blocking(trpn);
    let (gamma_wu, dgamma_wu) = cell.gamma_wu(zeta_w.v);
    let (gamma_su, dgamma_su) = cell.gamma_su(zeta_s.v);
    let (unblock, block) = (cell.k_b * down, p.k_u_per_ms * up);
    let matrix = [
        [1.0 + gh * (unblock + block), gh * unblock, gh * unblock],
        [gh * p.k_uw_per_ms, 1.0 + gh * (p.k_uw_per_ms + cell.k_wu + p.k_ws_per_ms + gamma_wu), gh * p.k_uw_per_ms],
        [0.0, -gh * p.k_ws_per_ms, 1.0 + gh * (cell.k_su + gamma_su)],
    ];
    let mut inverse = [[0.0; 3]; 3];
    let [b, w, s] =
        solve3(&matrix, &[base[1].v + gh * unblock, base[2].v + gh * p.k_uw_per_ms, base[3].v], &mut inverse);
    let dunblock = cell.k_b * ddown * dtrpn;
    let dblock = p.k_u_per_ms * dup * dtrpn;
    let [db, dw, ds] = apply3(
        &inverse,
        &[
            base[1].d + gh * (dunblock * (1.0 - b - w - s) - dblock * b),
            base[2].d - gh * dgamma_wu * zeta_w.d * w,
            base[3].d - gh * dgamma_su * zeta_s.d * s,
        ],
    );
    Ok([Dual { v: trpn, d: dtrpn }, Dual { v: b, d: db }, Dual { v: w, d: dw }, Dual { v: s, d: ds }, zeta_w, zeta_s])
}

/// See [`super::Contraction::try_step`].
pub(super) fn try_step(
    cell: &Land2017,
    step: &NodeStep,
    state: &[f64],
    trial: &mut [f64],
) -> Result<ActiveStress, ContractionError> {
    for lambda in [step.lambda, step.lambda_prev] {
        if !(lambda > 0.0 && lambda.is_finite()) {
            return Err(ContractionError::Stretch { lambda });
        }
    }
    let h = step.dt_ms;
    let gh = GAMMA * h;
    let start: [Dual; 6] = std::array::from_fn(|i| Dual::fixed(state[i]));
    let rate = Dual { v: (step.lambda - step.lambda_prev) / h, d: 1.0 / h };
    let between = Dual { v: step.lambda_prev + GAMMA * (step.lambda - step.lambda_prev), d: GAMMA };
    let ca_between = step.ca_start_um + GAMMA * (step.ca_end_um - step.ca_start_um);

    let first = stage(cell, &start, gh, ca_between, between, rate)?;
    // h f(first) follows from the stage equation itself.
    let base: [Dual; 6] = std::array::from_fn(|i| start[i].plus(first[i].plus(start[i], -1.0), (1.0 - GAMMA) / GAMMA));
    let end = stage(cell, &base, gh, step.ca_end_um, Dual { v: step.lambda, d: 1.0 }, rate)?;

    let [_, _, w, s, zeta_w, zeta_s] = end;
    let (overlap, doverlap) = cell.overlap(step.lambda);
    let pull = (zeta_s.v + 1.0) * s.v + zeta_w.v * w.v;
    let dpull = zeta_s.d * s.v + (zeta_s.v + 1.0) * s.d + zeta_w.d * w.v + zeta_w.v * w.d;
    let stress = ActiveStress {
        sa_kpa: cell.stress_scale * overlap * pull,
        dsa_dlambda_kpa: cell.stress_scale * (doverlap * pull + overlap * dpull),
    };
    for (out, value) in trial.iter_mut().zip(&end) {
        *out = value.v;
    }
    if !(stress.sa_kpa.is_finite() && stress.dsa_dlambda_kpa.is_finite() && trial.iter().all(|x| x.is_finite())) {
        return Err(ContractionError::NotFinite { since_activation_ms: step.since_activation_ms, lambda: step.lambda });
    }
    Ok(stress)
}

#[cfg(test)]
mod tests {
    use super::super::{Contraction, Land2017Parameters};
    use super::*;
    use crate::calcium::{Calcium, Rice2008, Rice2008Parameters};
    use cardiotwin_units::{MicroMolar, Stretch};
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
        let step = NodeStep { ca_start_um: 0.6, ca_end_um: 0.6, lambda_prev: 0.95, lambda: 0.95, ..STEP };
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
            Land2017Parameters { k_trpn_per_ms: 0.11, ..b },
            Land2017Parameters { n_trpn: 2.1, ..b },
            Land2017Parameters { ca50_ref_um: 0.79, ..b },
            Land2017Parameters { k_u_per_ms: 1.1, ..b },
            Land2017Parameters { n_tm: 5.1, ..b },
            Land2017Parameters { trpn50: 0.36, ..b },
            Land2017Parameters { k_uw_per_ms: 0.19, ..b },
            Land2017Parameters { k_ws_per_ms: 0.013, ..b },
            Land2017Parameters { r_w: 0.51, ..b },
            Land2017Parameters { r_s: 0.26, ..b },
            Land2017Parameters { gamma_w_per_ms: 0.63, ..b },
            Land2017Parameters { phi: 2.3, ..b },
            Land2017Parameters { a_eff: 26.0, ..b },
            Land2017Parameters { beta0: 2.4, ..b },
            Land2017Parameters { beta1_um: -2.5, ..b },
            Land2017Parameters { smax_ref_kpa: 121.0, ..b },
        ];
        for p in moved {
            let other = stress(p, STEP);
            assert!((other.sa_kpa - reference.sa_kpa).abs() > 1e-7, "{p:?}");
            assert!((other.dsa_dlambda_kpa - reference.dsa_dlambda_kpa).abs() > 1e-7, "{p:?}");
        }
        // γ_S acts outside −1 < ζ_S < 0 only.
        let lengthening = NodeStep { lambda: 1.0, ..STEP };
        let other = stress(Land2017Parameters { gamma_s_per_ms: 0.02, ..b }, lengthening);
        assert!((other.sa_kpa - stress(b, lengthening).sa_kpa).abs() > 1e-7);
    }

    #[test]
    fn bad_input_is_an_error() {
        let land = cell(Land2017Parameters::default());
        let mut trial = [0.0; 6];
        let bad = NodeStep { lambda: f64::NAN, ..STEP };
        assert!(matches!(land.try_step(&bad, &STATE, &mut trial), Err(ContractionError::Stretch { .. })));
        let far = cell(Land2017Parameters { beta1_um: -6.0, ..Default::default() });
        let long = NodeStep { lambda: 1.2, lambda_prev: 1.19, ..STEP };
        assert!(matches!(far.try_step(&long, &STATE, &mut trial), Err(ContractionError::Sensitivity { .. })));
    }

    proptest! {
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
