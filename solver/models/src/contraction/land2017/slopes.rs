//! Slopes of the terms of Land 2017, derived by hand for Newton and Rosenbrock steps.

use super::Land2017;
use super::equations::{
    LAMBDA_CAP, LAMBDA_OVERLAP, LEAST_OCCUPANCY, Terms, UNBLOCKING_CAP, gamma_su,
};

/// Slopes of [`Terms`], each with respect to the one quantity that it depends on next to Ca50.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TermSlopes {
    /// Slope dCa50/dλ of the half-saturation \[µM\].
    pub ca50_um: f64,
    /// Slope of the unblocking factor with CaTRPN.
    pub unblocking: f64,
    /// Slope of the blocking factor with CaTRPN.
    pub blocking: f64,
    /// Slope dγ_WU/dζ_W of the weak bridges' unbinding \[1/ms\].
    pub gamma_wu: f64,
    /// Slope dγ_SU/dζ_S of the strong bridges' unbinding \[1/ms\].
    pub gamma_su: f64,
}

impl Land2017 {
    /// Slopes of `terms` at the same state and stretch.
    #[inline]
    pub(crate) fn term_slopes(
        &self,
        state: &[f64; 6],
        terms: &Terms<f64>,
        lambda: f64,
    ) -> TermSlopes {
        let [trpn, _, _, _, zeta_w, zeta_s] = *state;
        let half = self.k.half_n_tm;
        let occupied = trpn.max(LEAST_OCCUPANCY);
        let is_capped = self.p.cap_unblocking && terms.unblocking >= UNBLOCKING_CAP;
        TermSlopes {
            ca50_um: self.ca50_slope(lambda),
            unblocking: if is_capped {
                0.0
            } else {
                -half * terms.unblocking / occupied
            },
            blocking: half * terms.blocking / occupied,
            gamma_wu: self.gamma_wu_slope(zeta_w),
            gamma_su: gamma_su(self.k.gamma_s, zeta_s).1,
        }
    }

    /// Slope dCa50/dλ, zero above the stretch of 1.2, where Ca50 is constant \[µM\].
    #[inline]
    pub(crate) fn ca50_slope(&self, lambda: f64) -> f64 {
        if lambda < LAMBDA_CAP {
            self.p.beta1_um
        } else {
            0.0
        }
    }

    /// Slope dh/dλ of the overlap, zero where the filaments do not overlap.
    #[inline]
    pub(crate) fn overlap_slope(&self, lambda: f64) -> f64 {
        let dl = if lambda < LAMBDA_CAP { 1.0 } else { 0.0 };
        let dm = if lambda < LAMBDA_OVERLAP { dl } else { 0.0 };
        if self.k.overlap(lambda) > 0.0 {
            self.p.beta0 * (dl + dm)
        } else {
            0.0
        }
    }

    /// Slope dγ_WU/dζ_W of the weak bridges' unbinding \[1/ms\].
    #[inline]
    pub(super) fn gamma_wu_slope(&self, zeta_w: f64) -> f64 {
        self.p.gamma_w_per_ms.copysign(zeta_w)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Land2017Parameters;
    use super::*;
    use cardiotwin_vector_math::Dual;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn slopes_are_those_of_the_equations(
            lambda in 0.6..1.4f64, zeta_w in -2.0..1.0f64, zeta_s in -2.0..1.0f64, trpn in 0.01..0.99f64, capped in any::<bool>()
        ) {
            let cell = Land2017::new(Land2017Parameters { cap_unblocking: capped, ..Default::default() }).unwrap();
            let state = [trpn, 0.4, 0.1, 0.1, zeta_w, zeta_s];
            let terms = cell.k.terms(&state, 0.5, lambda);
            let slopes = cell.term_slopes(&state, &terms, lambda);
            let along = |i: usize| {
                let state = std::array::from_fn(|j| Dual { v: state[j], d: f64::from(u8::from(i == j)) });
                let lambda = Dual { v: lambda, d: f64::from(u8::from(i == 6)) };
                (cell.k.terms(&state, Dual { v: 0.5, d: 0.0 }, lambda), cell.k.overlap(lambda))
            };
            for (got, want) in [
                (slopes.ca50_um, along(6).0.ca50_um.d),
                (slopes.unblocking, along(0).0.unblocking.d),
                (slopes.blocking, along(0).0.blocking.d),
                (slopes.gamma_wu, along(4).0.gamma_wu.d),
                (slopes.gamma_su, along(5).0.gamma_su.d),
                (cell.overlap_slope(lambda), along(6).1.d),
            ] {
                prop_assert!((got - want).abs() <= 1e-13 * want.abs(), "{} {}", got, want);
            }
        }
    }
}
