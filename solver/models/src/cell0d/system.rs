//! The 0D cell as an index-1 differential-algebraic system, with its Jacobian and a linear solver that knows its shape.
//!
//! With z = ζ − A λ as states the stretch's rate drops out, and λ is the root of the force balance (Jung 2022, eq. 16).

use super::passive::{LandPassive, PassiveStress};
use crate::calcium::Calcium;
use crate::contraction::Land2017;
use crate::contraction::land2017::equations::{Terms, pull};
use cardiotwin_vector_math::Number;

/// Number of unknowns: CaTRPN, B, W, S, z_W, z_S, C_V and λ.
pub(crate) const N: usize = 8;
/// Position of the stretch, the algebraic unknown.
pub(crate) const LAMBDA: usize = 7;

/// Values of all unknowns: the states, then the stretch.
pub(crate) type Vector = [f64; N];

/// The cell's equations `M y' = f(t, y)`, M the identity but for a zero in the last place.
#[derive(Debug)]
pub(crate) struct System<'a> {
    pub land: &'a Land2017,
    pub passive: &'a LandPassive,
    pub calcium: &'a dyn Calcium,
    pub lambda0: f64,
}

/// Non-zero entries of the Jacobian that are not constant, named row then column.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Jacobian {
    trpn_trpn: f64,
    trpn_lambda: f64,
    b_trpn: f64,
    b_b: f64,
    b_ws: f64,
    w_w: f64,
    w_zeta: f64,
    s_s: f64,
    s_zeta: f64,
    cv: f64,
    balance: Vector,
}

impl System<'_> {
    /// States of Land 2017 at an unknown vector, order as [`crate::contraction::land2017::STATES`].
    #[inline(always)]
    fn land_state<T: Number>(&self, y: &[T; N]) -> [T; 6] {
        let [trpn, b, w, s, z_w, z_s, _, lambda] = *y;
        let distorted = T::of(self.land.k.a) * lambda;
        [trpn, b, w, s, z_w + distorted, z_s + distorted]
    }

    /// Passive stress at an unknown vector.
    #[inline(always)]
    fn passive_stress<T: Number>(&self, y: &[T; N]) -> PassiveStress<T> {
        let strain = y[LAMBDA] / T::of(self.lambda0) - T::of(1.0);
        self.passive.stress(strain, y[6])
    }

    /// Active stress at an unknown vector \[kPa\].
    #[inline]
    pub fn active_stress_kpa(&self, y: &Vector) -> f64 {
        self.land.k.stress_kpa(&self.land_state(y), y[LAMBDA])
    }

    /// Right-hand side at the time since activation `t`. A negative sensitivity makes it NaN, which the step control turns
    /// into a smaller step or an error.
    #[inline]
    pub fn rhs(&self, t: f64, y: &Vector) -> Vector {
        self.equations(self.calcium.concentration_um(t), y)
    }

    /// Right-hand side at a calcium \[µM\], over any number.
    #[inline(always)]
    pub fn equations<T: Number>(&self, ca_um: T, y: &[T; N]) -> [T; N] {
        let state = self.land_state(y);
        let terms = self.land.k.terms(&state, ca_um, y[LAMBDA]);
        self.rhs_of_terms(&state, &terms, &self.passive_stress(y), y[LAMBDA])
    }

    /// Right-hand side from its terms. The rate of the stretch is zero: z leaves it out of ζ.
    #[inline(always)]
    fn rhs_of_terms<T: Number>(
        &self,
        state: &[T; 6],
        terms: &Terms<T>,
        passive: &PassiveStress<T>,
        lambda: T,
    ) -> [T; N] {
        let [trpn, b, w, s, z_w, z_s] = self.land.k.rates_from(state, terms, T::of(0.0));
        let balance = self.land.k.stress_kpa(state, lambda) + passive.sp_kpa;
        [trpn, b, w, s, z_w, z_s, passive.cv_rate_per_ms, balance]
    }

    /// Right-hand side, its derivative with time (calcium alone depends on it) and its Jacobian.
    pub fn linearise(&self, t: f64, y: &Vector) -> (Vector, f64, Jacobian) {
        let (land, p, k) = (self.land, &self.land.p, &self.land.k);
        let lambda = y[LAMBDA];
        let (ca_um, ca_rate) = self.calcium.value_and_rate(t);
        let state = self.land_state(y);
        let terms = k.terms(&state, ca_um, lambda);
        let slopes = land.term_slopes(&state, &terms, lambda);
        let passive = self.passive_stress(y);
        let rhs = self.rhs_of_terms(&state, &terms, &passive, lambda);

        let [trpn, b, w, s, zeta_w, zeta_s] = state;
        let Terms {
            ca50_um,
            binding,
            unblocking,
            blocking,
            unbound,
            gamma_wu,
            gamma_su,
        } = terms;
        let h = k.overlap(lambda) * k.stress_scale;
        let dh = land.overlap_slope(lambda) * k.stress_scale;
        let pull = pull(&state);
        let dr_dca = p.n_trpn * binding / ca_um;
        let time_rate = p.k_trpn_per_ms * (1.0 - trpn) * dr_dca * ca_rate;
        let jacobian = Jacobian {
            trpn_trpn: -p.k_trpn_per_ms * (binding + 1.0),
            trpn_lambda: -p.k_trpn_per_ms * (1.0 - trpn) * p.n_trpn * binding / ca50_um
                * slopes.ca50_um,
            b_trpn: k.k_b * slopes.unblocking * unbound - p.k_u_per_ms * slopes.blocking * b,
            b_b: -k.k_b * unblocking - p.k_u_per_ms * blocking,
            b_ws: -k.k_b * unblocking,
            w_w: -(p.k_uw_per_ms + k.k_wu + p.k_ws_per_ms + gamma_wu),
            w_zeta: -slopes.gamma_wu * w,
            s_s: -(k.k_su + gamma_su),
            s_zeta: -slopes.gamma_su * s,
            cv: passive.cv_stiffness_per_ms,
            balance: [
                0.0,
                0.0,
                h * zeta_w,
                h * (zeta_s + 1.0),
                h * w,
                h * s,
                -self.passive.a_p_kpa * self.passive.k,
                dh * pull + h * k.a * (w + s) + passive.dsp_dstrain_kpa / self.lambda0,
            ],
        };
        (rhs, time_rate, jacobian)
    }

    /// Factors `M/(hγ) − J`; `None` where it is singular or not finite.
    pub fn factor(&self, j: &Jacobian, shift: f64) -> Option<Factored> {
        let (land, p) = (self.land, &self.land.p);
        let m = [
            [shift - j.b_b, -j.b_ws, -j.b_ws],
            [p.k_uw_per_ms, shift - j.w_w, p.k_uw_per_ms],
            [0.0, -p.k_ws_per_ms, shift - j.s_s],
        ];
        let minor = |r0: usize, r1: usize, c0: usize, c1: usize| {
            m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0]
        };
        let c = [
            [minor(1, 2, 1, 2), -minor(0, 2, 1, 2), minor(0, 1, 1, 2)],
            [-minor(1, 2, 0, 2), minor(0, 2, 0, 2), -minor(0, 1, 0, 2)],
            [minor(1, 2, 0, 1), -minor(0, 2, 0, 1), minor(0, 1, 0, 1)],
        ];
        let scale = 1.0 / (m[0][0] * c[0][0] + m[0][1] * c[1][0] + m[0][2] * c[2][0]);
        let mut factored = Factored {
            bridges: c.map(|row| row.map(|x| x * scale)),
            trpn: 1.0 / (shift - j.trpn_trpn),
            zeta_w: 1.0 / (shift + land.k.c_w),
            zeta_s: 1.0 / (shift + land.k.c_s),
            cv: 1.0 / (shift + j.cv),
            j: *j,
            column: [0.0; N],
            pivot: 1.0,
        };
        // What a unit of stretch does to the seven others, then the balance reduced to the stretch alone.
        let column = [
            j.trpn_lambda,
            0.0,
            j.w_zeta * land.k.a,
            j.s_zeta * land.k.a,
            -land.k.c_w * land.k.a,
            -land.k.c_s * land.k.a,
            j.cv / self.lambda0,
            0.0,
        ];
        factored.column = factored.differential(&column);
        let reduced: f64 = (2..LAMBDA)
            .map(|i| j.balance[i] * factored.column[i])
            .sum::<f64>()
            + j.balance[LAMBDA];
        factored.pivot = -1.0 / reduced;
        (factored.pivot.is_finite() && scale.is_finite()).then_some(factored)
    }
}

/// Factors of one step's matrix: three scalars, a 3 × 3 block and the bordering stretch.
#[derive(Debug)]
pub(crate) struct Factored {
    bridges: [[f64; 3]; 3],
    trpn: f64,
    zeta_w: f64,
    zeta_s: f64,
    cv: f64,
    j: Jacobian,
    column: Vector,
    pivot: f64,
}

impl Factored {
    /// Solves for the seven differential unknowns with the stretch held.
    #[inline]
    fn differential(&self, r: &Vector) -> Vector {
        let trpn = self.trpn * r[0];
        let zeta_w = self.zeta_w * r[4];
        let zeta_s = self.zeta_s * r[5];
        let b = [
            r[1] + self.j.b_trpn * trpn,
            r[2] + self.j.w_zeta * zeta_w,
            r[3] + self.j.s_zeta * zeta_s,
        ];
        let [x, y, z] = self
            .bridges
            .map(|row| row[0] * b[0] + row[1] * b[1] + row[2] * b[2]);
        [trpn, x, y, z, zeta_w, zeta_s, self.cv * r[6], 0.0]
    }

    /// Solves `(M/(hγ) − J) x = r`.
    #[inline]
    pub fn solve(&self, r: &Vector) -> Vector {
        let mut x = self.differential(r);
        let balance = &self.j.balance;
        let mut residual = r[LAMBDA];
        for i in 2..LAMBDA {
            residual += balance[i] * x[i];
        }
        let lambda = residual * self.pivot;
        for (value, column) in x.iter_mut().zip(&self.column) {
            *value += column * lambda;
        }
        x[LAMBDA] = lambda;
        x
    }
}

#[cfg(test)]
mod tests {
    use super::super::passive::LandPassiveParameters;
    use super::*;
    use crate::calcium::{Rice2008, Rice2008Parameters};
    use crate::contraction::Land2017Parameters;
    use cardiotwin_vector_math::Dual;
    use proptest::prelude::*;

    fn with_system<R>(f: impl FnOnce(&System<'_>) -> R) -> R {
        let land = Land2017::new(Land2017Parameters::default()).unwrap();
        let passive = LandPassive::new(&LandPassiveParameters::default());
        let rice = Rice2008::new(Rice2008Parameters::default()).unwrap();
        f(&System {
            land: &land,
            passive: &passive,
            calcium: &rice,
            lambda0: 1.1,
        })
    }

    proptest! {
        /// The solver's matrix is that of the equations: (M/(hγ) − J) x = r with J x from dual numbers.
        #[test]
        fn linear_solve_matches_the_equations(
            t in 5.0..900.0f64, trpn in 0.05..0.9f64, b in 0.1..0.9f64, w in 0.01..0.2f64, s in 0.01..0.2f64,
            zeta_w in 0.05..0.5f64, zeta_s in 0.05..0.5f64, cv in -0.2..-0.05f64, lambda in 0.9..1.08f64, shift in 0.02..20.0f64
        ) {
            with_system(|system| {
                let a = system.land.k.a;
                let y = [trpn, b, w, s, zeta_w - a * lambda, zeta_s - a * lambda, cv, lambda];
                let (rhs, time_rate, jacobian) = system.linearise(t, &y);
                assert_eq!(rhs, system.rhs(t, &y));
                let h = 1e-6;
                let slope = (system.rhs(t + h, &y)[0] - system.rhs(t - h, &y)[0]) / (2.0 * h);
                assert!((slope - time_rate).abs() < 1e-6 * (1.0 + slope.abs()));
                let r = [0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.1, 5.0];
                let x = system.factor(&jacobian, shift).unwrap().solve(&r);
                let along: [Dual; N] = std::array::from_fn(|i| Dual { v: y[i], d: x[i] });
                let ca_um = Dual::of(system.calcium.concentration_um(t));
                let mut product = system.equations(ca_um, &along).map(|rate| -rate.d);
                for row in 0..LAMBDA {
                    product[row] += shift * x[row];
                }
                for row in 0..N {
                    assert!((product[row] - r[row]).abs() < 1e-9 * (1.0 + x.iter().fold(0.0, |m: f64, v| m.max(v.abs()))), "{row}");
                }
            });
        }
    }
}
