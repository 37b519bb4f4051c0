//! Bounded least squares for expensive residuals: one-sided differences, few iterations and a
//! reliable stop.
//!
//! The steps are Levenberg–Marquardt with Nielsen's damping (report IMM-REP-1999-05), projected
//! onto the box; parameters that push against a bound are held there. Unlike in
//! `calibrate::least_squares`, a simulation may fail and give no residuals. The result includes the
//! last Jacobian, which evidence and bootstrap need.

use nalgebra::{DMatrix, DVector};

/// Tolerances and limits of a minimisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The minimisation ends when steps lower the sum of squares by less than this.
    pub tolerance: f64,
    /// Largest number of Jacobians.
    pub max_iterations: usize,
    /// Step of a difference in z.
    pub difference: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tolerance: 0.05,
            max_iterations: 25,
            difference: 3e-3,
        }
    }
}

/// Result of a minimisation.
#[derive(Debug, Clone)]
pub struct Minimum<S> {
    /// Parameters at the minimum, in z.
    pub z: Vec<f64>,
    /// Residuals at the minimum.
    pub residuals: DVector<f64>,
    /// Sum of the squared residuals.
    pub cost: f64,
    /// Derivatives, shape (residuals, parameters), at the last accepted point or one step before.
    pub jacobian: DMatrix<f64>,
    /// State of the model at the minimum.
    pub warm: S,
    /// Whether the last step lowered the sum of squares by less than the tolerance.
    pub converged: bool,
    /// Number of evaluations of the residuals.
    pub n_evaluations: usize,
}

/// Residuals of parameters, and a state from which neighbouring points are found faster; `None` if
/// the model has no result.
pub type Residuals<'a, S> = dyn Fn(&[f64], Option<&S>) -> Option<(DVector<f64>, S)> + Sync + 'a;

/// Residuals and derivatives at the start, if known.
pub type Known = (DVector<f64>, DMatrix<f64>);

/// Number of steps over which Broyden's rank-one update (1965, Math Comp 19:577) carries the
/// derivatives before they are computed again.
const CARRIED: usize = 2;
/// Share of its promised gain below which a step ends the use of carried derivatives.
const TRUSTED: f64 = 0.4;

/// Minimises the sum of squares in the box from `start` with the state `warm`; `None` if there are
/// no residuals at the start.
#[must_use]
pub fn minimise<S: Clone>(
    residuals: &Residuals<'_, S>,
    start: &[f64],
    warm: Option<&S>,
    bounds: &[(f64, f64)],
    settings: &Settings,
) -> Option<Minimum<S>> {
    minimise_from(residuals, start, warm, None, bounds, settings)
}

/// As [`minimise`], with known residuals and derivatives at the start, for the same point as
/// `warm`.
#[must_use]
pub fn minimise_from<S: Clone>(
    residuals: &Residuals<'_, S>,
    start: &[f64],
    warm: Option<&S>,
    known: Option<Known>,
    bounds: &[(f64, f64)],
    settings: &Settings,
) -> Option<Minimum<S>> {
    let n = start.len();
    let mut z: Vec<f64> = start
        .iter()
        .zip(bounds)
        .map(|(z, b)| z.clamp(b.0, b.1))
        .collect();
    let mut n_evaluations = 0;
    // Number of steps since the derivatives were computed; `None` while there are none.
    let mut age = None;
    let (mut r, mut jacobian, mut warm) = match known.zip(warm) {
        Some(((r, jacobian), warm)) => {
            age = Some(0);
            (r, jacobian, warm.clone())
        }
        None => {
            n_evaluations += 1;
            let (r, warm) = residuals(&z, warm)?;
            let jacobian = DMatrix::zeros(r.len(), n);
            (r, jacobian, warm)
        }
    };
    let mut cost = r.norm_squared();
    let (mut damping, mut growth) = (1e-2, 2.0);
    let mut converged = false;
    let mut small = 0;
    let mut n_jacobians = 0;
    loop {
        if age.is_none() {
            if n_jacobians == settings.max_iterations {
                break;
            }
            n_jacobians += 1;
            n_evaluations += differences(
                residuals,
                (&z, &r, &warm),
                bounds,
                settings.difference,
                &mut jacobian,
            );
            age = Some(0);
        }
        let steps = age.unwrap_or(0);
        let gradient = jacobian.tr_mul(&r);
        let normal = jacobian.tr_mul(&jacobian);
        let mut fall = None;
        let mut trusted = false;
        for _ in 0..if steps == 0 { 8 } else { 2 } {
            let Some(trial) = step(&normal, &gradient, &z, bounds, damping) else {
                break;
            };
            let taken = DVector::from_fn(n, |i, _| trial[i] - z[i]);
            let predicted = -(2.0 * gradient.dot(&taken) + (&normal * &taken).dot(&taken));
            if predicted < 0.1 * settings.tolerance {
                fall = Some(0.0);
                break;
            }
            n_evaluations += 1;
            let answer = residuals(&trial, Some(&warm));
            let better = answer
                .map(|(r, state)| (r.norm_squared(), r, state))
                .filter(|(c, ..)| *c < cost);
            if let Some((trial_cost, trial_r, state)) = better {
                let gain = cost - trial_cost;
                let agreement = (gain / predicted).clamp(0.0, 1.0);
                damping =
                    (damping * (1.0 - (2.0 * agreement - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-7);
                growth = 2.0;
                trusted = agreement > TRUSTED;
                let missed = &trial_r - &r - &jacobian * &taken;
                jacobian.ger(1.0 / taken.norm_squared(), &missed, &taken, 1.0);
                (z, r, cost, warm) = (trial, trial_r, trial_cost, state);
                fall = Some(gain);
                break;
            }
            damping = (damping * growth).max(1e-4);
            growth *= 2.0;
        }
        match fall {
            // Only derivatives computed at this very point show that no gain is possible.
            None if steps == 0 => break,
            Some(0.0) if steps == 0 => {
                converged = true;
                break;
            }
            None | Some(0.0) => age = None,
            Some(fall) => {
                // One small fall may be due to a poorly damped step; two in a row end the
                // minimisation.
                small = if fall < settings.tolerance {
                    small + 1
                } else {
                    0
                };
                if small == 2 {
                    converged = true;
                    break;
                }
                age = (trusted && small == 0 && steps < CARRIED).then_some(steps + 1);
            }
        }
    }
    Some(Minimum {
        z,
        residuals: r,
        cost,
        jacobian,
        warm,
        converged,
        n_evaluations,
    })
}

/// One-sided differences towards the inside of the box; returns the number of evaluations. If the
/// model has no result at the neighbour of a parameter, the other side and closer neighbours are
/// tried; if all fail, the derivative is zero, and the curvature singular.
pub(crate) fn differences<S>(
    residuals: &Residuals<'_, S>,
    (z, r, warm): (&[f64], &DVector<f64>, &S),
    bounds: &[(f64, f64)],
    step: f64,
    jacobian: &mut DMatrix<f64>,
) -> usize {
    let mut n = 0;
    let mut point = z.to_vec();
    for i in 0..z.len() {
        let (low, high) = bounds[i];
        let inward = if z[i] + step <= high { step } else { -step };
        let mut column = None;
        for h in [inward, -inward, 0.1 * inward, -0.1 * inward] {
            if !(low..=high).contains(&(z[i] + h)) {
                continue;
            }
            point[i] = z[i] + h;
            n += 1;
            if let Some((there, _)) = residuals(&point, Some(warm)) {
                column = Some((there - r) / h);
                break;
            }
        }
        point[i] = z[i];
        match column {
            Some(column) => jacobian.set_column(i, &column),
            None => jacobian.column_mut(i).fill(0.0),
        }
    }
    n
}

/// The point after a damped step. Parameters that reach a bound are held there, and the step is
/// solved again for the others.
fn step(
    normal: &DMatrix<f64>,
    gradient: &DVector<f64>,
    z: &[f64],
    bounds: &[(f64, f64)],
    damping: f64,
) -> Option<Vec<f64>> {
    let n = z.len();
    let near = |i: usize| 1e-9 * (1.0 + (bounds[i].1 - bounds[i].0).min(1e3));
    let mut free: Vec<usize> = (0..n)
        .filter(|i| {
            let held = (z[*i] - bounds[*i].0 <= near(*i) && gradient[*i] > 0.0)
                || (bounds[*i].1 - z[*i] <= near(*i) && gradient[*i] < 0.0);
            !held && normal[(*i, *i)] > 0.0
        })
        .collect();
    // Changes of z fixed so far.
    let mut change = vec![0.0; n];
    loop {
        if free.is_empty() {
            return change
                .iter()
                .any(|c| *c != 0.0)
                .then(|| z.iter().zip(&change).map(|(z, c)| z + c).collect());
        }
        let matrix = DMatrix::from_fn(free.len(), free.len(), |r, c| {
            let value = normal[(free[r], free[c])];
            if r == c {
                value * (1.0 + damping) + 1e-12
            } else {
                value
            }
        });
        let right = DVector::from_fn(free.len(), |r, _| {
            let i = free[r];
            -gradient[i]
                - (0..n)
                    .filter(|k| !free.contains(k))
                    .map(|k| normal[(i, k)] * change[k])
                    .sum::<f64>()
        });
        let solution = matrix.cholesky()?.solve(&right);
        let outside = free.iter().position(|i| {
            let position = free.iter().position(|f| f == i).unwrap_or(0);
            let to = z[*i] + solution[position];
            to < bounds[*i].0 - near(*i) || to > bounds[*i].1 + near(*i)
        });
        match outside {
            Some(position) => {
                let i = free.remove(position);
                let to = (z[i] + solution[position]).clamp(bounds[i].0, bounds[i].1);
                change[i] = to - z[i];
            }
            None => {
                for (position, i) in free.iter().enumerate() {
                    change[*i] = solution[position];
                }
                return Some(
                    (0..n)
                        .map(|i| (z[i] + change[i]).clamp(bounds[i].0, bounds[i].1))
                        .collect(),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tight() -> Settings {
        Settings {
            tolerance: 1e-14,
            max_iterations: 200,
            difference: 1e-6,
        }
    }

    #[test]
    fn finds_the_parameters_of_a_decay() {
        let decay = |x: &[f64], _: Option<&()>| {
            Some((
                DVector::from_iterator(
                    50,
                    (0..50).map(|i| {
                        let t = 0.1 * f64::from(i);
                        x[0] * (-x[1] * t).exp() + x[2] - (2.0 * (-0.7 * t).exp() + 0.3)
                    }),
                ),
                (),
            ))
        };
        let fit = minimise(
            &decay,
            &[9.0, 4.0, -0.9],
            None,
            &[(0.0, 10.0), (0.01, 5.0), (-1.0, 1.0)],
            &tight(),
        )
        .unwrap();
        for (x, expected) in fit.z.iter().zip([2.0, 0.7, 0.3]) {
            assert!((x - expected).abs() < 1e-4, "{:?}", fit.z);
        }
    }

    /// Rosenbrock's valley, with its minimum in the box and outside.
    #[test]
    fn stays_in_the_box_and_finds_the_constrained_minimum() {
        let valley = |x: &[f64], _: Option<&()>| {
            Some((
                DVector::from_vec(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]),
                (),
            ))
        };
        let free = minimise(&valley, &[-1.2, 1.0], None, &[(-3.0, 3.0); 2], &tight()).unwrap();
        assert!(free.cost < 1e-8, "{free:?}");
        let cut = minimise(
            &valley,
            &[-1.2, 1.0],
            None,
            &[(-3.0, 0.5), (-3.0, 3.0)],
            &tight(),
        )
        .unwrap();
        assert!(
            (cut.cost - 0.25).abs() < 1e-6 && (cut.z[1] - 0.25).abs() < 1e-3,
            "{cut:?}"
        );
    }

    #[test]
    fn a_model_without_an_answer_is_a_wall() {
        let walled = |x: &[f64], _: Option<&()>| {
            (x[0] <= 3.0).then(|| (DVector::from_vec(vec![x[0] - 2.9]), ()))
        };
        let best = minimise(&walled, &[0.5], None, &[(0.0, 4.0)], &tight()).unwrap();
        assert!((best.z[0] - 2.9).abs() < 1e-6);
        assert!(minimise(&walled, &[3.5], None, &[(0.0, 4.0)], &tight()).is_none());
    }
}
