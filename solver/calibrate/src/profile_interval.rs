//! Ends of a profile interval, where the minimised sum of squares crosses its threshold.

use crate::Interval;

/// Largest number of doublings of the step in search of a crossing.
const N_DOUBLINGS: usize = 40;
/// Largest number of refinements of a bracketed crossing.
const N_REFINEMENTS: usize = 12;
/// Relative precision of an end, in terms of the rise of the root of the sum of squares.
const PRECISION: f64 = 1e-3;

/// Fits the other parameters from a start while one is held at a value; returns the sum of squares
/// and the end point.
type Constrained<'a> = dyn Fn(f64, &[f64]) -> Option<(f64, Vec<f64>)> + 'a;

/// Profile of one parameter, with the optimum that it starts from.
pub(crate) struct Profile<'a> {
    pub(crate) at: &'a Constrained<'a>,
    pub(crate) start: &'a [f64],
    /// Sum of squares at the optimum.
    pub(crate) least: f64,
    /// Sum of squares at an end.
    pub(crate) threshold: f64,
}

impl Profile<'_> {
    /// Signed distance from the threshold: −1 at the optimum and 0 at an end. It is almost linear
    /// between them because the sum of squares is almost quadratic. NaN where the model fails.
    fn beyond(&self, value: f64, warm: &mut Vec<f64>) -> f64 {
        let Some((cost, at)) = (self.at)(value, warm) else {
            return f64::NAN;
        };
        if cost <= self.threshold {
            *warm = at;
        }
        ((cost - self.least).max(0.0) / (self.threshold - self.least).max(f64::MIN_POSITIVE)).sqrt()
            - 1.0
    }

    /// Lower and upper end; `None` where the limit is reached below the threshold.
    pub(crate) fn interval(
        &self,
        best: f64,
        first_step: f64,
        limits: Interval,
    ) -> [Option<f64>; 2] {
        // An exact trace has a step of zero; any positive step crosses its threshold.
        let step = first_step.max(1e-9 * limits.width());
        [-1.0, 1.0].map(|side| self.end(best, side * step, limits))
    }

    fn end(&self, best: f64, mut step: f64, limits: Interval) -> Option<f64> {
        let mut warm = self.start.to_vec();
        let (mut inside, mut outside) = ((best, -1.0), None);
        for _ in 0..N_DOUBLINGS {
            let value = limits.clamp(best + step);
            let beyond = self.beyond(value, &mut warm);
            // NaN counts as beyond the threshold.
            if beyond.is_nan() || beyond > 0.0 {
                outside = Some((value, beyond));
                break;
            }
            inside = (value, beyond);
            if value == limits.lower || value == limits.upper {
                return None;
            }
            step *= 2.0;
        }
        let mut outside = outside?;
        for _ in 0..N_REFINEMENTS {
            let secant = inside.0 + (outside.0 - inside.0) * inside.1 / (inside.1 - outside.1);
            let middle = 0.5 * (inside.0 + outside.0);
            let value = if secant.is_finite() { secant } else { middle };
            let beyond = self.beyond(value, &mut warm);
            if beyond.abs() <= PRECISION {
                return Some(value);
            }
            // The end that is kept counts half (Dowell and Jarratt 1971, the Illinois rule).
            if beyond <= 0.0 {
                inside = (value, beyond);
                outside.1 *= 0.5;
            } else {
                outside = (value, beyond);
                inside.1 *= 0.5;
            }
        }
        Some(0.5 * (inside.0 + outside.0))
    }
}
