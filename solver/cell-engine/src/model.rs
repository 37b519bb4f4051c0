//! The cell as an index-1 differential-algebraic system, for one lane and without branches.
//!
//! States: CaTRPN, U = 1 − B − W − S (small numbers keep their digits so), W, S, z_W and z_S with ζ = z + A λ (so that the
//! rate of λ drops out), C_V. The stretch λ is the root of Sa + S_p = 0. Only the term min(λ, 0.87) of h makes dλ/dt
//! jump; its side is therefore fixed during a step (`low`), and steps end where λ crosses 0.87. The other kinks
//! (|ζ_W|, γ_SU, η) leave dλ/dt continuous and are left to the error control.

use crate::input::Constants;
use crate::lanes::lanes;
use cardiotwin_vector_math::{exp, fma, ln_ratios, max, min};

/// Stretch at which the slope of h jumps.
pub const KINK: f64 = 0.87;
/// Stretch above which neither h nor Ca50 changes.
const LONGEST: f64 = 1.2;
/// Floor of CaTRPN and of Ca50 inside powers: only a step that will be refused comes near it.
const TINY: f64 = 1e-12;

lanes! {
    /// State of one cell; also an increment or a rate of it, whose last entry is then the residual of Sa + S_p = 0.
    State, StateLanes {
        /// CaTRPN.
        c,
        /// U, neither blocked nor bound.
        u,
        /// W.
        w,
        /// S.
        s,
        /// z_W = ζ_W − A λ.
        z_w,
        /// z_S = ζ_S − A λ.
        z_s,
        /// C_V.
        v,
        /// λ.
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

    /// `self + other`.
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

/// h(λ) and its slope, on the given side of the kink (`low` 1 or 0).
#[inline(always)]
pub fn overlap<const FMA: bool>(p: &Constants, l: f64, low: f64) -> (f64, f64) {
    let cut = min(l, LONGEST);
    let second = fma::<FMA>(low, cut - KINK, KINK);
    let h = fma::<FMA>(p.beta_0, cut + second - 1.87, 1.0);
    let slope = if l < LONGEST {
        fma::<FMA>(p.beta_0, low, p.beta_0)
    } else {
        0.0
    };
    if h > 0.0 { (h, slope) } else { (0.0, 0.0) }
}

/// γ_SU and its derivative with respect to ζ_S.
#[inline(always)]
fn gamma_su(gamma_s: f64, zeta: f64) -> (f64, f64) {
    let slope = if zeta > 0.0 { gamma_s } else { 0.0 };
    let slope = if zeta < -1.0 { -gamma_s } else { slope };
    let excess = if zeta < -1.0 { zeta + 1.0 } else { zeta };
    (slope * excess, slope)
}

/// Ca50 at a stretch.
#[inline(always)]
fn ca50<const FMA: bool>(p: &Constants, l: f64) -> f64 {
    max(fma::<FMA>(p.beta_1, min(l, LONGEST), p.ca50_0), TINY)
}

/// Rates of the seven states and the residual, at calcium `ca`.
#[inline(always)]
pub fn rates<const FMA: bool>(p: &Constants, x: &State, ca: f64, low: f64) -> State {
    let (ln_ca, ln_c) = ln_ratios::<FMA>(ca, ca50::<FMA>(p, x.l), max(x.c, TINY), 1.0);
    let bound = exp::<FMA>(p.n_trpn * ln_ca);
    let power = exp::<FMA>(p.half_n_tm * ln_c);
    let zeta_w = fma::<FMA>(p.a, x.l, x.z_w);
    let zeta_s = fma::<FMA>(p.a, x.l, x.z_s);
    let gamma_wu = p.gamma_w * zeta_w.abs();
    let gamma_su = gamma_su(p.gamma_s, zeta_s).0;
    let strain = fma::<FMA>(x.l, p.inv_lambda_0, -1.0);
    let serial = strain - x.v;
    let rate_v = if serial > 0.0 { p.rate_l } else { p.rate_s };
    let h = overlap::<FMA>(p, x.l, low).0;
    let blocked = 1.0 - x.u - x.w - x.s;
    let from_w = (p.k_wu + gamma_wu) * x.w;
    let from_s = (p.k_su + gamma_su) * x.s;
    let to_w = p.k_uw * x.u;
    let to_s = p.k_ws * x.w;
    let unblocking = p.k_u * power * blocked - p.k_b / power * x.u;
    let stress = h * p.s_scale * fma::<FMA>(zeta_w, x.w, fma::<FMA>(zeta_s, x.s, x.s));
    State {
        c: p.k_trpn * fma::<FMA>(bound, 1.0 - x.c, -x.c),
        u: unblocking - to_w + from_w + from_s,
        w: to_w - from_w - to_s,
        s: to_s - from_s,
        z_w: -p.c_w * zeta_w,
        z_s: -p.c_s * zeta_s,
        v: rate_v * serial,
        l: stress + fma::<FMA>(p.a_p, exp::<FMA>(p.b * strain) - 1.0, p.a_p_k * serial),
    }
}

/// Active stress \[kPa\].
#[inline(always)]
pub fn active_stress<const FMA: bool>(p: &Constants, x: &State, low: f64) -> f64 {
    let zeta_w = fma::<FMA>(p.a, x.l, x.z_w);
    let zeta_s = fma::<FMA>(p.a, x.l, x.z_s);
    overlap::<FMA>(p, x.l, low).0
        * p.s_scale
        * fma::<FMA>(zeta_w, x.w, fma::<FMA>(zeta_s, x.s, x.s))
}

/// What a plot needs at one time: stress, stretch and their rates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Slopes {
    /// Active stress \[kPa\].
    pub sa: f64,
    /// Its rate \[kPa/ms\].
    pub dsa: f64,
    /// Rate of the stretch \[1/ms\].
    pub dl: f64,
}

/// What a step that runs across a kink of the rates may lose by it, which the embedded error estimate does not see.
#[derive(Debug, Clone, Copy)]
pub struct Kinks {
    /// On W, where ζ_W changes sign.
    pub w: f64,
    /// On S, where ζ_S changes sign.
    pub s: f64,
    /// On the stress \[kPa\], where the dashpot changes its side.
    pub stress: f64,
}

/// Share of (jump of the slope) · h · (distance beyond the kink) that counts as error.
const KINK_SHARE: f64 = 0.03;

impl Kinks {
    /// Of the step from `x` to `y` of length `h`: a rate g·max(0, ξ) whose ξ changes sign within a step is off by no more
    /// than g times the smaller end of ξ.
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
    let ca50 = ca50::<FMA>(p, x.l);
    let c = max(x.c, TINY);
    let (ln_ca, ln_c) = ln_ratios::<FMA>(ca, ca50, c, 1.0);
    let bound = exp::<FMA>(p.n_trpn * ln_ca);
    let power = exp::<FMA>(p.half_n_tm * ln_c);
    let zeta_w = fma::<FMA>(p.a, x.l, x.z_w);
    let zeta_s = fma::<FMA>(p.a, x.l, x.z_s);
    let gamma_wu = p.gamma_w * zeta_w.abs();
    let d_gamma_wu = if zeta_w > 0.0 { p.gamma_w } else { -p.gamma_w };
    let (gamma_su, d_gamma_su) = gamma_su(p.gamma_s, zeta_s);
    let strain = fma::<FMA>(x.l, p.inv_lambda_0, -1.0);
    let serial = strain - x.v;
    let rate_v = if serial > 0.0 { p.rate_l } else { p.rate_s };
    let (h, h_slope) = overlap::<FMA>(p, x.l, low);
    let blocked = 1.0 - x.u - x.w - x.s;
    let out_w = p.k_wu + gamma_wu;
    let out_s = p.k_su + gamma_su;
    let (from_w, from_s, to_w, to_s) = (out_w * x.w, out_s * x.s, p.k_uw * x.u, p.k_ws * x.w);
    let (open, close) = (p.k_u * power, p.k_b / power);
    let stretched = exp::<FMA>(p.b * strain);
    let scale = h * p.s_scale;
    let bridges = fma::<FMA>(zeta_w, x.w, fma::<FMA>(zeta_s, x.s, x.s));
    let stress = scale * bridges;
    let passive = fma::<FMA>(p.a_p, stretched - 1.0, p.a_p_k * serial);
    let f = State {
        c: p.k_trpn * fma::<FMA>(bound, 1.0 - x.c, -x.c),
        u: open * blocked - close * x.u - to_w + from_w + from_s,
        w: to_w - from_w - to_s,
        s: to_s - from_s,
        z_w: -p.c_w * zeta_w,
        z_s: -p.c_s * zeta_s,
        v: rate_v * serial,
        l: stress + passive,
    };

    let driven = p.k_trpn * (1.0 - x.c) * bound * p.n_trpn;
    let f_t = driven * ca_rate / ca;
    let c_l = if x.l < LONGEST {
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
    let passive_l = fma::<FMA>(p.a_p * p.b, stretched, p.a_p_k) * p.inv_lambda_0;
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
    use crate::input::{CellInput, DEFAULT_PARAMETERS, NegativeKwu};
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

    proptest! {
        #[test]
        fn the_eliminated_matrix_is_that_of_the_rates(
            c in 0.05..0.95f64, u in 0.01..0.3f64, w in 0.01..0.3f64, s in 0.01..0.3f64,
            zeta_w in prop_oneof![-0.9..-0.1f64, 0.1..0.9f64], zeta_s in prop_oneof![-1.5..-1.1f64, -0.9..-0.1f64, 0.1..0.9f64],
            serial in prop_oneof![-0.05..-0.01f64, 0.01..0.05f64], l in prop_oneof![0.75..0.86f64, 0.88..1.15f64],
            ca in 0.1..0.9f64, shift in 0.05..20.0f64, r in prop::array::uniform8(-1.0..1.0f64),
        ) {
            let mut parameters = DEFAULT_PARAMETERS;
            parameters[21] = 42.0;
            let p = CellInput::new(parameters, 1000.0, 1.0).constants(NegativeKwu::Refuse).unwrap();
            let v = l * p.inv_lambda_0 - 1.0 - serial;
            let x = State { c, u, w, s, z_w: zeta_w - p.a * l, z_s: zeta_s - p.a * l, v, l };
            let low = if l < KINK { 1.0 } else { 0.0 };
            let (matrix, f, slopes, _, passive_l) = linearise::<true>(&p, &x, ca, 0.0, low, shift);
            for (a, b) in entries(&f).into_iter().zip(entries(&rates::<true>(&p, &x, ca, low))) {
                prop_assert!((a - b).abs() <= 1e-12 * (1.0 + b.abs()));
            }
            prop_assert!((slopes.sa - active_stress::<true>(&p, &x, low)).abs() <= 1e-12 * (1.0 + slopes.sa.abs()));
            // (M shift − J) k must give back r, with J k by a central difference along k.
            let k = matrix.solve::<true>(&p, &state(r));
            let size = entries(&k).iter().fold(1e-3, |m: f64, e| m.max(e.abs()));
            let eps = 1e-6 / size;
            let (up, down) = (x.plus::<true>(eps, &k), x.plus::<true>(-eps, &k));
            let (up, down) = (rates::<true>(&p, &up, ca, low), rates::<true>(&p, &down, ca, low));
            for (i, ((a, b), (k, r))) in
                entries(&up).into_iter().zip(entries(&down)).zip(entries(&k).into_iter().zip(r)).enumerate()
            {
                let along = (a - b) / (2.0 * eps);
                let mass = if i == 7 { 0.0 } else { shift * k };
                let scale = mass.abs() + along.abs() + 1.0;
                // Stresses of up to some 100 kPa cancel in the last row, and a difference over a short way keeps their round-off.
                let round_off = if i == 7 { 1e4 * f64::EPSILON / eps } else { 0.0 };
                prop_assert!((mass - along - r).abs() <= 1e-5 * scale + round_off, "row {}: {} - {} is not {}", i, mass, along, r);
            }
            // Passive stiffness, and the stretch rate that keeps the balance.
            let passive = |l: f64| p.a_p * ((p.b * (l - 1.0)).exp() - 1.0) + p.a_p_k * (l - 1.0 - v);
            let slope = (passive(l + 1e-6) - passive(l - 1e-6)) / 2e-6;
            prop_assert!((passive_l / slope - 1.0).abs() < 1e-6);
            let moved = State { l: slopes.dl, ..f };
            let balance = |e: f64| rates::<true>(&p, &x.plus::<true>(e, &moved), ca, low).l;
            prop_assert!((balance(1e-7) - balance(-1e-7)).abs() / 2e-7 <= 1e-5 * (1.0 + slopes.dsa.abs() + slope * slopes.dl.abs()));
        }
    }
}
