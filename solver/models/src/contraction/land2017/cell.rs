//! Land 2017 with the constants of one cell: its stress, stiffness and steady state.

use super::equations::{Equations, LEAST_OCCUPANCY};
use super::parameters::Land2017Parameters;
use crate::contraction::ContractionError;
use cardiotwin_units::{Kpa, MicroMolar, Stretch};

/// Names of the states, in their order.
pub const STATES: [&str; 6] = ["CaTRPN", "B", "W", "S", "zeta_W", "zeta_S"];

/// Land 2017 with its derived constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Land2017 {
    pub(crate) p: Land2017Parameters,
    pub(crate) k: Equations,
}

impl Land2017 {
    /// Checks the parameters and derives the constants.
    ///
    /// # Errors
    /// [`ContractionError::Parameter`] for a value outside its domain, [`ContractionError::NegativeKwu`] for a negative
    /// derived rate unless `allow_negative_k_wu`.
    pub fn new(parameters: Land2017Parameters) -> Result<Self, ContractionError> {
        let p = parameters;
        if let Some((parameter, value)) = p.first_outside() {
            return Err(ContractionError::Parameter {
                name: parameter.symbol,
                value,
                expected: parameter.domain.expected(),
            });
        }
        let k = Equations::new(&p);
        if k.k_wu < 0.0 && !p.allow_negative_k_wu {
            return Err(ContractionError::NegativeKwu {
                k_wu_per_ms: k.k_wu,
                k_uw_per_ms: p.k_uw_per_ms,
                r_w: p.r_w,
                k_ws_per_ms: p.k_ws_per_ms,
            });
        }
        Ok(Self { p, k })
    }

    /// The parameters it was made from.
    #[must_use]
    pub fn parameters(&self) -> &Land2017Parameters {
        &self.p
    }

    /// The equations with this cell's constants.
    #[must_use]
    pub fn equations(&self) -> &Equations {
        &self.k
    }

    /// Active stress Sa = h(λ) · (Smax_ref/r_S) · [(ζ_S + 1) S + ζ_W W] (eq. A14).
    ///
    /// - `state`: length 6, order as [`STATES`], dimensionless; `lambda`: fibre stretch
    #[must_use]
    pub fn active_stress(&self, state: &[f64; 6], lambda: Stretch) -> Kpa {
        Kpa(self.k.stress_kpa(state, lambda.0))
    }

    /// Active stiffness K_a = h(λ) · (Smax_ref/r_S) · A (S + W): the instantaneous slope of stress with stretch, for the
    /// stabilisation of a staggered step (Regazzoni and Quarteroni 2021).
    #[must_use]
    pub fn active_stiffness(&self, state: &[f64; 6], lambda: Stretch) -> Kpa {
        Kpa(self.k.overlap(lambda.0) * self.k.stress_scale * self.k.a * (state[2] + state[3]))
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
        let ca50 = self.k.ca50(lambda.0);
        if !(ca50 > 0.0 && ca.0 > 0.0) {
            return Err(ContractionError::Sensitivity {
                ca50_um: ca50,
                lambda: lambda.0,
            });
        }
        let r = (ca.0 / ca50).powf(self.p.n_trpn);
        let ca_trpn = r / (1.0 + r);
        let (down, up) = self.k.blocking(ca_trpn.max(LEAST_OCCUPANCY).ln());
        // Balance of B against U, then W and S in the ratios r_W (1 − r_S) and r_S of what is not blocked.
        let unbound = 1.0 - self.p.r_s - (1.0 - self.p.r_s) * self.p.r_w;
        let blocked_per_free = self.k.k_b * down / (self.p.k_u_per_ms * up) * unbound;
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

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_vector_math::{Dual, Lane, Number};

    fn default_cell() -> Land2017 {
        Land2017::new(Land2017Parameters::default()).unwrap()
    }

    #[test]
    fn derived_constants_of_the_defaults() {
        let cell = default_cell();
        let expected = [
            (cell.k.k_wu, 0.17),
            (cell.k.k_su, 0.018),
            (cell.k.a, 10.0),
            (cell.k.c_w, 0.40586),
            (cell.k.c_s, 0.04014),
        ];
        for (got, want) in expected {
            assert!((got - want).abs() < 1e-9, "{got} {want}");
        }
        assert!((cell.k.k_b - 0.014_006).abs() < 5e-7);
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
        assert_eq!(cell.k.overlap(1.2), cell.k.overlap(1.5));
        assert_eq!(cell.k.overlap(0.5), 0.0);
        assert_eq!(cell.k.overlap(1.0), 1.0);
        assert!((cell.k.overlap(0.8) - (1.0 + 2.3 * (1.6 - 1.87))).abs() < 1e-14);
        assert_eq!(cell.k.ca50(1.3), cell.k.ca50(1.2));
    }

    /// SciPy's rates along a prescribed stretch that changes (its header says how they were made), in every number.
    #[test]
    fn rates_of_an_outside_reference_under_changing_stretch() {
        let text = include_str!("../../../tests/data/land2017_changing_stretch.json");
        let document: serde_json::Value = serde_json::from_str(text).unwrap();
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let mut n_samples = 0;
        for case in document["cases"].as_array().unwrap() {
            let given = Land2017Parameters::TABLE.map(|p| number(&case["parameters"][p.name]));
            let cell = Land2017::new(Land2017Parameters {
                cap_unblocking: case["cap_unblocking"].as_bool().unwrap(),
                ..Land2017Parameters::from_values(given)
            })
            .unwrap();
            for sample in case["samples"].as_array().unwrap() {
                let [ca, lambda, rate] =
                    ["Ca_uM", "lambda", "lambda_rate_per_ms"].map(|key| number(&sample[key]));
                let state: [f64; 6] = std::array::from_fn(|i| number(&sample["states"][i]));
                let exact = cell.k.rates(&state, ca, lambda, rate);
                let fused =
                    cell.k
                        .rates(&state.map(Lane::<true>), Lane(ca), Lane(lambda), Lane(rate));
                let lane = cell.k.rates(
                    &state.map(Lane::<false>),
                    Lane(ca),
                    Lane(lambda),
                    Lane(rate),
                );
                let dual = cell.k.rates(
                    &state.map(Dual::<f64>::of),
                    Dual::of(ca),
                    Dual::of(lambda),
                    Dual::of(rate),
                );
                let narrow = cell.k.rates(
                    &state.map(|x| x as f32),
                    ca as f32,
                    lambda as f32,
                    rate as f32,
                );
                let terms = cell.k.terms(&state, ca, lambda);
                // The rate of B is a difference of large terms.
                let stiff = cell.k.k_b * terms.unblocking * (terms.unbound.abs() + 1e-3);
                for i in 0..6 {
                    let want = number(&sample["rates_per_ms"][i]);
                    let size = want.abs() + 0.1 + if i == 1 { stiff } else { 0.0 };
                    for got in [exact[i], fused[i].0, lane[i].0, dual[i].v] {
                        assert!(
                            (got - want).abs() < 1e-13 * size,
                            "rate {i}: {got} for {want}"
                        );
                    }
                    let unbound = if i == 1 {
                        stiff / terms.unbound.abs().max(1e-6)
                    } else {
                        0.0
                    };
                    let got = f64::from(narrow[i]);
                    // Powers multiply the rounding of single precision, 6e-8, by their exponent and logarithm.
                    assert!(
                        (got - want).abs() < 1e-5 * (size + unbound),
                        "rate {i}: {got} for {want}"
                    );
                }
                let sa = cell.k.stress_kpa(&state, lambda);
                assert!((sa - number(&sample["Sa_kPa"])).abs() < 1e-12 * (1.0 + sa.abs()));
                n_samples += 1;
            }
        }
        assert_eq!(n_samples, 5 * 61);
    }
}
