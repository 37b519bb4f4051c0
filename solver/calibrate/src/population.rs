//! Errors, checks and unit coordinates shared by the population-based optimisers.

use crate::lbfgsb::LbfgsbError;
use crate::{Interval, IntervalError};

/// Invalid input to a population-based optimiser.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PopulationError {
    /// The box is empty, or an interval is not finite and in order.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// A setting outside its range.
    #[error("setting {key} is {value}, but must be {expected}")]
    Setting {
        /// Key of the setting.
        key: &'static str,
        /// Value found.
        value: f64,
        /// Expected range.
        expected: &'static str,
    },
    /// A guess does not match the box, or there are more guesses than members.
    #[error(
        "guess {idx} has {n_guess} parameters, expected {n_bounds} and at most {n_guesses} guesses"
    )]
    Guess {
        /// Index of the guess.
        idx: usize,
        /// Number of parameters of the guess.
        n_guess: usize,
        /// Number of intervals.
        n_bounds: usize,
        /// Largest number of guesses.
        n_guesses: usize,
    },
    /// The number of costs differs from the number of points requested.
    #[error("{n_costs} costs were given for {n_points} points")]
    Costs {
        /// Number of costs given.
        n_costs: usize,
        /// Number of points requested.
        n_points: usize,
    },
    /// Costs were given after the end of the optimisation.
    #[error("costs were given after the optimisation had ended")]
    Ended,
    /// The polish rejected its start or its costs.
    #[error("the polish failed")]
    Polish(#[from] LbfgsbError),
}

/// Checks one setting.
pub(crate) fn check(
    key: &'static str,
    value: f64,
    ok: bool,
    expected: &'static str,
) -> Result<(), PopulationError> {
    if ok {
        Ok(())
    } else {
        Err(PopulationError::Setting {
            key,
            value,
            expected,
        })
    }
}

/// Guesses in unit coordinates, clamped to the box.
pub(crate) fn unit_guesses(
    guesses: &[Vec<f64>],
    bounds: &[Interval],
    n_guesses: usize,
) -> Result<Vec<Vec<f64>>, PopulationError> {
    guesses
        .iter()
        .enumerate()
        .map(|(idx, guess)| {
            if guess.len() != bounds.len() || idx >= n_guesses {
                let (n_guess, n_bounds) = (guess.len(), bounds.len());
                return Err(PopulationError::Guess {
                    idx,
                    n_guess,
                    n_bounds,
                    n_guesses,
                });
            }
            Ok(to_unit(guess, bounds))
        })
        .collect()
}

/// Converts from the parameters' units to unit coordinates, clamped to the box.
pub(crate) fn to_unit(point: &[f64], bounds: &[Interval]) -> Vec<f64> {
    point
        .iter()
        .zip(bounds)
        .map(|(x, b)| b.to_unit(b.clamp(*x)))
        .collect()
}

/// Converts from unit coordinates to the parameters' units.
pub(crate) fn scale(unit: &[f64], bounds: &[Interval]) -> Vec<f64> {
    unit.iter()
        .zip(bounds)
        .map(|(u, b)| b.from_unit(*u))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn guesses_are_cut_to_the_box_and_refused_by_name() {
        let bounds = [Interval::new(0.0, 2.0), Interval::new(-1.0, 1.0)];
        assert_eq!(
            unit_guesses(&[vec![1.0, -9.0]], &bounds, 1).unwrap(),
            [[0.5, 0.0]]
        );
        assert!(
            unit_guesses(&[vec![1.0]], &bounds, 3)
                .unwrap_err()
                .to_string()
                .contains("guess 0 has 1 parameters, expected 2")
        );
        assert!(unit_guesses(&[vec![1.0, 1.0], vec![1.0, 1.0]], &bounds, 1).is_err());
        assert_eq!(scale(&[0.5, 1.0], &bounds), [1.0, 1.0]);
    }
}
