//! The equations of Land 2017 (Jung 2022, eqs. A4-A14), written once over any [`Number`].
//!
//! The 0D cell and the lanes of the cell's engine take their right-hand side from here, the organ's step its terms in the
//! numbers of vector code; dual numbers give the slopes that hand-derived ones are tested against.

use super::Land2017Parameters;
use cardiotwin_vector_math::Number;

/// Stretch above which length dependence stops (eq. A13 and every public implementation).
pub const LAMBDA_CAP: f64 = 1.2;
/// Stretch below which filament overlap shortens (eq. A13).
pub const LAMBDA_OVERLAP: f64 = 0.87;
/// Floor of CaTRPN inside powers, far below any resting occupancy: an overshooting trial stage must give a bad step, not a
/// NaN.
pub const LEAST_OCCUPANCY: f64 = 1e-9;
/// Largest unblocking factor where the cap is on.
pub(super) const UNBLOCKING_CAP: f64 = 100.0;

/// Constants of the equations: parameters that enter as they are, and constants derived from parameters (eqs. A8-A12).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equations {
    /// Unbinding rate k_TRPN of calcium from troponin C \[1/ms\].
    pub k_trpn: f64,
    /// Hill exponent n_TRPN of calcium binding.
    pub n_trpn: f64,
    /// Half-saturation Ca50_ref at a stretch of one \[µM\].
    pub ca50_ref: f64,
    /// Slope β1 of Ca50 with the stretch \[µM\].
    pub beta1: f64,
    /// Unblocking rate k_U of binding sites \[1/ms\].
    pub k_u: f64,
    /// Half of the Hill exponent n_Tm of unblocking.
    pub half_n_tm: f64,
    /// Rate k_UW from unbound to weakly bound \[1/ms\].
    pub k_uw: f64,
    /// Rate k_WS from weakly to strongly bound \[1/ms\].
    pub k_ws: f64,
    /// Distortion-dependent unbinding γ_S of strong bridges \[1/ms\].
    pub gamma_s: f64,
    /// Distortion-dependent unbinding γ_W of weak bridges \[1/ms\].
    pub gamma_w: f64,
    /// Slope β0 of the overlap h with the stretch.
    pub beta0: f64,
    /// Rate from weakly bound to unbound, k_WU = k_UW (1/r_W − 1) − k_WS \[1/ms\].
    pub k_wu: f64,
    /// Rate from strongly bound to unbound, k_SU = k_WS r_W (1/r_S − 1) \[1/ms\].
    pub k_su: f64,
    /// Blocking rate, k_B = k_U TRPN50^n_Tm / (1 − r_S − (1 − r_S) r_W) \[1/ms\].
    pub k_b: f64,
    /// Distortion per stretch A = A_W = A_S.
    pub a: f64,
    /// Rate at which the distortion ζ_W decays \[1/ms\].
    pub c_w: f64,
    /// Rate at which the distortion ζ_S decays \[1/ms\].
    pub c_s: f64,
    /// Factor Smax_ref / r_S of the stress \[kPa\].
    pub stress_scale: f64,
    /// Whether CaTRPN^(−n_Tm/2) is capped at 100.
    pub cap_unblocking: bool,
}

/// Terms of the rates that their slopes need as well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms<T> {
    /// Half-saturation Ca50 at the present stretch \[µM\].
    pub ca50_um: T,
    /// Binding factor (Ca/Ca50)^n_TRPN.
    pub binding: T,
    /// Unblocking factor CaTRPN^(−n_Tm/2), capped if asked.
    pub unblocking: T,
    /// Blocking factor CaTRPN^(n_Tm/2).
    pub blocking: T,
    /// Share of unbound sites, U = 1 − B − W − S.
    pub unbound: T,
    /// Additional unbinding γ_WU of distorted weak bridges \[1/ms\].
    pub gamma_wu: T,
    /// Additional unbinding γ_SU of distorted strong bridges \[1/ms\].
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

impl Equations {
    /// Constants of parameters that nobody has checked (misprints as resolved in docs/models.md).
    #[must_use]
    pub fn new(p: &Land2017Parameters) -> Self {
        let unbound = 1.0 - p.r_s - (1.0 - p.r_s) * p.r_w;
        Self {
            k_trpn: p.k_trpn_per_ms,
            n_trpn: p.n_trpn,
            ca50_ref: p.ca50_ref_um,
            beta1: p.beta1_um,
            k_u: p.k_u_per_ms,
            half_n_tm: 0.5 * p.n_tm,
            k_uw: p.k_uw_per_ms,
            k_ws: p.k_ws_per_ms,
            gamma_s: p.gamma_s_per_ms,
            gamma_w: p.gamma_w_per_ms,
            beta0: p.beta0,
            k_wu: p.k_uw_per_ms * (1.0 / p.r_w - 1.0) - p.k_ws_per_ms,
            k_su: p.k_ws_per_ms * p.r_w * (1.0 / p.r_s - 1.0),
            k_b: p.k_u_per_ms * p.trpn50.powf(p.n_tm) / unbound,
            a: p.a_eff * p.r_s / ((1.0 - p.r_s) * p.r_w + p.r_s),
            c_w: p.phi * p.k_uw_per_ms * (1.0 - p.r_w) / p.r_w,
            c_s: p.phi * p.k_ws_per_ms * p.r_w * (1.0 - p.r_s) / p.r_s,
            stress_scale: p.smax_ref_kpa / p.r_s,
            cap_unblocking: p.cap_unblocking,
        }
    }

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
        let [_, b, w, s, _, _] = *state;
        let unbound = T::of(1.0) - b - w - s;
        self.terms_at(state, unbound, ca_um, self.ca50(lambda))
    }

    /// The same for a solver whose unknown is U = 1 − B − W − S, and at a Ca50 \[µM\].
    #[inline(always)]
    pub fn terms_at<T: Number>(
        &self,
        state: &[T; 6],
        unbound: T,
        ca_um: T,
        ca50_um: T,
    ) -> Terms<T> {
        let [trpn, _, _, _, zeta_w, zeta_s] = *state;
        let occupied = [trpn.max(T::of(LEAST_OCCUPANCY)), T::of(1.0)];
        let (ln_ca, ln_occupied) = ca_um.ln_ratios(ca50_um, occupied);
        let (unblocking, blocking) = self.blocking(ln_occupied);
        Terms {
            ca50_um,
            binding: self.binding(ln_ca),
            unblocking,
            blocking,
            unbound,
            gamma_wu: self.gamma_wu(zeta_w),
            gamma_su: gamma_su(T::of(self.gamma_s), zeta_s).0,
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
        let of = T::of;
        let [trpn, b, w, s, zeta_w, zeta_s] = *state;
        let out_of_w = of(self.k_wu + self.k_ws) + terms.gamma_wu;
        let out_of_s = of(self.k_su) + terms.gamma_su;
        let unblocked = of(self.k_b) * terms.unblocking;
        let blocked = of(self.k_u) * terms.blocking * b;
        let pulled = of(self.a) * lambda_rate;
        [
            of(self.k_trpn) * terms.binding.mul_add(of(1.0) - trpn, -trpn),
            unblocked.mul_add(terms.unbound, -blocked),
            of(self.k_uw).mul_add(terms.unbound, -(out_of_w * w)),
            of(self.k_ws).mul_add(w, -(out_of_s * s)),
            of(-self.c_w).mul_add(zeta_w, pulled),
            of(-self.c_s).mul_add(zeta_s, pulled),
        ]
    }

    /// Active stress Sa = h(λ) · (Smax_ref/r_S) · [(ζ_S + 1) S + ζ_W W] \[kPa\] (eq. A14).
    #[inline(always)]
    pub fn stress_kpa<T: Number>(&self, state: &[T; 6], lambda: T) -> T {
        self.overlap(lambda) * T::of(self.stress_scale) * pull(state)
    }

    /// Ca50 = Ca50_ref + β1 (min(λ, 1.2) − 1) \[µM\] (eq. A5).
    #[inline(always)]
    pub fn ca50<T: Number>(&self, lambda: T) -> T {
        let l = lambda.min(T::of(LAMBDA_CAP));
        T::of(self.beta1).mul_add(l - T::of(1.0), T::of(self.ca50_ref))
    }

    /// Overlap h(λ) of the filaments (eq. A13).
    #[inline(always)]
    pub fn overlap<T: Number>(&self, lambda: T) -> T {
        let l = lambda.min(T::of(LAMBDA_CAP));
        overlap(T::of(self.beta0), l, l.min(T::of(LAMBDA_OVERLAP)))
    }

    /// (Ca/Ca50)^n_TRPN (eq. A4) from ln(Ca/Ca50); not a number where Ca50 is not positive.
    #[inline(always)]
    pub fn binding<T: Number>(&self, ln_ca: T) -> T {
        (T::of(self.n_trpn) * ln_ca).exp()
    }

    /// Unblocking and blocking factors CaTRPN^(−n_Tm/2), capped if asked, and CaTRPN^(n_Tm/2) (eq. A6), from ln CaTRPN.
    #[inline(always)]
    pub fn blocking<T: Number>(&self, ln_trpn: T) -> (T, T) {
        let blocking = (T::of(self.half_n_tm) * ln_trpn).exp();
        let printed = T::of(1.0) / blocking;
        let capped = printed.min(T::of(UNBLOCKING_CAP));
        let unblocking = if self.cap_unblocking { capped } else { printed };
        (unblocking, blocking)
    }

    /// γ_WU = γ_W |ζ_W| \[1/ms\] (eq. A10).
    #[inline(always)]
    pub fn gamma_wu<T: Number>(&self, zeta_w: T) -> T {
        T::of(self.gamma_w) * zeta_w.abs()
    }
}

/// (ζ_S + 1) S + ζ_W W.
#[inline(always)]
pub fn pull<T: Number>(state: &[T; 6]) -> T {
    let [_, _, w, s, zeta_w, zeta_s] = *state;
    zeta_w.mul_add(w, (zeta_s + T::of(1.0)) * s)
}
