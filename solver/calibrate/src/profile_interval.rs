//! Ends of a profile's interval: where the sum of squares, minimised over the others, crosses its threshold.

use crate::Interval;

/// Doublings of the step until the threshold is crossed.
const N_DOUBLINGS: usize = 40;
/// Refinements between.
const N_REFINEMENTS: usize = 12;
/// The end is known when the rise of the root of the sum of squares is met to this fraction.
const PRECISION: f64 = 1e-3;

/// Sum of squares with one parameter held at a value and the others fitted from a start, and where they end.
type Constrained<'a> = dyn Fn(f64, &[f64]) -> Option<(f64, Vec<f64>)> + 'a;

/// A parameter's profile and the optimum that it begins at.
pub(crate) struct Profile<'a> {
    pub(crate) at: &'a Constrained<'a>,
    pub(crate) start: &'a [f64],
    /// Sum of squares at the optimum.
    pub(crate) least: f64,
    /// Sum of squares at an end.
    pub(crate) threshold: f64,
}

impl Profile<'_> {
    /// How far beyond the threshold a value is: -1 at the optimum, 0 at an end, almost linear between, since the sum of
    /// squares is almost quadratic. Not a number where the model fails.
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

    /// Lower and upper end; none where the limit is reached below the threshold.
    pub(crate) fn interval(
        &self,
        best: f64,
        first_step: f64,
        limits: Interval,
    ) -> [Option<f64>; 2] {
        // An exact trace has a step of zero; any positive one crosses its threshold.
        let step = first_step.max(1e-9 * limits.width());
        [-1.0, 1.0].map(|side| self.end(best, side * step, limits))
    }

    fn end(&self, best: f64, mut step: f64, limits: Interval) -> Option<f64> {
        let mut warm = self.start.to_vec();
        let (mut inside, mut outside) = ((best, -1.0), None);
        for _ in 0..N_DOUBLINGS {
            let value = limits.clamp(best + step);
            let beyond = self.beyond(value, &mut warm);
            // Not a number lies beyond, too.
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
            // The end that stays counts half (Dowell and Jarratt 1971, the Illinois rule).
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
