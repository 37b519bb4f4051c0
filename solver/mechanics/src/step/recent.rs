//! Corrections of recent steps, from which the next step's correction is predicted.
//!
//! A step corrects its prediction by what the constant acceleration leaves out. That changes slowly from step to step, so that a
//! combination of recent corrections removes most of the residual before anything is solved.
//!
//! Source: Fischer 1998, Comput Methods Appl Mech Eng 163:193, with the changes of the residual themselves in place of
//! products with the matrix, as in Anderson's mixing.

use std::collections::VecDeque;

use cardiotwin_linalg::parallel::VectorLayout;
use nalgebra::{DMatrix, DVector};

/// Regularisation of the normalised least squares, above the rounding of single precision.
const RIDGE: f64 = 1e-8;
/// Largest share of the residual that a useful combination leaves.
const USEFUL: f64 = 0.9;

/// A correction of the displacement, and the change of the residual that it brought, in single precision.
#[derive(Debug, Clone, PartialEq)]
struct Pair {
    correction: Vec<f32>,
    reduction: Vec<f32>,
}

/// Corrections of the last steps, oldest first.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Recent(VecDeque<Pair>);

/// A combination of recent corrections.
#[derive(Debug)]
pub(super) struct Guess {
    /// Correction of the displacement \[mm\].
    pub correction: Vec<f64>,
    /// Norm of the residual that it leaves, if the forces are as linear as they were.
    pub left: f64,
}

impl Recent {
    /// Adds a correction from which the residual fell from `before` to `after`, and drops all but the last `most`.
    pub fn keep(&mut self, correction: &[f64], before: &[f64], after: &[f64], most: usize) {
        let single = |x: &f64| *x as f32;
        let reduction = before.iter().zip(after).map(|(b, a)| (b - a) as f32);
        self.0.push_back(Pair {
            correction: correction.iter().map(single).collect(),
            reduction: reduction.collect(),
        });
        while self.0.len() > most {
            self.0.pop_front();
        }
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// All vectors in the order in which [`Self::restore`] takes them.
    pub fn vectors(&self) -> impl Iterator<Item = &[f32]> {
        self.0
            .iter()
            .flat_map(|pair| [&pair.correction[..], &pair.reduction[..]])
    }

    /// Appends a vector of another program's [`Self::vectors`].
    pub fn restore(&mut self, vector: &[f64]) {
        let vector: Vec<f32> = vector.iter().map(|x| *x as f32).collect();
        match self.0.back_mut() {
            Some(pair) if pair.reduction.is_empty() => pair.reduction = vector,
            _ => self.0.push_back(Pair {
                correction: vector,
                reduction: vec![],
            }),
        }
    }

    /// The combination that removes most of the residual `r`; `None` where it would leave most of it. Collective.
    pub fn guess(&self, space: VectorLayout<'_>, r: &[f64], norm: f64) -> Option<Guess> {
        let m = self.0.len();
        let mut sums = vec![0.0; m * (m + 1)];
        for (i, pair) in self.0.iter().enumerate() {
            for (j, other) in self.0.iter().take(i + 1).enumerate() {
                sums[i * m + j] = space.own_dot(&pair.reduction, &other.reduction);
            }
            sums[m * m + i] = space.own_dot(&pair.reduction, r);
        }
        space.comm.sum(&mut sums);
        let size: Vec<f64> = (0..m)
            .map(|i| sums[i * m + i].sqrt().max(f64::MIN_POSITIVE))
            .collect();
        let gram = DMatrix::from_fn(m, m, |i, j| {
            sums[i.max(j) * m + i.min(j)] / size[i] / size[j]
        });
        let right = DVector::from_fn(m, |i, _| sums[m * m + i] / size[i]);
        let ridged = &gram + DMatrix::identity(m, m) * RIDGE;
        let shares = ridged.cholesky()?.solve(&right);
        let left = norm * norm - 2.0 * shares.dot(&right) + shares.dot(&(&gram * &shares));
        let left = left.max(0.0).sqrt();
        if !(left < USEFUL * norm) {
            return None;
        }
        let mut correction = vec![0.0; r.len()];
        for ((pair, share), size) in self.0.iter().zip(&shares).zip(&size) {
            let share = share / size;
            for (to, x) in correction.iter_mut().zip(&pair.correction) {
                *to += share * f64::from(*x);
            }
        }
        Some(Guess { correction, left })
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_linalg::parallel::{Layout, SingleProcess};

    use super::*;

    /// A linear residual with stiffnesses of 1 to 30.
    fn residual(u: &[f64]) -> Vec<f64> {
        (0..30).map(|k| f64::from(k + 1) * u[k as usize]).collect()
    }

    fn smooth(time: f64) -> Vec<f64> {
        (0..30)
            .map(|k| (0.1 * time + 0.2 * f64::from(k)).sin())
            .collect()
    }

    fn recent(n: i32) -> Recent {
        let mut recent = Recent::default();
        for time in 0..n {
            let u = smooth(f64::from(time));
            recent.keep(&u, &residual(&u), &[0.0; 30], 4);
        }
        recent
    }

    #[test]
    fn corrections_that_change_slowly_are_foreseen() {
        let layout = Layout::whole(10);
        let space = VectorLayout {
            comm: &SingleProcess,
            layout: &layout,
        };
        let wanted = smooth(7.0);
        let r = residual(&wanted);
        let guess = recent(7).guess(space, &r, space.norm(&r)).expect("useful");
        assert!(guess.left < 1e-3 * space.norm(&r), "{}", guess.left);
        for (x, wanted) in guess.correction.iter().zip(&wanted) {
            assert!((x - wanted).abs() < 1e-2, "{x} for {wanted}");
        }
        let foreign: Vec<f64> = (0..30).map(|k| f64::from(k % 2) - 0.5).collect();
        assert!(
            recent(1)
                .guess(space, &foreign, space.norm(&foreign))
                .is_none()
        );
    }

    #[test]
    fn vectors_restore_what_was_kept() {
        let (kept, mut restored) = (recent(9), Recent::default());
        assert_eq!(kept.vectors().count(), 8);
        for vector in kept.vectors() {
            let vector: Vec<f64> = vector.iter().map(|x| f64::from(*x)).collect();
            restored.restore(&vector);
        }
        assert_eq!(restored, kept);
    }
}
