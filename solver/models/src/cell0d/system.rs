//! The 0D cell as an index-1 differential-algebraic system, with its Jacobian and a linear solver that knows its shape.
//!
//! With z = ζ − A λ as states the stretch's rate drops out, and λ is the root of the force balance (Jung 2022, eq. 16).

use super::passive::LandPassiveParameters;
use crate::calcium::Calcium;
use crate::contraction::Land2017;

/// Number of unknowns: CaTRPN, B, W, S, z_W, z_S, C_V and λ.
pub(crate) const N: usize = 8;
/// Position of the stretch, the algebraic unknown.
pub(crate) const LAMBDA: usize = 7;

/// One unknown vector.
pub(crate) type Vector = [f64; N];

/// The cell's equations `M y' = f(t, y)`, M the identity but for a zero in the last place.
#[derive(Debug)]
pub(crate) struct System<'a> {
    pub land: &'a Land2017,
    pub passive: &'a LandPassiveParameters,
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
    /// Active stress at an unknown vector \[kPa\].
    #[inline]
    pub fn active_stress_kpa(&self, y: &Vector) -> f64 {
        let land = self.land;
        let lambda = y[LAMBDA];
        let (zeta_w, zeta_s) = (y[4] + land.a * lambda, y[5] + land.a * lambda);
        land.overlap(lambda).0 * land.stress_scale * ((zeta_s + 1.0) * y[3] + zeta_w * y[2])
    }

    /// Right-hand side at the time since activation `t`.
    #[inline]
    pub fn rhs(&self, t: f64, y: &Vector) -> Vector {
        self.rhs_with(self.calcium.concentration_um(t), y)
    }

    #[inline]
    fn rhs_with(&self, ca_um: f64, y: &Vector) -> Vector {
        let (land, p) = (self.land, &self.land.p);
        let [trpn, b, w, s, z_w, z_s, cv, lambda] = *y;
        let (ca50, _) = land.ca50(lambda);
        // A negative sensitivity makes this NaN, which the step control turns into a smaller step or an error.
        let r = (p.n_trpn * (ca_um / ca50).ln()).exp();
        let (down, _, up, _) = land.blocking(trpn);
        let unbound = 1.0 - b - w - s;
        let (zeta_w, zeta_s) = (z_w + land.a * lambda, z_s + land.a * lambda);
        let passive = self.passive.stress(lambda / self.lambda0 - 1.0, cv);
        let pull = (zeta_s + 1.0) * s + zeta_w * w;
        [
            p.k_trpn_per_ms * (r * (1.0 - trpn) - trpn),
            land.k_b * down * unbound - p.k_u_per_ms * up * b,
            p.k_uw_per_ms * unbound - (land.k_wu + p.k_ws_per_ms + land.gamma_wu(zeta_w).0) * w,
            p.k_ws_per_ms * w - (land.k_su + land.gamma_su(zeta_s).0) * s,
            -land.c_w * zeta_w,
            -land.c_s * zeta_s,
            passive.cv_rate_per_ms,
            land.overlap(lambda).0 * land.stress_scale * pull + passive.sp_kpa,
        ]
    }

    /// Right-hand side, its derivative with time (calcium alone depends on it) and its Jacobian.
    pub fn linearise(&self, t: f64, y: &Vector) -> (Vector, f64, Jacobian) {
        let (land, p) = (self.land, &self.land.p);
        let [trpn, b, w, s, z_w, z_s, cv, lambda] = *y;
        let (ca_um, ca_rate) = self.calcium.value_and_rate(t);
        let (ca50, dca50) = land.ca50(lambda);
        let r = (p.n_trpn * (ca_um / ca50).ln()).exp();
        let (down, ddown, up, dup) = land.blocking(trpn);
        let unbound = 1.0 - b - w - s;
        let (zeta_w, zeta_s) = (z_w + land.a * lambda, z_s + land.a * lambda);
        let (gamma_wu, dgamma_wu) = land.gamma_wu(zeta_w);
        let (gamma_su, dgamma_su) = land.gamma_su(zeta_s);
        let (h, dh) = land.overlap(lambda);
        let (h, dh) = (h * land.stress_scale, dh * land.stress_scale);
        let passive = self.passive.stress(lambda / self.lambda0 - 1.0, cv);
        let pull = (zeta_s + 1.0) * s + zeta_w * w;
        let rhs = [
            p.k_trpn_per_ms * (r * (1.0 - trpn) - trpn),
            land.k_b * down * unbound - p.k_u_per_ms * up * b,
            p.k_uw_per_ms * unbound - (land.k_wu + p.k_ws_per_ms + gamma_wu) * w,
            p.k_ws_per_ms * w - (land.k_su + gamma_su) * s,
            -land.c_w * zeta_w,
            -land.c_s * zeta_s,
            passive.cv_rate_per_ms,
            h * pull + passive.sp_kpa,
        ];
        let dr_dca = p.n_trpn * r / ca_um;
        let time_rate = p.k_trpn_per_ms * (1.0 - trpn) * dr_dca * ca_rate;
        let jacobian = Jacobian {
            trpn_trpn: -p.k_trpn_per_ms * (r + 1.0),
            trpn_lambda: -p.k_trpn_per_ms * (1.0 - trpn) * p.n_trpn * r / ca50 * dca50,
            b_trpn: land.k_b * ddown * unbound - p.k_u_per_ms * dup * b,
            b_b: -land.k_b * down - p.k_u_per_ms * up,
            b_ws: -land.k_b * down,
            w_w: -(p.k_uw_per_ms + land.k_wu + p.k_ws_per_ms + gamma_wu),
            w_zeta: -dgamma_wu * w,
            s_s: -(land.k_su + gamma_su),
            s_zeta: -dgamma_su * s,
            cv: passive.cv_stiffness_per_ms,
            balance: [
                0.0,
                0.0,
                h * zeta_w,
                h * (zeta_s + 1.0),
                h * w,
                h * s,
                -self.passive.a_p_kpa * self.passive.k,
                dh * pull + h * land.a * (w + s) + passive.dsp_dstrain_kpa / self.lambda0,
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
            zeta_w: 1.0 / (shift + land.c_w),
            zeta_s: 1.0 / (shift + land.c_s),
            cv: 1.0 / (shift + j.cv),
            j: *j,
            column: [0.0; N],
            pivot: 1.0,
        };
        // What a unit of stretch does to the seven others, then the balance reduced to the stretch alone.
        let column = [
            j.trpn_lambda,
            0.0,
            j.w_zeta * land.a,
            j.s_zeta * land.a,
            -land.c_w * land.a,
            -land.c_s * land.a,
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
    use super::*;
    use crate::calcium::{Rice2008, Rice2008Parameters};
    use crate::contraction::Land2017Parameters;
    use proptest::prelude::*;

    fn with_system<R>(f: impl FnOnce(&System<'_>) -> R) -> R {
        let land = Land2017::new(Land2017Parameters::default()).unwrap();
        let passive = LandPassiveParameters::default();
        let rice = Rice2008::new(Rice2008Parameters::default()).unwrap();
        f(&System {
            land: &land,
            passive: &passive,
            calcium: &rice,
            lambda0: 1.1,
        })
    }

    proptest! {
        /// The solver's matrix is that of the equations: (M/(hγ) − J) x = r checked with J from central differences.
        #[test]
        fn linear_solve_matches_the_equations(
            t in 5.0..900.0f64, trpn in 0.05..0.9f64, b in 0.1..0.9f64, w in 0.01..0.2f64, s in 0.01..0.2f64,
            zeta_w in 0.05..0.5f64, zeta_s in 0.05..0.5f64, cv in -0.2..-0.05f64, lambda in 0.9..1.08f64, shift in 0.02..20.0f64
        ) {
            with_system(|system| {
                let a = system.land.a;
                let y = [trpn, b, w, s, zeta_w - a * lambda, zeta_s - a * lambda, cv, lambda];
                let (rhs, time_rate, jacobian) = system.linearise(t, &y);
                assert_eq!(rhs, system.rhs(t, &y));
                let h = 1e-6;
                let slope = (system.rhs(t + h, &y)[0] - system.rhs(t - h, &y)[0]) / (2.0 * h);
                assert!((slope - time_rate).abs() < 1e-6 * (1.0 + slope.abs()));
                let r = [0.3, -0.2, 0.1, 0.4, -0.3, 0.2, 0.1, 5.0];
                let x = system.factor(&jacobian, shift).unwrap().solve(&r);
                let mut product = [0.0; N];
                for column in 0..N {
                    let (mut up, mut down) = (y, y);
                    up[column] += h;
                    down[column] -= h;
                    let (up, down) = (system.rhs(t, &up), system.rhs(t, &down));
                    for row in 0..N {
                        product[row] -= (up[row] - down[row]) / (2.0 * h) * x[column];
                    }
                }
                for row in 0..LAMBDA {
                    product[row] += shift * x[row];
                }
                for row in 0..N {
                    assert!((product[row] - r[row]).abs() < 1e-5 * (1.0 + x.iter().fold(0.0, |m: f64, v| m.max(v.abs()))), "{row}");
                }
            });
        }
    }
}
