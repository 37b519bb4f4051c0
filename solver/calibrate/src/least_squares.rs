//! Bounded nonlinear least squares: Levenberg–Marquardt steps, projected onto the box.
//!
//! Source: Marquardt 1963, J. SIAM 11:431, with the damping of Nielsen 1999 (report
//! IMM-REP-1999-05); parameters that push against a bound are held there. The solver is meant for
//! few parameters and cheap residuals: it evaluates differences itself instead of through an
//! ask-and-tell interface.

use crate::{Interval, IntervalError};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Tolerances and limits of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// The fit ends when a step lowers the sum of squares by less than this fraction.
    pub cost_tolerance: f64,
    /// The fit ends when a step moves no parameter by more than this fraction of its interval.
    pub step_tolerance: f64,
    /// Largest number of steps, including rejected ones.
    pub max_steps: usize,
    /// Step of a difference over the width of the parameter's interval. It must exceed the
    /// roughness of the residuals.
    pub difference_step: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            cost_tolerance: 1e-12,
            step_tolerance: 1e-10,
            max_steps: 200,
            difference_step: 1e-5,
        }
    }
}

/// Invalid input to a least squares fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LeastSquaresError {
    /// The box is empty, or an interval is not finite and in order.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// The start has another dimension than the box.
    #[error("the start has {n_start} parameters, but the box has {n_bounds}")]
    Dimension {
        /// Length of the start.
        n_start: usize,
        /// Number of intervals of the box.
        n_bounds: usize,
    },
    /// The residuals at the start are not all finite.
    #[error("the residuals at the start {start:?} are not all finite")]
    StartNotFinite {
        /// Start, clamped to the box.
        start: Vec<f64>,
    },
}

/// Result of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Best parameters, in their units.
    pub parameters: Vec<f64>,
    /// Sum of the squared residuals.
    pub sum_of_squares: f64,
    /// Number of residuals at every point.
    pub n_residuals: usize,
    /// Whether each parameter is on a bound that the residuals push against.
    pub at_bound: Vec<bool>,
    /// Whether a tolerance was met, rather than the limit of steps.
    pub converged: bool,
    /// Derivatives of the residuals, shape (residuals, parameters).
    jacobian: DMatrix<f64>,
}

impl Fit {
    /// Variance of one residual: the sum of squares over the number of residuals minus that of free
    /// parameters.
    #[must_use]
    pub fn residual_variance(&self) -> f64 {
        let n_free = self.at_bound.iter().filter(|b| !**b).count();
        self.sum_of_squares / self.n_residuals.saturating_sub(n_free).max(1) as f64
    }

    /// Standard error of each parameter from the linearised model, for independent residuals. It is
    /// `None` for a parameter at a bound, and for all if the residuals do not distinguish the free
    /// ones.
    #[must_use]
    pub fn standard_errors(&self) -> Vec<Option<f64>> {
        let free: Vec<usize> = (0..self.at_bound.len())
            .filter(|i| !self.at_bound[*i])
            .collect();
        let jacobian = self.jacobian.select_columns(&free);
        let mut errors = vec![None; self.at_bound.len()];
        // Columns are scaled to unit length first, because parameters have different units.
        let lengths: Vec<f64> = jacobian.column_iter().map(|c| c.norm()).collect();
        if lengths.iter().any(|l| l.is_nan() || *l <= 0.0) {
            return errors;
        }
        let scaled = DMatrix::from_fn(jacobian.nrows(), free.len(), |r, c| {
            jacobian[(r, c)] / lengths[c]
        });
        if let Some(inverse) = (scaled.transpose() * scaled)
            .cholesky()
            .map(|c| c.inverse())
        {
            for (position, parameter) in free.iter().enumerate() {
                let variance = inverse[(position, position)] * self.residual_variance();
                errors[*parameter] =
                    Some(variance.sqrt() / lengths[position]).filter(|e: &f64| e.is_finite());
            }
        }
        errors
    }
}

/// Minimises the sum of squared residuals within a box; `residuals` returns the same number of
/// residuals for any parameters.
///
/// # Errors
/// [`LeastSquaresError`] if the box or start is invalid, or the residuals at the start are not
/// finite.
pub fn fit(
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
    start: &[f64],
    bounds: &[Interval],
    settings: Settings,
) -> Result<Fit, LeastSquaresError> {
    Interval::validate(bounds)?;
    if start.len() != bounds.len() {
        return Err(LeastSquaresError::Dimension {
            n_start: start.len(),
            n_bounds: bounds.len(),
        });
    }
    let evaluate = |x: &[f64]| DVector::from_vec(residuals(x));
    let mut x: Vec<f64> = start.iter().zip(bounds).map(|(x, b)| b.clamp(*x)).collect();
    let mut r = evaluate(&x);
    let mut cost = r.norm_squared();
    if !cost.is_finite() {
        return Err(LeastSquaresError::StartNotFinite { start: x });
    }
    let mut jacobian = differences(&evaluate, &x, &r, bounds, settings.difference_step);
    let (mut damping, mut growth) = (1e-3, 2.0);
    let mut converged = false;
    for _ in 0..settings.max_steps {
        let gradient = jacobian.tr_mul(&r);
        let held = held(&x, gradient.as_slice(), bounds);
        let Some(step) = step(&jacobian, &gradient, &held, damping) else {
            // Every parameter is held, or none has an effect.
            converged = true;
            break;
        };
        let trial: Vec<f64> = x
            .iter()
            .zip(step.iter())
            .zip(bounds)
            .map(|((x, s), b)| b.clamp(x + s))
            .collect();
        let moved = x
            .iter()
            .zip(&trial)
            .zip(bounds)
            .map(|((a, b), i)| (a - b).abs() / i.width().max(f64::MIN_POSITIVE));
        let moves = moved.fold(0.0, f64::max);
        let trial_r = evaluate(&trial);
        let trial_cost = trial_r.norm_squared();
        // NaN does not count as a fall.
        if trial_cost < cost {
            let fall = cost - trial_cost;
            let taken = DVector::from_fn(x.len(), |i, _| trial[i] - x[i]);
            let predicted = -(2.0 * gradient.dot(&taken) + (&jacobian * &taken).norm_squared());
            let agreement = (fall / predicted).clamp(0.0, 1.0);
            damping = (damping * (1.0 - (2.0 * agreement - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-15);
            growth = 2.0;
            (x, r) = (trial, trial_r);
            converged = fall <= settings.cost_tolerance * cost || moves <= settings.step_tolerance;
            cost = trial_cost;
            jacobian = differences(&evaluate, &x, &r, bounds, settings.difference_step);
        } else {
            converged = moves <= settings.step_tolerance;
            damping *= growth;
            growth *= 2.0;
        }
        if converged {
            break;
        }
    }
    let at_bound = held(&x, jacobian.tr_mul(&r).as_slice(), bounds);
    Ok(Fit {
        parameters: x,
        sum_of_squares: cost,
        n_residuals: r.len(),
        at_bound,
        converged,
        jacobian,
    })
}

/// Marks parameters without a width, and those at a bound (to a millionth of the width) that the
/// gradient pushes against.
fn held(x: &[f64], gradient: &[f64], bounds: &[Interval]) -> Vec<bool> {
    x.iter()
        .zip(gradient)
        .zip(bounds)
        .map(|((x, g), b)| {
            let near = 1e-6 * b.width();
            (x - b.lower <= near && *g > 0.0)
                || (b.upper - x <= near && *g < 0.0)
                || b.width() == 0.0
        })
        .collect()
}

/// The damped step, which is zero for held parameters; `None` if no parameter can move.
fn step(
    jacobian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    held: &[bool],
    damping: f64,
) -> Option<DVector<f64>> {
    let free: Vec<usize> = (0..held.len())
        .filter(|i| !held[*i] && jacobian.column(*i).norm_squared() > 0.0)
        .collect();
    if free.is_empty() {
        return None;
    }
    let jacobian = jacobian.select_columns(&free);
    let mut normal = jacobian.transpose() * &jacobian;
    for i in 0..free.len() {
        normal[(i, i)] *= 1.0 + damping;
    }
    let right = DVector::from_fn(free.len(), |i, _| -gradient[free[i]]);
    let solution = normal.cholesky()?.solve(&right);
    let mut step = DVector::zeros(held.len());
    for (position, parameter) in free.into_iter().enumerate() {
        step[parameter] = solution[position];
    }
    Some(step)
}

/// Second-order derivatives of the residuals: central differences, one-sided next to a bound, and
/// zero for parameters without a width.
fn differences(
    evaluate: &dyn Fn(&[f64]) -> DVector<f64>,
    x: &[f64],
    r: &DVector<f64>,
    bounds: &[Interval],
    difference_step: f64,
) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(r.len(), x.len());
    for (i, interval) in bounds.iter().enumerate().filter(|(_, b)| b.width() > 0.0) {
        let h = difference_step * interval.width();
        let at = |value: f64| {
            let mut point = x.to_vec();
            point[i] = value;
            evaluate(&point)
        };
        let derivative = if interval.contains(x[i] - h) && interval.contains(x[i] + h) {
            (at(x[i] + h) - at(x[i] - h)) / (2.0 * h)
        } else {
            let inward = if interval.contains(x[i] + 2.0 * h) {
                h
            } else {
                -h
            };
            (4.0 * at(x[i] + inward) - at(x[i] + 2.0 * inward) - 3.0 * r) / (2.0 * inward)
        };
        jacobian.set_column(i, &derivative.map(|d| if d.is_finite() { d } else { 0.0 }));
    }
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exponential(x: &[f64]) -> Vec<f64> {
        (0..50)
            .map(|i| {
                let t = 0.1 * f64::from(i);
                x[0] * (-x[1] * t).exp() + x[2] - (2.0 * (-0.7 * t).exp() + 0.3)
            })
            .collect()
    }

    #[test]
    fn finds_the_parameters_of_a_decay() {
        let bounds = [
            Interval::new(0.0, 10.0),
            Interval::new(0.01, 5.0),
            Interval::new(-1.0, 1.0),
        ];
        let fit = fit(
            &exponential,
            &[9.0, 4.0, -0.9],
            &bounds,
            Settings::default(),
        )
        .unwrap();
        assert!(fit.converged && fit.sum_of_squares < 1e-18, "{fit:?}");
        for (x, expected) in fit.parameters.iter().zip([2.0, 0.7, 0.3]) {
            assert!((x - expected).abs() < 1e-8);
        }
    }

    /// Rosenbrock's valley as residuals, with and without its minimum in the box.
    #[test]
    fn stays_in_the_box_and_finds_the_constrained_minimum() {
        let valley = |x: &[f64]| vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]];
        let wide = [Interval::new(-3.0, 3.0); 2];
        let free = fit(&valley, &[-1.2, 1.0], &wide, Settings::default()).unwrap();
        assert!(
            free.sum_of_squares < 1e-18 && free.at_bound == [false, false],
            "{free:?}"
        );
        let narrow = [Interval::new(-3.0, 0.5), Interval::new(-3.0, 3.0)];
        let cut = fit(&valley, &[-1.2, 1.0], &narrow, Settings::default()).unwrap();
        assert!(
            (cut.sum_of_squares - 0.25).abs() < 1e-12 && cut.at_bound == [true, false],
            "{cut:?}"
        );
        assert!((cut.parameters[1] - 0.25).abs() < 1e-8);
    }

    /// Standard errors of a straight line are known in closed form.
    #[test]
    fn errors_of_a_line() {
        let y = [1.0, 2.9, 5.2, 6.8, 9.1, 11.0];
        let line = |x: &[f64]| {
            y.iter()
                .enumerate()
                .map(|(i, y)| x[0] + x[1] * i as f64 - y)
                .collect()
        };
        let bounds = [Interval::new(-100.0, 100.0); 2];
        let fit = fit(&line, &[50.0, -50.0], &bounds, Settings::default()).unwrap();
        let n = y.len() as f64;
        let centre = (n - 1.0) / 2.0;
        let spread: f64 = (0..6).map(|i| (f64::from(i) - centre).powi(2)).sum();
        let mean = y.iter().sum::<f64>() / n;
        let slope: f64 = y
            .iter()
            .enumerate()
            .map(|(i, y)| (i as f64 - centre) * (y - mean))
            .sum::<f64>()
            / spread;
        assert!((fit.parameters[1] - slope).abs() < 1e-9);
        let variance = fit.sum_of_squares / (n - 2.0);
        let errors = fit.standard_errors();
        assert!((errors[1].unwrap() / (variance / spread).sqrt() - 1.0).abs() < 1e-6);
        let intercept = (variance * (1.0 / n + centre * centre / spread)).sqrt();
        assert!((errors[0].unwrap() / intercept - 1.0).abs() < 1e-6);
    }

    #[test]
    fn parameters_that_act_alike_have_no_errors() {
        let sum = |x: &[f64]| (0..5).map(|i| (x[0] + x[1]) * f64::from(i) - 2.0).collect();
        let fit = fit(
            &sum,
            &[0.1, 0.2],
            &[Interval::new(-5.0, 5.0); 2],
            Settings::default(),
        )
        .unwrap();
        let errors = fit.standard_errors();
        assert!(
            errors.iter().all(|e| e.is_none_or(|e| e > 1e4)),
            "{errors:?}"
        );
    }

    #[test]
    fn nonsense_is_refused_and_walls_are_survived() {
        let box1 = [Interval::new(0.0, 4.0)];
        assert!(fit(&|_| vec![f64::NAN], &[1.0], &box1, Settings::default()).is_err());
        assert!(fit(&|_| vec![0.0], &[1.0, 2.0], &box1, Settings::default()).is_err());
        let walled = |x: &[f64]| {
            vec![if x[0] > 3.0 {
                f64::INFINITY
            } else {
                x[0] - 2.9
            }]
        };
        let best = fit(&walled, &[0.5], &box1, Settings::default()).unwrap();
        assert!((best.parameters[0] - 2.9).abs() < 1e-6, "{best:?}");
        let fixed = [Interval::new(1.0, 1.0)];
        assert_eq!(
            fit(&|x| vec![x[0]], &[7.0], &fixed, Settings::default())
                .unwrap()
                .parameters,
            [1.0]
        );
    }
}
