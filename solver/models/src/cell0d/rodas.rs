//! RODAS: a stiffly accurate, L-stable Rosenbrock method of order 4(3) with dense output of order 3 for the 0D cell.
//!
//! The coefficients and the form of the stages are those of [`super::tableau`].

use super::system::{LAMBDA, N, System, Vector};
use super::tableau::{A2, A3, A4, A5, C2, C3, C4, C5, C6, D, GAMMA, H2, H3, TIMES};

/// A tried step: the new unknowns, the error estimate and what the dense output needs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub t_ms: f64,
    pub h_ms: f64,
    start: Vector,
    pub end: Vector,
    pub error: Vector,
    dense2: Vector,
    dense3: Vector,
}

/// Everything of a step that depends on its start alone, kept when the step is tried again with another length.
#[derive(Debug)]
pub(crate) struct Linearised {
    rhs: Vector,
    time_rate: f64,
    jacobian: super::system::Jacobian,
}

/// `base + Σ weights · stages`.
#[inline]
fn combine<const K: usize>(base: &Vector, weights: &[f64; K], stages: &[Vector; 6]) -> Vector {
    let mut out = *base;
    for (weight, stage) in weights.iter().zip(stages) {
        for (value, u) in out.iter_mut().zip(stage) {
            *value += weight * u;
        }
    }
    out
}

/// Evaluates equations and Jacobian at the start of a step.
pub(crate) fn linearise(system: &System<'_>, t_ms: f64, y: &Vector) -> Linearised {
    let (rhs, time_rate, jacobian) = system.linearise(t_ms, y);
    Linearised {
        rhs,
        time_rate,
        jacobian,
    }
}

/// Tries one step of length `h_ms`; `None` where the step's matrix is singular.
pub(crate) fn try_step(
    system: &System<'_>,
    at: &Linearised,
    t_ms: f64,
    y: &Vector,
    h_ms: f64,
) -> Option<Step> {
    let factored = system.factor(&at.jacobian, 1.0 / (GAMMA * h_ms))?;
    let inverse_h = 1.0 / h_ms;
    // Right-hand side of a stage: the equations, the mass matrix times earlier stages (not for the balance), and f_t.
    let stage = |mut r: Vector, coupling: &Vector, d: f64| {
        for i in 0..LAMBDA {
            r[i] += inverse_h * coupling[i];
        }
        r[0] += d * h_ms * at.time_rate;
        factored.solve(&r)
    };
    let zero = [0.0; N];
    let mut u = [zero; 6];
    u[0] = stage(at.rhs, &zero, D[0]);
    u[1] = stage(
        system.rhs(t_ms + TIMES[1] * h_ms, &combine(y, &A2, &u)),
        &combine(&zero, &C2, &u),
        D[1],
    );
    u[2] = stage(
        system.rhs(t_ms + TIMES[2] * h_ms, &combine(y, &A3, &u)),
        &combine(&zero, &C3, &u),
        D[2],
    );
    u[3] = stage(
        system.rhs(t_ms + TIMES[3] * h_ms, &combine(y, &A4, &u)),
        &combine(&zero, &C4, &u),
        D[3],
    );
    let fifth = combine(y, &A5, &u);
    u[4] = stage(
        system.rhs(t_ms + h_ms, &fifth),
        &combine(&zero, &C5, &u),
        0.0,
    );
    let sixth: Vector = std::array::from_fn(|i| fifth[i] + u[4][i]);
    u[5] = stage(
        system.rhs(t_ms + h_ms, &sixth),
        &combine(&zero, &C6, &u),
        0.0,
    );
    Some(Step {
        t_ms,
        h_ms,
        start: *y,
        end: std::array::from_fn(|i| sixth[i] + u[5][i]),
        error: u[5],
        dense2: combine(&zero, &H2, &u),
        dense3: combine(&zero, &H3, &u),
    })
}

impl Step {
    /// Unknowns at a time inside the step.
    #[inline]
    pub fn at(&self, t_ms: f64) -> Vector {
        let s = (t_ms - self.t_ms) / self.h_ms;
        let s1 = 1.0 - s;
        std::array::from_fn(|i| {
            self.start[i] * s1 + s * (self.end[i] + s1 * (self.dense2[i] + s * self.dense3[i]))
        })
    }
}
