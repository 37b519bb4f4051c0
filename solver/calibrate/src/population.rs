//! What the population-based optimisers share.

use crate::lbfgsb::LbfgsbError;
use crate::{Interval, IntervalError};

/// What is wrong with what an optimiser was given.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PopulationError {
    /// The box makes no sense.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// A setting that makes no sense.
    #[error("setting {key} is {value}, but must be {expected}")]
    Setting {
        /// Key of the setting.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// A guess that does not fit the box, or more guesses than can begin.
    #[error(
        "guess {idx} has {n_guess} parameters of {n_bounds}, and {n_guesses} guesses can begin"
    )]
    Guess {
        /// Position of the guess.
        idx: usize,
        /// Its number of parameters.
        n_guess: usize,
        /// Number of intervals.
        n_bounds: usize,
        /// Largest number of guesses.
        n_guesses: usize,
    },
    /// Another number of costs than points were asked for.
    #[error("{n_costs} costs were told for {n_points} points")]
    Costs {
        /// Costs told.
        n_costs: usize,
        /// Points asked.
        n_points: usize,
    },
    /// Nothing is being asked any more.
    #[error("costs were told after the optimisation had ended")]
    Ended,
    /// The polish refused its start or its costs.
    #[error("the polish failed")]
    Polish(#[from] LbfgsbError),
}

/// Looks at one setting.
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

/// Guesses in unit coordinates, cut to the box.
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

/// From the parameters' units to unit coordinates, cut to the box.
pub(crate) fn to_unit(point: &[f64], bounds: &[Interval]) -> Vec<f64> {
    point
        .iter()
        .zip(bounds)
        .map(|(x, b)| b.to_unit(b.clamp(*x)))
        .collect()
}

/// From unit coordinates to the parameters' units.
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
                .contains("guess 0 has 1 parameters of 2")
        );
        assert!(unit_guesses(&[vec![1.0, 1.0], vec![1.0, 1.0]], &bounds, 1).is_err());
        assert_eq!(scale(&[0.5, 1.0], &bounds), [1.0, 1.0]);
    }
}
