//! Interval of a parameter, and the box that an optimiser stays in.

use serde::{Deserialize, Serialize};

/// Smallest and largest value of one parameter, both included, in the parameter's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interval {
    /// Smallest value that the parameter may take.
    pub lower: f64,
    /// Largest value that the parameter may take.
    pub upper: f64,
}

/// Reasons why a list of intervals is not a valid box.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum IntervalError {
    /// The list is empty.
    #[error("an optimisation needs at least one parameter")]
    Empty,
    /// An interval whose ends are not finite or not in order.
    #[error("interval {idx} goes from {lower} to {upper}, but must be finite and in order")]
    Disordered {
        /// Index of the parameter.
        idx: usize,
        /// Lower end of the interval.
        lower: f64,
        /// Upper end of the interval.
        upper: f64,
    },
}

impl Interval {
    /// Creates an interval from its ends.
    #[must_use]
    pub fn new(lower: f64, upper: f64) -> Self {
        Self { lower, upper }
    }

    /// Length, in the parameter's unit.
    #[must_use]
    pub fn width(&self) -> f64 {
        self.upper - self.lower
    }

    /// Whether a value lies inside, ends included.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        (self.lower..=self.upper).contains(&value)
    }

    /// Nearest value inside the interval; the middle for NaN.
    #[must_use]
    pub fn clamp(&self, value: f64) -> f64 {
        if value.is_nan() {
            0.5 * (self.lower + self.upper)
        } else {
            value.clamp(self.lower, self.upper)
        }
    }

    /// Converts a coordinate in [0, 1] to a value. The formula is `SciPy`'s, because the last
    /// digits of an optimum depend on it.
    #[must_use]
    pub fn from_unit(&self, u: f64) -> f64 {
        let value = 0.5 * (self.lower + self.upper) + (u - 0.5) * self.width().abs();
        // Rounding may exceed an end by one digit.
        value.clamp(self.lower, self.upper)
    }

    /// Converts a value to a coordinate in [0, 1]; 0.5 if the interval has no width.
    #[must_use]
    pub fn to_unit(&self, value: f64) -> f64 {
        if self.width() == 0.0 {
            return 0.5;
        }
        ((value - 0.5 * (self.lower + self.upper)) / self.width().abs() + 0.5).clamp(0.0, 1.0)
    }

    /// Checks that a box is valid.
    ///
    /// # Errors
    /// [`IntervalError`] for an empty box or an interval that is not finite and in order.
    pub fn validate(intervals: &[Self]) -> Result<(), IntervalError> {
        if intervals.is_empty() {
            return Err(IntervalError::Empty);
        }
        match intervals
            .iter()
            .position(|i| !(i.lower.is_finite() && i.upper.is_finite() && i.lower <= i.upper))
        {
            Some(idx) => Err(IntervalError::Disordered {
                idx,
                lower: intervals[idx].lower,
                upper: intervals[idx].upper,
            }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_coordinates_go_both_ways_and_stay_inside() {
        let i = Interval::new(-1.2, 192.5);
        for u in [0.0, 0.3, 0.999_999, 1.0] {
            assert!((i.to_unit(i.from_unit(u)) - u).abs() < 1e-14);
            assert!(i.contains(i.from_unit(u)));
        }
        assert_eq!((i.clamp(-5.0), i.clamp(500.0)), (-1.2, 192.5));
        assert!(i.contains(i.clamp(f64::NAN)));
        assert_eq!(
            Interval::new(3.0, 3.0).from_unit(Interval::new(3.0, 3.0).to_unit(3.0)),
            3.0
        );
    }

    #[test]
    fn nonsense_is_refused() {
        assert_eq!(Interval::validate(&[]), Err(IntervalError::Empty));
        assert!(Interval::validate(&[Interval::new(0.0, 1.0), Interval::new(2.0, 1.0)]).is_err());
        assert!(Interval::validate(&[Interval::new(f64::NAN, 1.0)]).is_err());
        assert!(Interval::validate(&[Interval::new(1.0, 1.0)]).is_ok());
    }
}
