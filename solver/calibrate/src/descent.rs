//! Levenberg–Marquardt descent of half the sum of squares of the residuals and of the distance from
//! a point of the prior, in coordinates in which the prior is standard normal
//! ([`crate::posterior::TruncatedNormal`]). Bounds then need no special treatment.
//!
//! Derivatives come from finite differences and, from step to step, from Broyden's update.
//! Differences are taken again if a step falls short of its promise, and before a descent counts as
//! ended.

use nalgebra::{DMatrix, DVector};

/// Step of a difference, in standard deviations of the prior. It must exceed the roughness of a
/// simulated beat.
pub(crate) const DIFFERENCE: f64 = 0.02;
/// Largest change of a coordinate in one step.
pub(crate) const LONGEST: f64 = 1.0;
/// Promised gain of the next step below which a descent ends.
const GAIN: f64 = 0.1;
/// Number of tries over which [`GAIN_OF_TRIES`] counts.
const TRIES: usize = 8;
/// A descent also ends if the last [`TRIES`] tries together gained less than this. The typical
/// points of a posterior lie n/2 above its mode.
const GAIN_OF_TRIES: f64 = 0.3;
/// Initial damping, relative to the diagonal of the Hessian.
pub(crate) const DAMPING: f64 = 0.1;
/// Largest damping. A descent that would need more has nowhere to go.
pub(crate) const MOST_DAMPING: f64 = 1e5;
/// Shares of the promised gain: below the first, derivatives are taken again; above the second, the
/// next step is damped less.
pub(crate) const KEPT: [f64; 2] = [0.25, 0.75];

/// Result of a model at given parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated<Q> {
    /// Differences from the data, independent with standard deviation 1 if the model is right.
    pub residuals: Vec<f64>,
    /// Further quantities whose distribution is wanted.
    pub seen: Q,
}

/// A model as a function of standard coordinates; `None` if it has no result, which counts as
/// impossible.
pub(crate) type Model<'a, Q> = &'a dyn Fn(&[f64]) -> Option<Evaluated<Q>>;

/// Perturbations that a descent trades off: errors of the data and a point of the prior.
pub(crate) struct Aim {
    /// Errors added to the residuals.
    pub(crate) errors: Vec<f64>,
    /// Point of the prior, in standard coordinates.
    pub(crate) prior: Vec<f64>,
    /// Weight of the squared distance from that point; 1 for a posterior.
    pub(crate) weight: f64,
}

impl Aim {
    fn parts(&self, u: &[f64], residuals: &[f64]) -> (DVector<f64>, DVector<f64>) {
        let sum = residuals.iter().zip(&self.errors).map(|(r, e)| r + e);
        let weight = self.weight.sqrt();
        let off = u.iter().zip(&self.prior).map(|(u, p)| weight * (u - p));
        (
            DVector::from_iterator(residuals.len(), sum),
            DVector::from_iterator(u.len(), off),
        )
    }

    /// Half the sum of squares of the perturbed residuals and of the distance from the prior's
    /// point.
    pub(crate) fn height(&self, u: &[f64], residuals: &[f64]) -> f64 {
        let (data, prior) = self.parts(u, residuals);
        0.5 * (data.norm_squared() + prior.norm_squared())
    }

    /// The damped step from `u` and its promised gain; `None` if its matrix has no factorisation.
    /// The step is shortened if it changes a coordinate by more than `longest`.
    pub(crate) fn step(
        &self,
        u: &[f64],
        residuals: &[f64],
        jacobian: &DMatrix<f64>,
        damping: f64,
        longest: f64,
    ) -> Option<(DVector<f64>, f64)> {
        let (data, prior) = self.parts(u, residuals);
        let of_prior = DMatrix::identity(u.len(), u.len()) * self.weight;
        let hessian = of_prior + jacobian.tr_mul(jacobian);
        let damped = &hessian + DMatrix::from_diagonal(&(hessian.diagonal() * damping));
        let slope = jacobian.tr_mul(&data) + prior * self.weight.sqrt();
        let mut step = -damped.cholesky()?.solve(&slope);
        step *= (longest / step.amax()).min(1.0);
        let gain = -slope.dot(&step) - 0.5 * step.dot(&(&hessian * &step));
        Some((step, gain))
    }
}

/// A descent that counts the evaluations of the model.
pub(crate) struct Descent<'a, Q> {
    pub(crate) model: Model<'a, Q>,
    pub(crate) aim: Aim,
    pub(crate) evaluations: usize,
}

/// End of a descent.
pub(crate) struct End<Q> {
    pub(crate) u: Vec<f64>,
    pub(crate) found: Evaluated<Q>,
    pub(crate) jacobian: DMatrix<f64>,
}

impl<Q> Descent<'_, Q> {
    pub(crate) fn at(&mut self, u: &[f64]) -> Option<Evaluated<Q>> {
        self.evaluations += 1;
        (self.model)(u)
    }

    /// Descends from `u`, where the model returned `found`.
    ///
    /// - `max_steps`: limit of tries, including those without gain
    pub(crate) fn from(
        &mut self,
        mut u: Vec<f64>,
        mut found: Evaluated<Q>,
        max_steps: usize,
    ) -> Option<End<Q>> {
        let mut height = self.aim.height(&u, &found.residuals);
        let mut fresh = true;
        let mut jacobian = self.differences(&u, &found.residuals);
        let mut damping = DAMPING;
        let mut converged = false;
        let mut heights = vec![height];
        for _ in 0..max_steps {
            if heights.len() > TRIES && heights[heights.len() - 1 - TRIES] - height < GAIN_OF_TRIES
            {
                converged = true;
                break;
            }
            let (step, promised) =
                self.aim
                    .step(&u, &found.residuals, &jacobian, damping, LONGEST)?;
            if promised < GAIN || damping > MOST_DAMPING {
                if fresh {
                    converged = damping <= MOST_DAMPING;
                    break;
                }
                jacobian = self.differences(&u, &found.residuals);
                (fresh, damping) = (true, damping.min(DAMPING));
                continue;
            }
            let next: Vec<f64> = u.iter().zip(&step).map(|(u, s)| u + s).collect();
            let there = self.at(&next);
            let gained = there.as_ref().map_or(f64::NEG_INFINITY, |there| {
                height - self.aim.height(&next, &there.residuals)
            });
            let kept = gained / promised;
            if let Some(there) = &there {
                let change = there
                    .residuals
                    .iter()
                    .zip(&found.residuals)
                    .map(|(there, here)| there - here);
                let change = DVector::from_iterator(there.residuals.len(), change);
                let missed = change - &jacobian * &step;
                jacobian.ger(1.0 / step.norm_squared(), &missed, &step, 1.0);
            }
            if let Some(there) = there.filter(|_| gained > 0.0) {
                (u, found, height) = (next, there, height - gained);
            }
            heights.push(height);
            if kept < KEPT[0] {
                if fresh || gained.is_infinite() {
                    damping *= 4.0;
                }
                if !fresh {
                    jacobian = self.differences(&u, &found.residuals);
                }
                // After fresh differences, Broyden's update is no worse than they are.
                fresh = !fresh;
            } else {
                fresh = false;
                if kept > KEPT[1] {
                    damping /= 5.0;
                }
            }
        }
        // An undamped last step makes up for the damping.
        if let Some((step, _)) = self
            .aim
            .step(&u, &found.residuals, &jacobian, 0.0, f64::INFINITY)
            .filter(|_| converged)
        {
            let next: Vec<f64> = u.iter().zip(&step).map(|(u, s)| u + s).collect();
            if let Some(there) = self
                .at(&next)
                .filter(|there| self.aim.height(&next, &there.residuals) < height)
            {
                (u, found) = (next, there);
            }
        }
        Some(End { u, found, jacobian })
    }

    /// Derivatives of the residuals by one-sided differences; the other side is used where the
    /// model has no result.
    fn differences(&mut self, u: &[f64], residuals: &[f64]) -> DMatrix<f64> {
        let mut jacobian = DMatrix::zeros(residuals.len(), u.len());
        for j in 0..u.len() {
            // Inwards first, where the prior is dense and most models have a result.
            let inwards = if u[j] > 0.0 { -DIFFERENCE } else { DIFFERENCE };
            let side = [inwards, -inwards].into_iter().find_map(|step| {
                let mut moved = u.to_vec();
                moved[j] += step;
                Some((self.at(&moved)?.residuals, step))
            });
            if let Some((moved, step)) = side {
                for (i, (moved, here)) in moved.iter().zip(residuals).enumerate() {
                    jacobian[(i, j)] = (moved - here) / step;
                }
            }
        }
        jacobian
    }
}
