//! The cell as an index-1 differential-algebraic system, for one lane and without branches.
//!
//! Rates and stresses are those of `cardiotwin_models`, evaluated in the numbers of vector code. The slopes and the
//! elimination of the step's matrix are derived by hand; a test holds them to dual numbers of the same equations.
//!
//! States: CaTRPN, U = 1 − B − W − S (small numbers keep their digits so), W, S, z_W and z_S with ζ = z + A λ (so that the
//! rate of λ drops out), C_V. The stretch λ is the root of Sa + S_p = 0. Only the term min(λ, 0.87) of h makes dλ/dt
//! jump; its side is therefore fixed during a step (`low`), and steps end where λ crosses 0.87. The other kinks
//! (|ζ_W|, γ_SU, η) leave dλ/dt continuous and are left to the error control.

use crate::input::Constants;
use crate::lanes::lanes;
use cardiotwin_models::cell0d::LandPassive;
use cardiotwin_models::cell0d::passive::PassiveStress;
use cardiotwin_models::contraction::land2017::equations::{
    self, Equations, LAMBDA_CAP, LAMBDA_OVERLAP, LEAST_OCCUPANCY, Terms, pull,
};
use cardiotwin_vector_math::{Lane, fma, max, min};

/// Stretch at which the slope of h jumps.
pub const KINK: f64 = LAMBDA_OVERLAP;
/// Floor of Ca50 inside powers: only a step that will be refused comes near it.
const TINY: f64 = 1e-12;

lanes! {
    /// State of one cell; also an increment or a rate of it, whose last entry is then the residual of Sa + S_p = 0.
    State, StateLanes {
        /// Occupancy CaTRPN of troponin C with calcium.
        c,
        /// Share U of sites that are neither blocked nor bound.
        u,
        /// Share W of weakly bound crossbridges.
        w,
        /// Share S of strongly bound crossbridges.
        s,
        /// Distortion of weakly bound crossbridges without its part from the stretch, z_W = ζ_W − A
        /// λ.
        z_w,
        /// Distortion of strongly bound crossbridges without its part from the stretch, z_S = ζ_S −
        /// A λ.
        z_s,
        /// Strain C_V of the passive dashpot.
        v,
        /// Fibre stretch λ.
        l,
    }
}

impl State {
    /// `self + factor · other`.
    #[inline(always)]
    pub fn plus<const FMA: bool>(self, factor: f64, other: &Self) -> Self {
        Self {
            c: fma::<FMA>(factor, other.c, self.c),
            u: fma::<FMA>(factor, other.u, self.u),
            w: fma::<FMA>(factor, other.w, self.w),
            s: fma::<FMA>(factor, other.s, self.s),
            z_w: fma::<FMA>(factor, other.z_w, self.z_w),
            z_s: fma::<FMA>(factor, other.z_s, self.z_s),
            v: fma::<FMA>(factor, other.v, self.v),
            l: fma::<FMA>(factor, other.l, self.l),
        }
    }

    #[inline(always)]
    pub fn add(self, other: &Self) -> Self {
        Self {
            c: self.c + other.c,
            u: self.u + other.u,
            w: self.w + other.w,
            s: self.s + other.s,
            z_w: self.z_w + other.z_w,
            z_s: self.z_s + other.z_s,
            v: self.v + other.v,
            l: self.l + other.l,
        }
    }

    /// Whether every entry is a finite number.
    pub fn is_finite(&self) -> bool {
        [
            self.c, self.u, self.w, self.s, self.z_w, self.z_s, self.v, self.l,
        ]
        .iter()
        .all(|x| x.is_finite())
    }
}

impl Constants {
    /// Constants of Land's active stress.
    #[inline(always)]
    pub fn land(&self) -> Equations {
        Equations {
            k_trpn: self.k_trpn,
            n_trpn: self.n_trpn,
            ca50_ref: self.ca50_ref,
            beta1: self.beta_1,
            k_u: self.k_u,
            half_n_tm: self.half_n_tm,
            k_uw: self.k_uw,
            k_ws: self.k_ws,
            gamma_s: self.gamma_s,
            gamma_w: self.gamma_w,
            beta0: self.beta_0,
            k_wu: self.k_wu,
            k_su: self.k_su,
            k_b: self.k_b,
            a: self.a,
            c_w: self.c_w,
            c_s: self.c_s,
            stress_scale: self.s_scale,
            cap_unblocking: false,
        }
    }

    /// Constants of Land's passive element.
    #[inline(always)]
    pub fn passive(&self) -> LandPassive {
        LandPassive {
            a_p_kpa: self.a_p,
            b: self.b,
            k: self.k,
            rate_l_per_ms: self.rate_l,
            rate_s_per_ms: self.rate_s,
        }
    }

    /// Ca50 at a stretch, above zero also where a step that will be refused comes.
    #[inline(always)]
    pub fn ca50<const FMA: bool>(&self, l: f64) -> f64 {
        max(self.land().ca50(Lane::<FMA>(l)).0, TINY)
    }
}

/// h(λ) on the given side of the kink (`low` 1 or 0).
#[inline(always)]
pub fn overlap<const FMA: bool>(p: &Constants, l: f64, low: f64) -> f64 {
    let cut = min(l, LAMBDA_CAP);
    let second = fma::<FMA>(low, cut - KINK, KINK);
    equations::overlap(Lane::<FMA>(p.beta_0), Lane(cut), Lane(second)).0
}

/// Slope of [`overlap`] with the stretch on the same side of the kink.
#[inline(always)]
fn overlap_slope<const FMA: bool>(p: &Constants, l: f64, low: f64, h: f64) -> f64 {
    let slope = fma::<FMA>(p.beta_0, low, p.beta_0);
    if l < LAMBDA_CAP && h > 0.0 {
        slope
    } else {
        0.0
    }
}

/// States of Land's equations, which have B in the place of U and ζ in the place of z.
#[inline(always)]
fn land_state<const FMA: bool>(p: &Constants, x: &State) -> [Lane<FMA>; 6] {
    [
        Lane(x.c),
        Lane(1.0 - x.u - x.w - x.s),
        Lane(x.w),
        Lane(x.s),
        Lane(fma::<FMA>(p.a, x.l, x.z_w)),
        Lane(fma::<FMA>(p.a, x.l, x.z_s)),
    ]
}

/// The equations' terms at a state.
struct Point<const FMA: bool> {
    /// States of Land's equations.
    state: [Lane<FMA>; 6],
    /// Terms of their rates.
    terms: Terms<Lane<FMA>>,
    /// Stress of the passive element.
    passive: PassiveStress<Lane<FMA>>,
    /// Overlap h(λ).
    h: f64,
}

impl<const FMA: bool> Point<FMA> {
    #[inline(always)]
    fn at(p: &Constants, x: &State, ca: f64, low: f64) -> Self {
        let state = land_state::<FMA>(p, x);
        let ca50 = Lane(p.ca50::<FMA>(x.l));
        let strain = fma::<FMA>(x.l, p.inv_lambda_0, -1.0);
        Self {
            state,
            terms: p.land().terms_at(&state, Lane(x.u), Lane(ca), ca50),
            passive: p.passive().stress(Lane(strain), Lane(x.v)),
            h: overlap::<FMA>(p, x.l, low),
        }
    }

    /// Rates of the seven states and the residual.
    #[inline(always)]
    fn rates(&self, p: &Constants) -> State {
        let rates = p.land().rates_from(&self.state, &self.terms, Lane(0.0));
        let [c, b, w, s, z_w, z_s] = rates.map(|rate| rate.0);
        let stress = self.h * p.s_scale * pull(&self.state).0;
        State {
            c,
            u: -b - w - s,
            w,
            s,
            z_w,
            z_s,
            v: self.passive.cv_rate_per_ms.0,
            l: stress + self.passive.sp_kpa.0,
        }
    }
}

/// Rates of the seven states and the residual, at calcium `ca`.
#[inline(always)]
pub fn rates<const FMA: bool>(p: &Constants, x: &State, ca: f64, low: f64) -> State {
    Point::<FMA>::at(p, x, ca, low).rates(p)
}

/// Active stress Sa of a state \[kPa\], on the given side of the kink.
#[inline(always)]
pub fn active_stress<const FMA: bool>(p: &Constants, x: &State, low: f64) -> f64 {
    overlap::<FMA>(p, x.l, low) * p.s_scale * pull(&land_state::<FMA>(p, x)).0
}

/// Values that a plot needs at one time: stress, stretch and their rates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Slopes {
    /// Active stress at this time \[kPa\].
    pub sa: f64,
    /// Rate of the active stress \[kPa/ms\].
    pub dsa: f64,
    /// Rate of the stretch \[1/ms\].
    pub dl: f64,
}

/// Error that a step across a kink of the rates may make, and that the embedded error estimate does
/// not see.
#[derive(Debug, Clone, Copy)]
pub struct Kinks {
    /// Error of W, where ζ_W changes sign.
    pub w: f64,
    /// Error of S, where ζ_S changes sign.
    pub s: f64,
    /// Error of the stress \[kPa\], where the dashpot changes its side.
    pub stress: f64,
}

/// Share of (jump of the slope) · h · (distance beyond the kink) that counts as error.
const KINK_SHARE: f64 = 0.03;

impl Kinks {
    /// Error of the step from `x` to `y` of length `h`: a rate g·max(0, ξ) whose ξ changes sign
    /// within a step is off by no more than g times the smaller end of ξ.
    #[inline(always)]
    pub fn between<const FMA: bool>(p: &Constants, x: &State, y: &State, h: f64) -> Self {
        let smaller = |a: f64, b: f64| {
            if a * b < 0.0 {
                min(a.abs(), b.abs())
            } else {
                0.0
            }
        };
        let zeta_w = smaller(fma::<FMA>(p.a, x.l, x.z_w), fma::<FMA>(p.a, y.l, y.z_w));
        let zeta_s = smaller(fma::<FMA>(p.a, x.l, x.z_s), fma::<FMA>(p.a, y.l, y.z_s));
        let strain = |x: &State| fma::<FMA>(x.l, p.inv_lambda_0, -1.0) - x.v;
        let serial = smaller(strain(x), strain(y));
        let share = KINK_SHARE * h;
        Self {
            w: 2.0 * share * p.gamma_w * zeta_w * y.w.abs(),
            s: share * p.gamma_s * zeta_s * y.s.abs(),
            stress: share * p.a_p_k * (p.rate_s - p.rate_l).abs() * serial,
        }
    }
}

lanes! {
    /// The system linearised at the start of a step and eliminated: CaTRPN, z_W, z_S and C_V hang on λ alone, then
    /// (U, W, S) is a triangle with one full row, then λ is a scalar.
    Eliminated, EliminatedLanes {
        /// Reciprocal pivot of c.
        i_c,
        /// Reciprocal pivot of zw.
        i_zw,
        /// Reciprocal pivot of zs.
        i_zs,
        /// Reciprocal pivot of v.
        i_v,
        /// Reciprocal pivot of w.
        i_w,
        /// Reciprocal pivot of s.
        i_s,
        /// Reciprocal pivot of u.
        i_u,
        /// Reciprocal pivot of l.
        i_l,
        /// Response to λ of c.
        l_c,
        /// Response to λ of zw.
        l_zw,
        /// Response to λ of zs.
        l_zs,
        /// Response to λ of v.
        l_v,
        /// Response to λ of u.
        l_u,
        /// Response to λ of w.
        l_w,
        /// Response to λ of s.
        l_s,
        /// In the row of U: c.
        u_c,
        /// In the row of W: zw.
        w_zw,
        /// In the row of S: zs.
        s_zs,
        /// In the row of U: w.
        u_w,
        /// In the row of U: s.
        u_s,
        /// In the balance of stresses: w.
        g_w,
        /// In the balance of stresses: s.
        g_s,
        /// In the balance of stresses: zw.
        g_zw,
        /// In the balance of stresses: zs.
        g_zs,
        /// In the balance of stresses: v.
        g_v,
    }
}

/// Start of a step: the rates there, their slopes, and the eliminated matrix for 1/(hγ) = `shift`.
/// Also returned: the explicit time derivative of the rate of CaTRPN, and dS_p/dλ.
#[inline(always)]
pub fn linearise<const FMA: bool>(
    p: &Constants,
    x: &State,
    ca: f64,
    ca_rate: f64,
    low: f64,
    shift: f64,
) -> (Eliminated, State, Slopes, f64, f64) {
    let land = p.land();
    let at = Point::<FMA>::at(p, x, ca, low);
    let f = at.rates(p);
    let [_, Lane(blocked), _, _, Lane(zeta_w), Lane(zeta_s)] = at.state;
    let Terms {
        ca50_um: Lane(ca50),
        binding: Lane(bound),
        unblocking: Lane(unblocking),
        blocking: Lane(blocking),
        gamma_wu: Lane(gamma_wu),
        ..
    } = at.terms;
    let (Lane(gamma_su), Lane(d_gamma_su)) =
        equations::gamma_su(Lane::<FMA>(land.gamma_s), Lane(zeta_s));
    let d_gamma_wu = if zeta_w > 0.0 { p.gamma_w } else { -p.gamma_w };
    let c = max(x.c, LEAST_OCCUPANCY);
    let (open, close) = (p.k_u * blocking, p.k_b * unblocking);
    let (out_w, out_s) = (p.k_wu + gamma_wu, p.k_su + gamma_su);
    let rate_v = at.passive.cv_stiffness_per_ms.0;
    let h_slope = overlap_slope::<FMA>(p, x.l, low, at.h);
    let scale = at.h * p.s_scale;
    let Lane(bridges) = pull(&at.state);
    let stress = scale * bridges;

    let driven = p.k_trpn * (1.0 - x.c) * bound * p.n_trpn;
    let f_t = driven * ca_rate / ca;
    let c_l = if x.l < LAMBDA_CAP {
        -driven * p.beta_1 / ca50
    } else {
        0.0
    };
    let i_c = 1.0 / (shift + p.k_trpn * (bound + 1.0));
    let i_zw = 1.0 / (shift + p.c_w);
    let i_zs = 1.0 / (shift + p.c_s);
    let i_v = 1.0 / (shift + rate_v);
    let i_w = 1.0 / (shift + out_w + p.k_ws);
    let i_s = 1.0 / (shift + out_s);
    let u_c = p.half_n_tm / c * fma::<FMA>(open, blocked, close * x.u);
    let w_zw = d_gamma_wu * x.w;
    let s_zs = d_gamma_su * x.s;
    let u_w = open - out_w;
    let u_s = open - out_s;
    let w_u = p.k_uw * i_w;
    let i_u = 1.0 / (shift + open + close + p.k_uw + w_u * fma::<FMA>(u_s, p.k_ws * i_s, u_w));

    let l_c = c_l * i_c;
    let l_zw = -p.c_w * p.a * i_zw;
    let l_zs = -p.c_s * p.a * i_zs;
    let l_v = rate_v * p.inv_lambda_0 * i_v;
    let y_w = w_zw * (l_zw + p.a);
    let y_s = s_zs * (l_zs + p.a);
    let r_w = -y_w * i_w;
    let r_u = fma::<FMA>(u_c, l_c, y_w + y_s);
    let l_u = (r_u - u_w * r_w - u_s * fma::<FMA>(p.k_ws, r_w, -y_s) * i_s) * i_u;
    let l_w = fma::<FMA>(w_u, l_u, r_w);
    let l_s = fma::<FMA>(p.k_ws, l_w, -y_s) * i_s;

    let g_w = scale * zeta_w;
    let g_s = scale * (zeta_s + 1.0);
    let g_zw = scale * x.w;
    let g_zs = scale * x.s;
    let g_v = -p.a_p_k;
    let active_l = fma::<FMA>(h_slope * p.s_scale, bridges, p.a * (g_zw + g_zs));
    let passive_l = at.passive.dsp_dstrain_kpa.0 * p.inv_lambda_0;
    let g_l = active_l + passive_l;
    let along = fma::<FMA>(
        g_w,
        l_w,
        fma::<FMA>(
            g_s,
            l_s,
            fma::<FMA>(g_zw, l_zw, fma::<FMA>(g_zs, l_zs, g_v * l_v)),
        ),
    );
    let i_l = -1.0 / (g_l + along);

    let active_rate = fma::<FMA>(
        g_w,
        f.w,
        fma::<FMA>(g_s, f.s, fma::<FMA>(g_zw, f.z_w, g_zs * f.z_s)),
    );
    let dl = -fma::<FMA>(g_v, f.v, active_rate) / g_l;
    let slopes = Slopes {
        sa: stress,
        dsa: fma::<FMA>(active_l, dl, active_rate),
        dl,
    };
    let eliminated = Eliminated {
        i_c,
        i_zw,
        i_zs,
        i_v,
        i_w,
        i_s,
        i_u,
        i_l,
        l_c,
        l_zw,
        l_zs,
        l_v,
        l_u,
        l_w,
        l_s,
        u_c,
        w_zw,
        s_zs,
        u_w,
        u_s,
        g_w,
        g_s,
        g_zw,
        g_zs,
        g_v,
    };
    (eliminated, f, slopes, f_t, passive_l)
}

impl Eliminated {
    /// Solves (M/(hγ) − J) k = r.
    #[inline(always)]
    pub fn solve<const FMA: bool>(&self, p: &Constants, r: &State) -> State {
        let c = r.c * self.i_c;
        let z_w = r.z_w * self.i_zw;
        let z_s = r.z_s * self.i_zs;
        let v = r.v * self.i_v;
        let y_w = self.w_zw * z_w;
        let y_s = self.s_zs * z_s;
        let r_w = (r.w - y_w) * self.i_w;
        let r_s = r.s - y_s;
        let r_u = fma::<FMA>(self.u_c, c, r.u) + y_w + y_s;
        let u =
            (r_u - self.u_w * r_w - self.u_s * fma::<FMA>(p.k_ws, r_w, r_s) * self.i_s) * self.i_u;
        let w = fma::<FMA>(p.k_uw * u, self.i_w, r_w);
        let s = fma::<FMA>(p.k_ws, w, r_s) * self.i_s;
        let along = fma::<FMA>(
            self.g_w,
            w,
            fma::<FMA>(
                self.g_s,
                s,
                fma::<FMA>(self.g_zw, z_w, fma::<FMA>(self.g_zs, z_s, self.g_v * v)),
            ),
        );
        let l = (r.l + along) * self.i_l;
        State {
            c: fma::<FMA>(self.l_c, l, c),
            u: fma::<FMA>(self.l_u, l, u),
            w: fma::<FMA>(self.l_w, l, w),
            s: fma::<FMA>(self.l_s, l, s),
            z_w: fma::<FMA>(self.l_zw, l, z_w),
            z_s: fma::<FMA>(self.l_zs, l, z_s),
            v: fma::<FMA>(self.l_v, l, v),
            l,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{CellInput, NegativeKwu};
    use cardiotwin_models::calcium::Rice2008Parameters;
    use cardiotwin_models::cell0d::{CalciumInput, Cell0d, CellParameters, LandPassiveParameters};
    use cardiotwin_models::contraction::Land2017Parameters;
    use cardiotwin_vector_math::{Dual, Number};
    use cardiotwin_vocabulary::cell::CELL;
    use proptest::prelude::*;

    fn entries(x: &State) -> [f64; 8] {
        [x.c, x.u, x.w, x.s, x.z_w, x.z_s, x.v, x.l]
    }

    fn state(e: [f64; 8]) -> State {
        let [c, u, w, s, z_w, z_s, v, l] = e;
        State {
            c,
            u,
            w,
            s,
            z_w,
            z_s,
            v,
            l,
        }
    }

    /// The same unknowns, rates or increments with B in the place of U = `total` − B − W − S and back.
    fn exchanged<T: Number>(x: [T; 8], total: T) -> [T; 8] {
        let [c, u, w, s, z_w, z_s, v, l] = x;
        [c, total - u - w - s, w, s, z_w, z_s, v, l]
    }

    /// The engine's constants and the scalar cell of the same parameters: `place` is the position of each in its interval.
    /// There is neither where Ca50 is not positive at rest.
    fn both(place: [f64; 21], a_p_kpa: f64, lambda_0: f64) -> Option<(Constants, Cell0d)> {
        let mut parameters = crate::input::DEFAULT_PARAMETERS;
        for ((value, place), of) in parameters.iter_mut().zip(place).zip(&CELL) {
            let [low, high] = of.interval.unwrap();
            *value = low + place * (high - low);
        }
        parameters[21] = a_p_kpa;
        let [active @ .., ca_res, ca_max, tau_cr, tau_cd, _] = parameters;
        let cell = CellParameters {
            land: Land2017Parameters {
                allow_negative_k_wu: true,
                ..Land2017Parameters::from_values(active)
            },
            passive: LandPassiveParameters {
                a_p_kpa,
                ..LandPassiveParameters::default()
            },
            calcium: CalciumInput::Rice(Rice2008Parameters::from_values([
                ca_res, ca_max, tau_cr, tau_cd,
            ])),
            cycle_length_ms: 1000.0,
            lambda0: lambda_0,
        };
        let input = CellInput::new(parameters, 1000.0, lambda_0);
        let constants = input.constants(NegativeKwu::Keep).ok()?;
        Some((constants, cell.build().ok()?))
    }

    proptest! {
        /// Rates, their time derivative, the solver's matrix and the slopes, each against the scalar cell's equations over dual
        /// numbers.
        #[test]
        fn rates_and_eliminated_matrix_are_those_of_the_equations(
            place in prop::array::uniform21(0.0..1.0f64), a_p in 1.0..100.0f64, lambda_0 in 0.95..1.15f64,
            c in 0.05..0.95f64, u in 0.01..0.3f64, w in 0.01..0.3f64, s in 0.01..0.3f64,
            zeta_w in prop_oneof![-0.9..-0.1f64, 0.1..0.9f64], zeta_s in prop_oneof![-1.5..-1.1f64, -0.9..-0.1f64, 0.1..0.9f64],
            serial in prop_oneof![-0.05..-0.01f64, 0.01..0.05f64],
            l in prop_oneof![0.75..0.86f64, 0.88..1.15f64, 1.21..1.3f64],
            ca in 0.1..0.9f64, ca_rate in -0.01..0.02f64, l_rate in -0.01..0.01f64,
            shift in 0.05..20.0f64, r in prop::array::uniform8(-1.0..1.0f64), with_fma in any::<bool>(),
        ) {
            let cells = both(place, a_p, lambda_0);
            prop_assume!(cells.is_some());
            let (p, cell) = cells.unwrap();
            let land = p.land();
            // Where Ca50 is not positive the scalar cell has no rates.
            prop_assume!(land.ca50(l) > 0.05);
            let v = l / lambda_0 - 1.0 - serial;
            let x = State { c, u, w, s, z_w: zeta_w - p.a * l, z_s: zeta_s - p.a * l, v, l };
            let low = if l < KINK { 1.0 } else { 0.0 };
            let (matrix, f, slopes, f_t, passive_l) = if with_fma {
                linearise::<true>(&p, &x, ca, ca_rate, low, shift)
            } else {
                linearise::<false>(&p, &x, ca, ca_rate, low, shift)
            };
            let k = if with_fma { matrix.solve::<true>(&p, &state(r)) } else { matrix.solve::<false>(&p, &state(r)) };
            let (k, y) = (entries(&k), exchanged(entries(&x), 1.0));

            // Sizes of the terms that cancel in each row, for rates and for their derivative along `k`.
            let terms = land.terms(&[c, y[1], w, s, zeta_w, zeta_s], ca, l);
            let (open, close) = (land.k_u * terms.blocking, land.k_b * terms.unblocking);
            let stress = land.stress_scale + a_p * (1.0 + (p.b * serial.abs()).exp()) * p.b * p.b;
            let far = k.iter().fold(0.0, |m: f64, e| m.max(e.abs()));
            let binding = land.k_trpn * (1.0 + terms.binding) * (1.0 + land.n_trpn * 4.0 / terms.ca50_um);
            let bridges = 1.0 + land.gamma_w + (open + close) * (1.0 + land.half_n_tm / c);
            let size = [binding, bridges, bridges, bridges, 1.0 + p.a, 1.0 + p.a, 1.0, stress * (1.0 + p.a)];

            let rates = exchanged(cell.equations(ca, &y), 0.0);
            for (i, (got, want)) in entries(&f).into_iter().zip(rates).enumerate() {
                prop_assert!((got - want).abs() <= 1e-12 * size[i], "rate {}: {} for {}", i, got, want);
            }
            let along = |direction: [f64; 8], ca_rate: f64| {
                let direction = exchanged(direction, 0.0);
                let y: [Dual; 8] = std::array::from_fn(|i| Dual { v: y[i], d: direction[i] });
                exchanged(cell.equations(Dual { v: ca, d: ca_rate }, &y), Dual::of(0.0)).map(|rate| rate.d)
            };
            let of_time = along([0.0; 8], ca_rate)[0];
            prop_assert!((f_t - of_time).abs() <= 1e-12 * size[0], "{} {}", f_t, of_time);
            // (M shift − J) k must give back r.
            for (i, along) in along(k, 0.0).into_iter().enumerate() {
                let mass = if i == 7 { 0.0 } else { shift * k[i] };
                let scale = mass.abs() + size[i] * far + 1.0;
                prop_assert!((mass - along - r[i]).abs() <= 1e-12 * scale, "row {}: {} - {} is not {}", i, mass, along, r[i]);
            }
            // The stress, its rates, and the stretch rate that keeps the balance.
            let sa = cell.land().equations().stress_kpa(&[c, y[1], w, s, zeta_w, zeta_s], l);
            prop_assert!((slopes.sa - sa).abs() <= 1e-12 * size[7]);
            let moved = [rates[0], rates[1], rates[2], rates[3], rates[4], rates[5], rates[6], slopes.dl];
            let far = moved.iter().fold(1.0, |m: f64, e| m.max(e.abs()));
            prop_assert!(along(moved, 0.0)[7].abs() <= 1e-12 * size[7] * far, "{:?}", slopes);
            let mut only_l = [0.0; 8];
            only_l[7] = 1.0;
            let active_l = cell.land().equations().stress_kpa(
                &[Dual::of(c), Dual::of(y[1]), Dual::of(w), Dual::of(s), Dual { v: zeta_w, d: p.a }, Dual { v: zeta_s, d: p.a }],
                Dual { v: l, d: 1.0 },
            );
            prop_assert!((passive_l - (along(only_l, 0.0)[7] - active_l.d)).abs() <= 1e-12 * size[7]);
            // Land's distortions at any stretch rate are those of z = ζ − A λ.
            let with_rate = cell.land().equations().rates(&[c, y[1], w, s, zeta_w, zeta_s], ca, l, l_rate);
            prop_assert!((f.z_w + p.a * l_rate - with_rate[4]).abs() <= 1e-12 * size[4]);
            prop_assert!((f.z_s + p.a * l_rate - with_rate[5]).abs() <= 1e-12 * size[5]);
        }
    }
}
