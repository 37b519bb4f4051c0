//! Anderson's acceleration of a fixed-point iteration.

use std::collections::VecDeque;

/// Secants that are kept.
const DEPTH: usize = 5;
/// A secant whose part across the newer ones is smaller than this share of it is left out.
const DEPENDENT: f64 = 1e-6;

/// The last secants of an iteration `x → x + r(x)`: pairs of a change of x and the change of r that came of it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Acceleration {
    last: Option<(Vec<f64>, Vec<f64>)>,
    secants: VecDeque<(Vec<f64>, Vec<f64>)>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(a: &mut [f64], factor: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a -= factor * b);
}

impl Acceleration {
    /// From `x` with residual `r` to the next candidate: `x + r` less the combination of secants that best explains `r`.
    pub fn advance(&mut self, x: &mut [f64], r: &[f64]) {
        if let Some((last_x, last_r)) = &self.last {
            let dx = x.iter().zip(last_x).map(|(a, b)| a - b).collect();
            let dr = r.iter().zip(last_r).map(|(a, b)| a - b).collect();
            self.secants.push_front((dx, dr));
            self.secants.truncate(DEPTH);
        }
        self.last = Some((x.to_vec(), r.to_vec()));
        let mut rest = r.to_vec();
        let mut step = r.to_vec();
        // Gram-Schmidt over the residuals' changes, newest first; what is done to them is done to the pairs.
        let mut basis: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        for (dx, dr) in &self.secants {
            let (mut q, mut move_) = (
                dr.clone(),
                dx.iter().zip(dr).map(|(a, b)| a + b).collect::<Vec<f64>>(),
            );
            let length = dot(&q, &q).sqrt();
            for (other, other_move) in &basis {
                let share = dot(&q, other);
                subtract(&mut q, share, other);
                subtract(&mut move_, share, other_move);
            }
            let across = dot(&q, &q).sqrt();
            if across <= DEPENDENT * length || across == 0.0 {
                continue;
            }
            q.iter_mut().for_each(|v| *v /= across);
            move_.iter_mut().for_each(|v| *v /= across);
            let share = dot(&rest, &q);
            subtract(&mut rest, share, &q);
            subtract(&mut step, share, &move_);
            basis.push((q, move_));
        }
        x.iter_mut().zip(&step).for_each(|(x, step)| *x += step);
    }

    /// Forgets the last point but not the secants: they hold for a neighbouring iteration too, its points do not.
    pub fn begin_elsewhere(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x → M x + c with eigenvalues 0.9 and 0.5.
    fn residual(x: &[f64]) -> Vec<f64> {
        let after = [0.7 * x[0] + 0.2 * x[1] + 1.0, 0.2 * x[0] + 0.7 * x[1] - 2.0];
        vec![after[0] - x[0], after[1] - x[1]]
    }

    #[test]
    fn solves_a_linear_iteration_of_two_in_three_steps() {
        let (mut x, mut acceleration) = (vec![5.0, 5.0], Acceleration::default());
        for _ in 0..3 {
            let r = residual(&x);
            acceleration.advance(&mut x, &r);
        }
        assert!(residual(&x).iter().all(|r| r.abs() < 1e-10), "{x:?}");
    }

    #[test]
    fn secants_carry_over_to_a_neighbour() {
        let (mut x, mut acceleration) = (vec![5.0, 5.0], Acceleration::default());
        for _ in 0..3 {
            let r = residual(&x);
            acceleration.advance(&mut x, &r);
        }
        acceleration.begin_elsewhere();
        let shifted = |x: &[f64]| residual(x).iter().map(|r| r + 0.3).collect::<Vec<f64>>();
        let r = shifted(&x);
        acceleration.advance(&mut x, &r);
        assert!(shifted(&x).iter().all(|r| r.abs() < 1e-10), "{x:?}");
    }
}
