//! Land 2017 active stress of a human cardiomyocyte (Jung 2022, eqs. A4-A14), driven by calcium, stretch and its rate.

use super::land2017_step;
use super::{ActiveStress, Contraction, ContractionError, NodeStep, UniformStep};
use cardiotwin_units::{Kpa, MicroMolar, Stretch};
use serde::{Deserialize, Serialize};

/// Names of the states, in their order.
pub const STATES: [&str; 6] = ["CaTRPN", "B", "W", "S", "zeta_W", "zeta_S"];

/// Stretch above which length dependence stops (eq. A13 and every public implementation).
pub const LAMBDA_CAP: f64 = 1.2;
/// Stretch below which filament overlap shortens (eq. A13).
const LAMBDA_OVERLAP: f64 = 0.87;

/// Parameters of [`Land2017`] with the paper's names (Jung 2022, Table A2).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Land2017Parameters {
    /// Rate of calcium binding to troponin k_TRPN \[1/ms\].
    pub k_trpn_per_ms: f64,
    /// Cooperativity of that binding n_TRPN.
    pub n_trpn: f64,
    /// Reference calcium sensitivity Ca50_ref \[µM\].
    pub ca50_ref_um: f64,
    /// Unblocking rate k_U \[1/ms\].
    pub k_u_per_ms: f64,
    /// Hill coefficient of unblocking n_Tm.
    pub n_tm: f64,
    /// Troponin occupancy at half activation TRPN50.
    pub trpn50: f64,
    /// Rate from unbound to weakly bound k_UW \[1/ms\].
    pub k_uw_per_ms: f64,
    /// Rate from weakly to strongly bound k_WS \[1/ms\].
    pub k_ws_per_ms: f64,
    /// Steady ratio of weakly bound r_W.
    pub r_w: f64,
    /// Steady ratio of strongly bound r_S.
    pub r_s: f64,
    /// Strain-dependent unbinding of strong bridges γ_S \[1/ms\].
    pub gamma_s_per_ms: f64,
    /// Strain-dependent unbinding of weak bridges γ_W \[1/ms\].
    pub gamma_w_per_ms: f64,
    /// Distortion decay Φ.
    pub phi: f64,
    /// Magnitude of the instantaneous response to a stretch A_eff.
    pub a_eff: f64,
    /// Length dependence of the stress β0.
    pub beta0: f64,
    /// Length dependence of the sensitivity β1 \[µM\].
    pub beta1_um: f64,
    /// Reference stress Smax_ref \[kPa\].
    pub smax_ref_kpa: f64,
    /// Caps CaTRPN^(−n_Tm/2) at 100 as the published implementations do; off as printed in the paper.
    #[serde(default)]
    pub cap_unblocking: bool,
    /// Accepts a negative k_WU (4 % of Table A5's box), which only the sensitivity analysis may do.
    #[serde(default)]
    pub allow_negative_k_wu: bool,
}

impl Default for Land2017Parameters {
    /// Jung 2022, Table A2.
    fn default() -> Self {
        Self {
            k_trpn_per_ms: 0.1,
            n_trpn: 2.0,
            ca50_ref_um: 0.805,
            k_u_per_ms: 1.0,
            n_tm: 5.0,
            trpn50: 0.35,
            k_uw_per_ms: 0.182,
            k_ws_per_ms: 0.012,
            r_w: 0.5,
            r_s: 0.25,
            gamma_s_per_ms: 0.0085,
            gamma_w_per_ms: 0.615,
            phi: 2.23,
            a_eff: 25.0,
            beta0: 2.3,
            beta1_um: -2.4,
            smax_ref_kpa: 120.0,
            cap_unblocking: false,
            allow_negative_k_wu: false,
        }
    }
}

/// Land 2017 with its derived constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Land2017 {
    pub(crate) p: Land2017Parameters,
    pub(crate) k_wu: f64,
    pub(crate) k_su: f64,
    pub(crate) k_b: f64,
    /// Distortion per stretch A = A_W = A_S.
    pub(crate) a: f64,
    pub(crate) c_w: f64,
    pub(crate) c_s: f64,
    /// Smax_ref / r_S \[kPa\].
    pub(crate) stress_scale: f64,
}

impl Land2017 {
    /// Checks the parameters and derives k_WU, k_SU, k_B, A, c_W, c_S (eqs. A8-A12, misprints as resolved in docs/models.md).
    ///
    /// # Errors
    /// [`ContractionError::Parameter`] for a value outside its range, [`ContractionError::NegativeKwu`] for a negative
    /// derived rate unless `allow_negative_k_wu`.
    pub fn new(parameters: Land2017Parameters) -> Result<Self, ContractionError> {
        let p = parameters;
        let positive = [
            ("k_TRPN", p.k_trpn_per_ms),
            ("n_TRPN", p.n_trpn),
            ("Ca50_ref", p.ca50_ref_um),
            ("k_U", p.k_u_per_ms),
            ("n_Tm", p.n_tm),
            ("TRPN50", p.trpn50),
            ("k_UW", p.k_uw_per_ms),
            ("k_WS", p.k_ws_per_ms),
            ("Phi", p.phi),
            ("A_eff", p.a_eff),
            ("Smax_ref", p.smax_ref_kpa),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(ContractionError::Parameter {
                    name,
                    value,
                    expected: "positive",
                });
            }
        }
        for (name, value) in [
            ("gamma_S", p.gamma_s_per_ms),
            ("gamma_W", p.gamma_w_per_ms),
            ("beta0", p.beta0),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(ContractionError::Parameter {
                    name,
                    value,
                    expected: "zero or more",
                });
            }
        }
        for (name, value) in [("r_W", p.r_w), ("r_S", p.r_s)] {
            if !(value > 0.0 && value < 1.0) {
                return Err(ContractionError::Parameter {
                    name,
                    value,
                    expected: "between 0 and 1",
                });
            }
        }
        if !p.beta1_um.is_finite() {
            return Err(ContractionError::Parameter {
                name: "beta1",
                value: p.beta1_um,
                expected: "finite",
            });
        }
        let k_wu = p.k_uw_per_ms * (1.0 / p.r_w - 1.0) - p.k_ws_per_ms;
        if k_wu < 0.0 && !p.allow_negative_k_wu {
            return Err(ContractionError::NegativeKwu {
                k_wu_per_ms: k_wu,
                k_uw_per_ms: p.k_uw_per_ms,
                r_w: p.r_w,
                k_ws_per_ms: p.k_ws_per_ms,
            });
        }
        let unbound = 1.0 - p.r_s - (1.0 - p.r_s) * p.r_w;
        Ok(Self {
            p,
            k_wu,
            k_su: p.k_ws_per_ms * p.r_w * (1.0 / p.r_s - 1.0),
            k_b: p.k_u_per_ms * p.trpn50.powf(p.n_tm) / unbound,
            a: p.a_eff * p.r_s / ((1.0 - p.r_s) * p.r_w + p.r_s),
            c_w: p.phi * p.k_uw_per_ms * (1.0 - p.r_w) / p.r_w,
            c_s: p.phi * p.k_ws_per_ms * p.r_w * (1.0 - p.r_s) / p.r_s,
            stress_scale: p.smax_ref_kpa / p.r_s,
        })
    }

    /// The parameters it was made from.
    #[must_use]
    pub fn parameters(&self) -> &Land2017Parameters {
        &self.p
    }

    /// Ca50 = Ca50_ref + β1 (min(λ, 1.2) − 1) \[µM\] and its slope (eq. A5).
    #[inline]
    pub(crate) fn ca50(&self, lambda: f64) -> (f64, f64) {
        if lambda < LAMBDA_CAP {
            (
                self.p.ca50_ref_um + self.p.beta1_um * (lambda - 1.0),
                self.p.beta1_um,
            )
        } else {
            (
                self.p.ca50_ref_um + self.p.beta1_um * (LAMBDA_CAP - 1.0),
                0.0,
            )
        }
    }

    /// h(λ) = max(0, 1 + β0 (l + min(l, 0.87) − 1.87)), l = min(λ, 1.2), and its slope (eq. A13).
    #[inline]
    pub(crate) fn overlap(&self, lambda: f64) -> (f64, f64) {
        let (l, dl) = if lambda < LAMBDA_CAP {
            (lambda, 1.0)
        } else {
            (LAMBDA_CAP, 0.0)
        };
        let (second, dsecond) = if l < LAMBDA_OVERLAP {
            (l, dl)
        } else {
            (LAMBDA_OVERLAP, 0.0)
        };
        let h = 1.0 + self.p.beta0 * (l + second - (1.0 + LAMBDA_OVERLAP));
        if h > 0.0 {
            (h, self.p.beta0 * (dl + dsecond))
        } else {
            (0.0, 0.0)
        }
    }

    /// γ_WU = γ_W |ζ_W| and its slope (eq. A10).
    #[inline]
    pub(crate) fn gamma_wu(&self, zeta_w: f64) -> (f64, f64) {
        (
            self.p.gamma_w_per_ms * zeta_w.abs(),
            self.p.gamma_w_per_ms.copysign(zeta_w),
        )
    }

    /// γ_SU: γ_S (−ζ_S − 1) below −1, γ_S ζ_S above 0, else 0, and its slope (eq. A10).
    #[inline]
    pub(crate) fn gamma_su(&self, zeta_s: f64) -> (f64, f64) {
        let g = self.p.gamma_s_per_ms;
        if zeta_s > 0.0 {
            (g * zeta_s, g)
        } else if zeta_s < -1.0 {
            (g * (-zeta_s - 1.0), -g)
        } else {
            (0.0, 0.0)
        }
    }

    /// Unblocking and blocking factors CaTRPN^(−n_Tm/2) (capped if asked), CaTRPN^(n_Tm/2), and their slopes.
    #[inline]
    pub(crate) fn blocking(&self, ca_trpn: f64) -> (f64, f64, f64, f64) {
        let half = 0.5 * self.p.n_tm;
        // A floor far below any resting occupancy: an overshooting trial stage must give a bad step, not a NaN.
        let x = ca_trpn.max(1e-9);
        let up = (half * x.ln()).exp();
        let down = 1.0 / up;
        let (down, ddown) = if self.p.cap_unblocking && down > 100.0 {
            (100.0, 0.0)
        } else {
            (down, -half * down / x)
        };
        (down, ddown, up, half * up / x)
    }

    /// Active stress Sa = h(λ) · (Smax_ref/r_S) · [(ζ_S + 1) S + ζ_W W] (eq. A14).
    ///
    /// - `state`: length 6, order as [`STATES`], dimensionless; `lambda`: fibre stretch
    #[must_use]
    pub fn active_stress(&self, state: &[f64; 6], lambda: Stretch) -> Kpa {
        let [_, _, w, s, zeta_w, zeta_s] = *state;
        Kpa(self.overlap(lambda.0).0 * self.stress_scale * ((zeta_s + 1.0) * s + zeta_w * w))
    }

    /// Active stiffness K_a = h(λ) · (Smax_ref/r_S) · A (S + W): the instantaneous slope of stress with stretch, for the
    /// stabilisation of a staggered step (Regazzoni and Quarteroni 2021).
    #[must_use]
    pub fn active_stiffness(&self, state: &[f64; 6], lambda: Stretch) -> Kpa {
        Kpa(self.overlap(lambda.0).0 * self.stress_scale * self.a * (state[2] + state[3]))
    }

    /// Steady state at constant calcium and stretch; exact also with the cap on.
    ///
    /// # Errors
    /// [`ContractionError::Sensitivity`] where Ca50 is not positive, [`ContractionError::Stretch`] for a bad stretch.
    pub fn steady_state(
        &self,
        ca: MicroMolar,
        lambda: Stretch,
    ) -> Result<[f64; 6], ContractionError> {
        if !(lambda.0 > 0.0 && lambda.0.is_finite()) {
            return Err(ContractionError::Stretch { lambda: lambda.0 });
        }
        let (ca50, _) = self.ca50(lambda.0);
        if !(ca50 > 0.0 && ca.0 > 0.0) {
            return Err(ContractionError::Sensitivity {
                ca50_um: ca50,
                lambda: lambda.0,
            });
        }
        let r = (ca.0 / ca50).powf(self.p.n_trpn);
        let ca_trpn = r / (1.0 + r);
        let (down, _, up, _) = self.blocking(ca_trpn);
        // Balance of B against U, then W and S in the ratios r_W (1 − r_S) and r_S of what is not blocked.
        let unbound = 1.0 - self.p.r_s - (1.0 - self.p.r_s) * self.p.r_w;
        let blocked_per_free = self.k_b * down / (self.p.k_u_per_ms * up) * unbound;
        let free = 1.0 / (1.0 + blocked_per_free);
        Ok([
            ca_trpn,
            blocked_per_free * free,
            (1.0 - self.p.r_s) * self.p.r_w * free,
            self.p.r_s * free,
            0.0,
            0.0,
        ])
    }
}

impl Contraction for Land2017 {
    fn n_states(&self) -> usize {
        STATES.len()
    }

    fn needs_calcium(&self) -> bool {
        true
    }

    fn rest(&self, state: &mut [f64]) {
        // Almost no calcium bound: fully blocked, no bridges.
        state.copy_from_slice(&[1e-3, 1.0, 0.0, 0.0, 0.0, 0.0]);
    }

    fn try_step(
        &self,
        step: &NodeStep,
        state: &[f64],
        trial: &mut [f64],
    ) -> Result<ActiveStress, ContractionError> {
        land2017_step::try_step(self, step, state, trial)
    }

    fn try_step_uniform(
        &self,
        step: &UniformStep<'_>,
        states: &[f64],
        trials: &mut [f64],
        stress: &mut [ActiveStress],
    ) -> Result<(), ContractionError> {
        land2017_step::try_step_uniform(self, step, states, trials, stress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn default_cell() -> Land2017 {
        Land2017::new(Land2017Parameters::default()).unwrap()
    }

    #[test]
    fn derived_constants_of_the_defaults() {
        let cell = default_cell();
        let expected = [
            (cell.k_wu, 0.17),
            (cell.k_su, 0.018),
            (cell.a, 10.0),
            (cell.c_w, 0.40586),
            (cell.c_s, 0.04014),
        ];
        for (got, want) in expected {
            assert!((got - want).abs() < 1e-9, "{got} {want}");
        }
        assert!((cell.k_b - 0.014_006).abs() < 5e-7);
    }

    #[test]
    fn steady_state_values_of_the_benchmark() {
        let cell = default_cell();
        for (ca, ca_trpn, sa) in [
            (0.6, 0.357_133_999_65, 63.02412),
            (0.805, 0.5, 102.73357),
            (1.5, 0.776_390_817_9, 117.80665),
        ] {
            let state = cell.steady_state(MicroMolar(ca), Stretch(1.0)).unwrap();
            assert!((state[0] - ca_trpn).abs() < 1e-10);
            assert!(
                (cell.active_stress(&state, Stretch(1.0)).0 - sa).abs() < 5e-5,
                "{ca}"
            );
        }
    }

    #[test]
    fn cap_lifts_the_stress_at_low_calcium_only() {
        let capped = Land2017::new(Land2017Parameters {
            cap_unblocking: true,
            ..Default::default()
        })
        .unwrap();
        let stress = |cell: &Land2017, ca| {
            cell.active_stress(
                &cell.steady_state(MicroMolar(ca), Stretch(1.0)).unwrap(),
                Stretch(1.0),
            )
            .0
        };
        assert!((stress(&default_cell(), 0.3) - 0.613_019).abs() < 1e-6);
        assert!((stress(&capped, 0.3) - 1.174_888_4).abs() < 1e-6);
        assert_eq!(stress(&capped, 0.6), stress(&default_cell(), 0.6));
    }

    #[test]
    fn negative_k_wu_is_refused_unless_allowed() {
        let p = Land2017Parameters {
            r_w: 0.9,
            k_uw_per_ms: 0.05,
            ..Default::default()
        };
        assert!(matches!(
            Land2017::new(p),
            Err(ContractionError::NegativeKwu { .. })
        ));
        assert!(
            Land2017::new(Land2017Parameters {
                allow_negative_k_wu: true,
                ..p
            })
            .is_ok()
        );
    }

    #[test]
    fn instantaneous_step_is_a_eff_times_the_step() {
        // benchmarks.json, land2017.step: with h and Ca50 frozen, dSa/Sa = A_eff dλ.
        let cell = default_cell();
        let state = cell.steady_state(MicroMolar(0.805), Stretch(1.0)).unwrap();
        let sa = cell.active_stress(&state, Stretch(1.0)).0;
        let ka = cell.active_stiffness(&state, Stretch(1.0)).0;
        assert!((ka / sa - 25.0).abs() < 1e-10);
    }

    #[test]
    fn clips_of_length_dependence() {
        let cell = default_cell();
        assert_eq!(cell.overlap(1.2), cell.overlap(1.5));
        assert_eq!(cell.overlap(0.5), (0.0, 0.0));
        assert_eq!(cell.overlap(1.0).0, 1.0);
        assert!((cell.overlap(0.8).0 - (1.0 + 2.3 * (1.6 - 1.87))).abs() < 1e-14);
        assert_eq!(cell.ca50(1.3).0, cell.ca50(1.2).0);
    }

    proptest! {
        #[test]
        fn slopes_of_the_kernels(lambda in 0.6..1.4f64, zeta in -2.0..1.0f64, ca_trpn in 0.01..0.99f64) {
            let cell = default_cell();
            let h = 1e-7;
            let check = |f: &dyn Fn(f64) -> (f64, f64), x: f64| {
                let kinks = [0.87, 1.2, 0.0, -1.0, 0.717_6];
                if kinks.iter().all(|k| (x - k).abs() > 1e-4) {
                    let slope = (f(x + h).0 - f(x - h).0) / (2.0 * h);
                    assert!((slope - f(x).1).abs() < 1e-5 * (1.0 + slope.abs()), "{x} {slope} {:?}", f(x));
                }
            };
            check(&|l| cell.overlap(l), lambda);
            check(&|l| cell.ca50(l), lambda);
            check(&|z| cell.gamma_wu(z), zeta);
            check(&|z| cell.gamma_su(z), zeta);
            check(&|c| { let b = cell.blocking(c); (b.0, b.1) }, ca_trpn);
            check(&|c| { let b = cell.blocking(c); (b.2, b.3) }, ca_trpn);
        }
    }
}
