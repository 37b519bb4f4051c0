//! The equations of Land 2017 (Jung 2022, eqs. A4-A14), written once over any [`Number`].
//!
//! The 0D cell takes its right-hand side from here, the organ's step its terms in the numbers of vector code; dual numbers
//! give the slopes that hand-derived ones are tested against.

use super::Land2017;
use cardiotwin_vector_math::Number;

/// Stretch above which length dependence stops (eq. A13 and every public implementation).
pub const LAMBDA_CAP: f64 = 1.2;
/// Stretch below which filament overlap shortens (eq. A13).
pub const LAMBDA_OVERLAP: f64 = 0.87;
/// Floor of CaTRPN inside powers, far below any resting occupancy: an overshooting trial stage must give a bad step, not a
/// NaN.
pub(super) const LEAST_OCCUPANCY: f64 = 1e-9;
/// Largest unblocking factor where the cap is on.
pub(super) const UNBLOCKING_CAP: f64 = 100.0;

/// Terms of the rates that their slopes need as well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms<T> {
    /// Ca50 \[µM\].
    pub ca50_um: T,
    /// (Ca/Ca50)^n_TRPN.
    pub binding: T,
    /// CaTRPN^(−n_Tm/2), capped if asked.
    pub unblocking: T,
    /// CaTRPN^(n_Tm/2).
    pub blocking: T,
    /// U = 1 − B − W − S.
    pub unbound: T,
    /// γ_WU \[1/ms\].
    pub gamma_wu: T,
    /// γ_SU \[1/ms\].
    pub gamma_su: T,
}

/// h = max(0, 1 + β0 (l + m − 1.87)) of `l` = min(λ, 1.2) and `m` = min(l, 0.87) (eq. A13); a solver that keeps to one side
/// of 0.87 during a step gives its own `m`.
#[inline(always)]
pub fn overlap<T: Number>(beta0: T, l: T, m: T) -> T {
    let h = beta0.mul_add(l + m - T::of(1.0 + LAMBDA_OVERLAP), T::of(1.0));
    h.max(T::of(0.0))
}

/// γ_SU: γ_S (−ζ_S − 1) below −1, γ_S ζ_S above 0, else 0 (eq. A10), and its slope; without branches.
#[inline(always)]
pub fn gamma_su<T: Number>(gamma_s: T, zeta_s: T) -> (T, T) {
    let (zero, one) = (T::of(0.0), T::of(1.0));
    let is_behind = zeta_s.is_below(-one);
    let slope = if zero.is_below(zeta_s) { gamma_s } else { zero };
    let slope = if is_behind { -gamma_s } else { slope };
    let excess = if is_behind { zeta_s + one } else { zeta_s };
    (slope * excess, slope)
}

impl Land2017 {
    /// Rates of the six states \[1/ms\] (eqs. A4, A6-A10).
    ///
    /// - `state`: order as [`super::STATES`], dimensionless
    /// - `ca_um`: calcium \[µM\]; `lambda`: fibre stretch; `lambda_rate`: its rate \[1/ms\]
    #[inline(always)]
    pub fn rates<T: Number>(&self, state: &[T; 6], ca_um: T, lambda: T, lambda_rate: T) -> [T; 6] {
        self.rates_from(state, &self.terms(state, ca_um, lambda), lambda_rate)
    }

    /// The terms of [`Self::rates`].
    #[inline(always)]
    pub fn terms<T: Number>(&self, state: &[T; 6], ca_um: T, lambda: T) -> Terms<T> {
        let [trpn, b, w, s, zeta_w, zeta_s] = *state;
        let ca50_um = self.ca50(lambda);
        let (unblocking, blocking) = self.blocking(trpn);
        Terms {
            ca50_um,
            binding: self.binding(ca_um, ca50_um),
            unblocking,
            blocking,
            unbound: T::of(1.0) - b - w - s,
            gamma_wu: self.gamma_wu(zeta_w),
            gamma_su: gamma_su(T::of(self.p.gamma_s_per_ms), zeta_s).0,
        }
    }

    /// [`Self::rates`] from their terms.
    #[inline(always)]
    pub fn rates_from<T: Number>(
        &self,
        state: &[T; 6],
        terms: &Terms<T>,
        lambda_rate: T,
    ) -> [T; 6] {
        let (p, k, of) = (&self.p, &self.k, T::of);
        let [trpn, b, w, s, zeta_w, zeta_s] = *state;
        let out_of_w = of(k.k_wu + p.k_ws_per_ms) + terms.gamma_wu;
        let pulled = of(k.a) * lambda_rate;
        [
            of(p.k_trpn_per_ms) * (terms.binding * (of(1.0) - trpn) - trpn),
            of(k.k_b) * terms.unblocking * terms.unbound - of(p.k_u_per_ms) * terms.blocking * b,
            of(p.k_uw_per_ms) * terms.unbound - out_of_w * w,
            of(p.k_ws_per_ms) * w - (of(k.k_su) + terms.gamma_su) * s,
            pulled - of(k.c_w) * zeta_w,
            pulled - of(k.c_s) * zeta_s,
        ]
    }

    /// Active stress Sa = h(λ) · (Smax_ref/r_S) · [(ζ_S + 1) S + ζ_W W] \[kPa\] (eq. A14).
    #[inline(always)]
    pub fn stress_kpa<T: Number>(&self, state: &[T; 6], lambda: T) -> T {
        self.overlap(lambda) * T::of(self.k.stress_scale) * pull(state)
    }

    /// Ca50 = Ca50_ref + β1 (min(λ, 1.2) − 1) \[µM\] (eq. A5).
    #[inline(always)]
    pub fn ca50<T: Number>(&self, lambda: T) -> T {
        let l = lambda.min(T::of(LAMBDA_CAP));
        T::of(self.p.ca50_ref_um) + T::of(self.p.beta1_um) * (l - T::of(1.0))
    }

    /// h(λ) (eq. A13).
    #[inline(always)]
    pub fn overlap<T: Number>(&self, lambda: T) -> T {
        let l = lambda.min(T::of(LAMBDA_CAP));
        overlap(T::of(self.p.beta0), l, l.min(T::of(LAMBDA_OVERLAP)))
    }

    /// (Ca/Ca50)^n_TRPN (eq. A4); not a number where Ca50 is not positive.
    #[inline(always)]
    pub(super) fn binding<T: Number>(&self, ca_um: T, ca50_um: T) -> T {
        (T::of(self.p.n_trpn) * ca_um.ln_ratio(ca50_um)).exp()
    }

    /// Unblocking and blocking factors CaTRPN^(−n_Tm/2), capped if asked, and CaTRPN^(n_Tm/2) (eq. A6).
    #[inline(always)]
    pub(super) fn blocking<T: Number>(&self, ca_trpn: T) -> (T, T) {
        let one = T::of(1.0);
        let occupied = ca_trpn.max(T::of(LEAST_OCCUPANCY));
        let blocking = (T::of(0.5 * self.p.n_tm) * occupied.ln_ratio(one)).exp();
        let printed = one / blocking;
        let capped = printed.min(T::of(UNBLOCKING_CAP));
        let unblocking = if self.p.cap_unblocking {
            capped
        } else {
            printed
        };
        (unblocking, blocking)
    }

    /// γ_WU = γ_W |ζ_W| \[1/ms\] (eq. A10).
    #[inline(always)]
    pub(super) fn gamma_wu<T: Number>(&self, zeta_w: T) -> T {
        T::of(self.p.gamma_w_per_ms) * zeta_w.abs()
    }
}

/// (ζ_S + 1) S + ζ_W W.
#[inline(always)]
fn pull<T: Number>(state: &[T; 6]) -> T {
    let [_, _, w, s, zeta_w, zeta_s] = *state;
    (zeta_s + T::of(1.0)) * s + zeta_w * w
}
