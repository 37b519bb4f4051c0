//! Quadratic model of L-BFGS-B: its matrix, its Cauchy point within the box, and its minimum over
//! the free variables.

use crate::Interval;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Steps and changes of the gradient that build the matrix, oldest first, and its initial scale.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Memory {
    pairs: Vec<(Vec<f64>, Vec<f64>)>,
    theta: f64,
    max_pairs: usize,
}

impl Memory {
    pub(super) fn new(max_pairs: usize) -> Self {
        Self {
            pairs: Vec::new(),
            theta: 1.0,
            max_pairs,
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    pub(super) fn clear(&mut self) {
        self.pairs.clear();
        self.theta = 1.0;
    }

    /// Adds a step and the change of the gradient along it; `curvature` is their product and
    /// positive.
    pub(super) fn push(&mut self, step: Vec<f64>, change: Vec<f64>, curvature: f64) {
        self.theta = change.iter().map(|y| y * y).sum::<f64>() / curvature;
        if self.pairs.len() == self.max_pairs {
            self.pairs.remove(0);
        }
        self.pairs.push((step, change));
    }

    /// BFGS matrix of the pairs, from theta times the identity: the compact form, multiplied out.
    fn matrix(&self, n: usize) -> DMatrix<f64> {
        let mut b = DMatrix::from_diagonal_element(n, n, self.theta);
        for (s, y) in &self.pairs {
            let (s, y) = (DVector::from_column_slice(s), DVector::from_column_slice(y));
            let bs = &b * &s;
            let (sbs, sy) = (s.dot(&bs), s.dot(&y));
            if sbs > 0.0 && sy > 0.0 {
                b.ger(-1.0 / sbs, &bs, &bs, 1.0);
                b.ger(1.0 / sy, &y, &y, 1.0);
            }
        }
        b
    }
}

/// Minimiser of the model within the box, along the projected gradient and then over the free
/// variables.
///
/// `None` if the model is not positive definite in floating point, so that the memory must be
/// dropped.
pub(super) fn minimiser(
    x: &[f64],
    g: &[f64],
    bounds: &[Interval],
    memory: &Memory,
) -> Option<Vec<f64>> {
    let b = memory.matrix(x.len());
    let cauchy = cauchy_point(x, g, bounds, &b)?;
    if memory.is_empty() {
        return Some(cauchy);
    }
    subspace_minimum(x, g, bounds, &b, cauchy)
}

/// Algorithm CP of the source: the first minimum of the model along the bent path of steepest
/// descent.
fn cauchy_point(x: &[f64], g: &[f64], bounds: &[Interval], b: &DMatrix<f64>) -> Option<Vec<f64>> {
    let n = x.len();
    let gradient = DVector::from_column_slice(g);
    let time_to_bound = |i: usize| match g[i] {
        gi if gi < 0.0 => (x[i] - bounds[i].upper) / gi,
        gi if gi > 0.0 => (x[i] - bounds[i].lower) / gi,
        _ => f64::INFINITY,
    };
    let times: Vec<f64> = (0..n).map(time_to_bound).collect();
    let mut d = DVector::from_fn(n, |i, _| if times[i] > 0.0 { -g[i] } else { 0.0 });
    let mut order: Vec<usize> = (0..n)
        .filter(|i| times[*i] > 0.0 && times[*i].is_finite())
        .collect();
    order.sort_by(|i, j| times[*i].total_cmp(&times[*j]));
    let mut z = DVector::<f64>::zeros(n);
    let mut reached = 0.0;
    let mut breaks = order.into_iter().peekable();
    loop {
        let bd = b * &d;
        let (slope, curvature) = (gradient.dot(&d) + z.dot(&bd), d.dot(&bd));
        if slope >= 0.0 || d.iter().all(|v| *v == 0.0) {
            break;
        }
        if curvature <= 0.0 || !curvature.is_finite() {
            return None;
        }
        let wanted = -slope / curvature;
        let Some(i) = breaks.next_if(|i| times[*i] - reached <= wanted) else {
            z.axpy(wanted, &d, 1.0);
            break;
        };
        z.axpy(times[i] - reached, &d, 1.0);
        reached = times[i];
        z[i] = if d[i] > 0.0 {
            bounds[i].upper - x[i]
        } else {
            bounds[i].lower - x[i]
        };
        d[i] = 0.0;
        // Variables that reach their bounds at the same time are fixed together.
        while let Some(j) = breaks.next_if(|j| times[*j] <= reached) {
            z[j] = if d[j] > 0.0 {
                bounds[j].upper - x[j]
            } else {
                bounds[j].lower - x[j]
            };
            d[j] = 0.0;
        }
    }
    Some((0..n).map(|i| bounds[i].clamp(x[i] + z[i])).collect())
}

/// Minimum of the model over the variables that the Cauchy point leaves free, projected into the
/// box. If the projection is not a direction of descent, the step is cut back to the box instead
/// (Morales and Nocedal 2011).
fn subspace_minimum(
    x: &[f64],
    g: &[f64],
    bounds: &[Interval],
    b: &DMatrix<f64>,
    cauchy: Vec<f64>,
) -> Option<Vec<f64>> {
    let n = x.len();
    let free: Vec<usize> = (0..n)
        .filter(|i| cauchy[*i] > bounds[*i].lower && cauchy[*i] < bounds[*i].upper)
        .collect();
    if free.is_empty() {
        return Some(cauchy);
    }
    let moved = DVector::from_fn(n, |i, _| cauchy[i] - x[i]);
    let residual = DVector::from_column_slice(g) + b * moved;
    let reduced = DMatrix::from_fn(free.len(), free.len(), |i, j| b[(free[i], free[j])]);
    let rhs = DVector::from_fn(free.len(), |i, _| -residual[free[i]]);
    let step = reduced.cholesky()?.solve(&rhs);
    let mut projected = cauchy.clone();
    for (k, i) in free.iter().enumerate() {
        projected[*i] = bounds[*i].clamp(cauchy[*i] + step[k]);
    }
    let slope: f64 = (0..n).map(|i| (projected[i] - x[i]) * g[i]).sum();
    if slope <= 0.0 {
        return Some(projected);
    }
    let room = |k: usize| {
        let i = free[k];
        match step[k] {
            s if s > 0.0 => (bounds[i].upper - cauchy[i]) / s,
            s if s < 0.0 => (bounds[i].lower - cauchy[i]) / s,
            _ => f64::INFINITY,
        }
    };
    let alpha = (0..free.len()).map(room).fold(1.0, f64::min);
    let mut cut = cauchy;
    for (k, i) in free.iter().enumerate() {
        cut[*i] = bounds[*i].clamp(cut[*i] + alpha * step[k]);
    }
    Some(cut)
}
