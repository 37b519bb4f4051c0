//! Krylov solvers over distributed vectors.

use crate::conjugate_gradients::{Directions, Entry, Measure, SymmetricSystem, iterate};
use crate::parallel::VectorLayout;
use crate::{Operator, Preconditioner};

/// Stopping criteria of a Krylov solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KrylovSettings {
    /// Tolerance of the residual, relative to the norm of the right-hand side.
    pub relative_tolerance: f64,
    /// Largest number of iterations.
    pub max_iterations: usize,
    /// Number of vectors that GMRES keeps before it restarts.
    pub restart: usize,
}

impl Default for KrylovSettings {
    fn default() -> Self {
        Self {
            relative_tolerance: 1e-8,
            max_iterations: 2000,
            restart: 60,
        }
    }
}

/// Result of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KrylovReport {
    /// Number of iterations that were made.
    pub iterations: usize,
    /// Norm of the residual, relative to that of the right-hand side.
    pub relative_residual: f64,
    /// Reason why the solver stopped.
    pub ending: KrylovEnding,
}

/// Reasons why a Krylov solver stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KrylovEnding {
    /// The tolerance was met.
    Converged,
    /// A direction has negative or zero curvature: the matrix or its preconditioner is not positive
    /// definite.
    Indefinite,
    /// The limit of iterations was reached, or no further progress was possible.
    Exhausted,
}

fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

fn residual<T: Entry>(
    space: VectorLayout<'_>,
    a: &dyn Operator<T>,
    x: &mut [T],
    b: &[f64],
    r: &mut [T],
) -> f64 {
    a.multiply(space, x, r);
    for (r, b) in r.iter_mut().zip(b).take(space.n_owned()) {
        *r = T::nearest(b - (*r).into());
    }
    space.norm(r)
}

fn report(
    iterations: usize,
    r: f64,
    b: f64,
    settings: &KrylovSettings,
    otherwise: KrylovEnding,
) -> KrylovReport {
    // The recurrences drift slightly from the true residual, which is the one that counts.
    let relative_residual = r / b;
    let met = relative_residual <= 1.5 * settings.relative_tolerance;
    KrylovReport {
        iterations,
        relative_residual,
        ending: if met {
            KrylovEnding::Converged
        } else {
            otherwise
        },
    }
}

/// `A x = b` with a preconditioner, distributed over the nodes of all ranks.
struct OnRanks<'a, T> {
    space: VectorLayout<'a>,
    a: &'a dyn Operator<T>,
    m: &'a dyn Preconditioner<T>,
}

impl<T: Entry> SymmetricSystem for OnRanks<'_, T> {
    type Number = T;

    fn precondition(&self, r: &[T], z: &mut [T]) {
        self.m.apply(self.space, r, z);
    }

    fn multiply(&self, p: &mut [T], q: &mut [T]) {
        self.a.multiply(self.space, p, q);
    }

    fn dot(&self, p: &[T], q: &[T]) -> f64 {
        self.space.dot(p, q)
    }

    fn measure(&self, r: &[T], z: &[T]) -> Measure {
        // One reduction for both products, because one superfluous application of the
        // preconditioner costs less than a second synchronisation of all ranks.
        let [squared_size, rz] = self.space.dots([(r, r), (r, z)]);
        Measure { rz, squared_size }
    }

    fn accepts(&self, curvature: f64, rz: f64) -> bool {
        curvature > 0.0 && rz > 0.0
    }
}

/// Conjugate gradients for a symmetric positive definite `a`, starting from `x`. Vectors of the iteration have the precision of
/// `a` and `m`; scalar products are in double precision. Collective.
pub fn conjugate_gradients<T: Entry>(
    space: VectorLayout<'_>,
    a: &dyn Operator<T>,
    m: &dyn Preconditioner<T>,
    b: &[f64],
    x: &mut [f64],
    settings: &KrylovSettings,
) -> KrylovReport {
    let b_norm = space.norm(b).max(f64::MIN_POSITIVE);
    let mut directions = Directions::new(space.len());
    let mut solution: Vec<T> = x.iter().map(|x| T::nearest(*x)).collect();
    residual(space, a, &mut solution, b, &mut directions.r);
    let goal = settings.relative_tolerance * b_norm;
    let ended = iterate(
        &OnRanks { space, a, m },
        &mut solution,
        &mut directions,
        settings.max_iterations,
        |squared| !(squared.sqrt() > goal),
    );
    // The recurrence drifts from the true residual only by rounding, which matters only for a tight
    // tolerance.
    let r_norm = if settings.relative_tolerance < 1e-6 {
        residual(space, a, &mut solution, b, &mut directions.r)
    } else {
        ended.squared_size.sqrt()
    };
    for (x, found) in x.iter_mut().zip(&solution) {
        *x = (*found).into();
    }
    let otherwise = if ended.is_indefinite {
        KrylovEnding::Indefinite
    } else {
        KrylovEnding::Exhausted
    };
    report(ended.iterations, r_norm, b_norm, settings, otherwise)
}

/// MINRES for a symmetric, possibly indefinite `a` with a positive definite preconditioner,
/// starting from `x`. Collective.
///
/// Source: Paige and Saunders 1975; recurrence of Elman, Silvester and Wathen 2005, algorithm 6.1.
pub fn minres(
    space: VectorLayout<'_>,
    a: &dyn Operator,
    m: &dyn Preconditioner,
    b: &[f64],
    x: &mut [f64],
    settings: &KrylovSettings,
) -> KrylovReport {
    let n = space.len();
    let b_norm = space.norm(b).max(f64::MIN_POSITIVE);
    let mut v_old = vec![0.0; n];
    let mut v = vec![0.0; n];
    let start_norm = residual(space, a, x, b, &mut v);
    let (mut z, mut az) = (vec![0.0; n], vec![0.0; n]);
    let (mut w_old, mut w) = (vec![0.0; n], vec![0.0; n]);
    m.apply(space, &v, &mut z);
    let squared = space.dot(&z, &v);
    if !(squared >= 0.0) {
        return report(0, start_norm, b_norm, settings, KrylovEnding::Indefinite);
    }
    let (mut gamma_old, mut gamma) = (1.0, squared.sqrt());
    let mut eta = gamma;
    let (mut s_old, mut s, mut c_old, mut c) = (0.0, 0.0, 1.0, 1.0);
    let mut iterations = 0;
    // η is the residual in the norm of the preconditioner. The true residual is computed only when
    // η suggests convergence.
    let mut goal = settings.relative_tolerance * eta * b_norm / start_norm.max(f64::MIN_POSITIVE);
    let mut r = vec![0.0; n];
    let mut ending = KrylovEnding::Exhausted;
    while iterations < settings.max_iterations && start_norm > settings.relative_tolerance * b_norm
    {
        z.iter_mut().for_each(|z| *z /= gamma);
        a.multiply(space, &mut z, &mut az);
        let delta = space.dot(&az, &z);
        for k in 0..space.n_owned() {
            let next = az[k] - delta / gamma * v[k] - gamma / gamma_old * v_old[k];
            v_old[k] = v[k];
            v[k] = next;
        }
        let z_here = z.clone();
        m.apply(space, &v, &mut z);
        let squared = space.dot(&z, &v);
        if squared < 0.0 {
            ending = KrylovEnding::Indefinite;
            break;
        }
        let gamma_new = squared.sqrt();
        let a0 = c * delta - c_old * s * gamma;
        let a1 = a0.hypot(gamma_new);
        let a2 = s * delta + c_old * c * gamma;
        let a3 = s_old * gamma;
        (c_old, c, s_old, s) = (c, a0 / a1, s, gamma_new / a1);
        for k in 0..n {
            let next = (z_here[k] - a3 * w_old[k] - a2 * w[k]) / a1;
            w_old[k] = w[k];
            w[k] = next;
        }
        axpy(c * eta, &w, x);
        eta *= -s;
        (gamma_old, gamma) = (gamma, gamma_new);
        iterations += 1;
        if eta.abs() <= goal || gamma == 0.0 {
            let r_norm = residual(space, a, x, b, &mut r);
            if r_norm <= settings.relative_tolerance * b_norm || gamma == 0.0 {
                break;
            }
            goal = eta.abs() * (0.5 * settings.relative_tolerance * b_norm / r_norm).max(0.05);
        }
    }
    let r_norm = residual(space, a, x, b, &mut r);
    report(iterations, r_norm, b_norm, settings, ending)
}

/// Restarted flexible GMRES with modified Gram–Schmidt, starting from `x`, for any regular `a`. It
/// is preconditioned on the right, so that it stops by the true residual. Collective.
pub fn gmres(
    space: VectorLayout<'_>,
    a: &dyn Operator,
    m: &dyn Preconditioner,
    b: &[f64],
    x: &mut [f64],
    settings: &KrylovSettings,
) -> KrylovReport {
    let n = space.len();
    let b_norm = space.norm(b).max(f64::MIN_POSITIVE);
    let goal = settings.relative_tolerance * b_norm;
    let mut iterations = 0;
    let mut r = vec![0.0; n];
    let mut last = f64::INFINITY;
    loop {
        let beta = residual(space, a, x, b, &mut r);
        let stuck = !(beta < 0.999 * last);
        if beta <= goal || iterations >= settings.max_iterations || stuck {
            return report(iterations, beta, b_norm, settings, KrylovEnding::Exhausted);
        }
        last = beta;
        let mut basis = vec![r.iter().map(|r| r / beta).collect::<Vec<f64>>()];
        let mut preconditioned: Vec<Vec<f64>> = vec![];
        let (mut columns, mut rotations): (Vec<Vec<f64>>, Vec<(f64, f64)>) = (vec![], vec![]);
        let mut g = vec![beta];
        while columns.len() < settings.restart && iterations < settings.max_iterations {
            let k = columns.len();
            let mut z = vec![0.0; n];
            m.apply(space, &basis[k], &mut z);
            let mut w = vec![0.0; n];
            a.multiply(space, &mut z, &mut w);
            preconditioned.push(z);
            let mut h = Vec::with_capacity(k + 2);
            for v in &basis {
                let d = space.dot(&w, v);
                axpy(-d, v, &mut w);
                h.push(d);
            }
            let mut next = space.norm(&w);
            for (j, (c, s)) in rotations.iter().enumerate() {
                (h[j], h[j + 1]) = (c * h[j] + s * h[j + 1], -s * h[j] + c * h[j + 1]);
            }
            let radius = h[k].hypot(next);
            let (c, s) = if radius == 0.0 {
                (1.0, 0.0)
            } else {
                (h[k] / radius, next / radius)
            };
            h[k] = radius;
            rotations.push((c, s));
            columns.push(h);
            g.push(-s * g[k]);
            g[k] *= c;
            iterations += 1;
            if g[k + 1].abs() <= goal || next <= 1e-14 * radius {
                break;
            }
            next = 1.0 / next;
            w.iter_mut().for_each(|w| *w *= next);
            basis.push(w);
        }
        let k = columns.len();
        let mut y = vec![0.0; k];
        for i in (0..k).rev() {
            let sum: f64 = (i + 1..k).map(|j| columns[j][i] * y[j]).sum();
            y[i] = (g[i] - sum) / columns[i][i];
        }
        for (y, z) in y.iter().zip(&preconditioned) {
            axpy(*y, z, x);
        }
    }
}
