//! Pressures of compartments that are linked with each other, at the end of a step.

use super::circuit::{Circulation, NetFlow};
use super::component::{CirculationError, TimeStep};

/// Newton iterations of a step.
const LIMIT: usize = 60;
/// Halvings of a step of Newton's method.
const HALVINGS: usize = 8;

/// Residuals of all compartments, `p − P(inflow)`, and their derivatives.
struct Residuals {
    /// One per compartment \[mmHg\].
    values: Vec<f64>,
    /// Derivatives with respect to the compartments' pressures, row after row.
    jacobian: Vec<f64>,
    /// Derivatives with respect to the cavity pressure.
    by_cavity: Vec<f64>,
    /// Slope of the flow between each compartment and the ventricle \[mL/s/mmHg\].
    slopes: Vec<f64>,
    /// Net flow into the ventricle \[mL/s\].
    net: f64,
}

impl Residuals {
    /// Largest residual, over the stiffness with which it was multiplied.
    fn size(&self) -> f64 {
        let n = self.values.len();
        let rows = self.values.iter().enumerate();
        rows.map(|(i, r)| r.abs() / self.jacobian[i * n + i])
            .fold(0.0, |largest, r| {
                if r > largest || r.is_nan() {
                    r
                } else {
                    largest
                }
            })
    }
}

impl Circulation {
    /// As the solution of one compartment, for all of them at once: their pressures depend on each
    /// other through the links. Flows rise with pressure differences and pressures with inflows, so
    /// that the Jacobian is an M-matrix and the solution unique.
    ///
    /// # Errors
    /// [`CirculationError::NoPressure`] with the compartment that is farthest from its pressure.
    pub(super) fn solve_together(
        &mut self,
        cavity_mmhg: f64,
        step: TimeStep,
    ) -> Result<NetFlow, CirculationError> {
        let n = self.compartments.len();
        for compartment in &mut self.compartments {
            compartment.prepare(step);
        }
        let mut pressures = self.trial_pressures.clone();
        let mut now = self.residuals(&pressures, cavity_mmhg, step);
        for _ in 0..LIMIT {
            if now.values.iter().any(|r| !r.is_finite()) {
                break;
            }
            let mut matrix = now.jacobian.clone();
            let mut right: Vec<[f64; 2]> = (now.values.iter())
                .zip(&now.by_cavity)
                .map(|(r, by_cavity)| [-r, -by_cavity])
                .collect();
            if !solve(&mut matrix, &mut right) {
                break;
            }
            let moved = (right.iter().zip(&pressures))
                .map(|([d, _], p)| d.abs() / (1.0 + p.abs()))
                .fold(0.0, f64::max);
            if moved <= 1e-12 {
                let slope = (right.iter().zip(&now.slopes))
                    .map(|([_, by_cavity], slope)| slope * (by_cavity - 1.0))
                    .sum();
                self.trial_pressures = pressures;
                return Ok(NetFlow {
                    inflow_ml_per_s: now.net,
                    slope_ml_per_s_per_mmhg: slope,
                });
            }
            let size = now.size();
            let mut share = 1.0;
            for halving in 0..=HALVINGS {
                let tried: Vec<f64> = (pressures.iter().zip(&right))
                    .map(|(p, [d, _])| p + share * d)
                    .collect();
                let next = self.residuals(&tried, cavity_mmhg, step);
                // Near round-off a residual need not fall any more.
                if next.size() < size || size < 1e-9 || halving == HALVINGS {
                    (pressures, now) = (tried, next);
                    break;
                }
                share *= 0.5;
            }
        }
        let farthest = (0..n).max_by(|a, b| now.values[*a].abs().total_cmp(&now.values[*b].abs()));
        self.trial_pressures
            .copy_from_slice(&self.now.pressures_mmhg);
        Err(CirculationError::NoPressure {
            compartment: farthest.map_or("none", |idx| self.compartments[idx].name()),
            cavity_mmhg,
            t_ms: step.end_ms,
            dt_ms: step.dt_ms,
        })
    }

    /// Residuals at candidate pressures; keeps the flows as the trial.
    fn residuals(&mut self, pressures_mmhg: &[f64], cavity_mmhg: f64, step: TimeStep) -> Residuals {
        let n = self.compartments.len();
        let mut inflows = vec![0.0; n];
        // Derivatives of the inflows: of each compartment (row) by each pressure (column).
        let mut by_pressure = vec![0.0; n * n];
        let mut slopes = vec![0.0; n];
        let mut net = 0.0;
        let (own, between) = self.trial.split_at_mut(self.connections.len());
        for (c, trial) in self.connections.iter().zip(own) {
            let i = c.compartment_idx;
            let (q, dq) = c.path.flow(c.difference(cavity_mmhg, pressures_mmhg[i]));
            *trial = q;
            inflows[i] += c.signed(q);
            by_pressure[i * n + i] -= dq;
            slopes[i] += dq;
            net -= c.signed(q);
        }
        for (link, trial) in self.links.iter().zip(between) {
            let (from, to) = (link.from_idx, link.to_idx);
            let (q, dq) = link.path.flow(link.difference(pressures_mmhg));
            *trial = q;
            inflows[from] -= q;
            inflows[to] += q;
            by_pressure[from * n + from] -= dq;
            by_pressure[from * n + to] += dq;
            by_pressure[to * n + to] -= dq;
            by_pressure[to * n + from] += dq;
        }
        let mut residuals = Residuals {
            values: vec![0.0; n],
            jacobian: by_pressure,
            by_cavity: vec![0.0; n],
            slopes,
            net,
        };
        for i in 0..n {
            let state = &self.now.states[self.first_state[i]..self.first_state[i + 1]];
            let (wanted, stiffness) = self.compartments[i].pressure(state, inflows[i], step);
            residuals.values[i] = pressures_mmhg[i] - wanted;
            for j in 0..n {
                residuals.jacobian[i * n + j] *= -stiffness;
            }
            residuals.jacobian[i * n + i] += 1.0;
            residuals.by_cavity[i] = -stiffness * residuals.slopes[i];
        }
        residuals
    }
}

/// Solves a small dense system with two right-hand sides by elimination with row pivots; false if it
/// is singular or not finite.
fn solve(matrix: &mut [f64], right: &mut [[f64; 2]]) -> bool {
    let n = right.len();
    for k in 0..n {
        let pivot = (k..n)
            .max_by(|a, b| matrix[a * n + k].abs().total_cmp(&matrix[b * n + k].abs()))
            .unwrap_or(k);
        if !matrix[pivot * n + k].is_finite() || matrix[pivot * n + k] == 0.0 {
            return false;
        }
        if pivot != k {
            right.swap(k, pivot);
            (0..n).for_each(|j| matrix.swap(k * n + j, pivot * n + j));
        }
        for i in k + 1..n {
            let factor = matrix[i * n + k] / matrix[k * n + k];
            if factor == 0.0 {
                continue;
            }
            for j in k..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
            let of_pivot = right[k];
            for (value, of_pivot) in right[i].iter_mut().zip(of_pivot) {
                *value -= factor * of_pivot;
            }
        }
    }
    for i in (0..n).rev() {
        let mut values = right[i];
        for j in i + 1..n {
            let known = right[j];
            for (value, known) in values.iter_mut().zip(known) {
                *value -= matrix[i * n + j] * known;
            }
        }
        right[i] = values.map(|value| value / matrix[i * n + i]);
    }
    right.iter().flatten().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elimination_takes_the_largest_pivot() {
        let mut matrix = vec![0.0, 2.0, 1.0, 1.0, 1.0, 1.0, 4.0, -1.0, 0.5];
        let copy = matrix.clone();
        let mut right = vec![[1.0, 0.0], [2.0, -1.0], [3.0, 5.0]];
        let wanted = right.clone();
        assert!(solve(&mut matrix, &mut right));
        for i in 0..3 {
            for side in 0..2 {
                let found: f64 = (0..3).map(|j| copy[i * 3 + j] * right[j][side]).sum();
                assert!((found - wanted[i][side]).abs() < 1e-12);
            }
        }
        assert!(!solve(&mut [1.0, 1.0, 1.0, 1.0], &mut [[1.0; 2]; 2]));
    }
}
