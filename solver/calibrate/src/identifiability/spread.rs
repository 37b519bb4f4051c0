//! Spread of sets that are already near-optimal, such as results of several seeds or guesses.

use super::{Bound, IdentifiabilityError, Mark, Settings, bound_of, mark};
use crate::Interval;
use crate::statistics::{mean, standard_deviation};
use serde::{Deserialize, Serialize};

/// Spread of one parameter over the near-optimal sets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ParameterSpread {
    /// Value of the best set, in the parameter's unit.
    pub best: f64,
    /// Smallest value over the sets.
    pub minimum: f64,
    /// Largest value over the sets.
    pub maximum: f64,
    /// Mean value over the sets.
    pub mean: f64,
    /// Sample standard deviation; `None` for a single set.
    pub standard_deviation: Option<f64>,
    /// Share of the interval between the smallest and the largest value, dimensionless.
    pub share: f64,
    /// Bound that the best value lies on, if any.
    pub bound: Option<Bound>,
    /// Extent to which the sets determine the parameter.
    pub mark: Mark,
}

/// Near-optimal sets among those given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NearOptimal {
    /// Cost of the best set.
    pub best_cost: f64,
    /// Largest cost that counts as near-optimal.
    pub threshold: f64,
    /// Number of sets up to the threshold. A single one says nothing about the spread.
    pub n_near_optimal: usize,
    /// Number of sets given.
    pub n_sets: usize,
    /// Spread of each parameter, in the order of the box.
    pub parameters: Vec<ParameterSpread>,
}

/// Finds the near-optimal sets and the spread of their parameters, which are in their units.
///
/// The members of a converged population do not sample the near-optimal region, because they have
/// closed in on one set. Results of several seeds, or all points that an optimiser has evaluated,
/// do.
///
/// # Errors
/// [`IdentifiabilityError`] if the box or a set is invalid, or no cost is finite.
pub fn near_optimal(
    sets: &[(Vec<f64>, f64)],
    bounds: &[Interval],
    settings: &Settings,
) -> Result<NearOptimal, IdentifiabilityError> {
    Interval::validate(bounds)?;
    settings.validate()?;
    if let Some((set, _)) = sets.iter().find(|(set, _)| set.len() != bounds.len()) {
        return Err(IdentifiabilityError::Dimension {
            n_parameters: set.len(),
            n_bounds: bounds.len(),
        });
    }
    let best = sets
        .iter()
        .filter(|s| s.1.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let (best, best_cost) = best
        .map(|(set, cost)| (set, *cost))
        .ok_or(IdentifiabilityError::NoBest)?;
    let threshold = settings.threshold(best_cost);
    let near: Vec<&Vec<f64>> = sets
        .iter()
        .filter(|s| s.1 <= threshold)
        .map(|(set, _)| set)
        .collect();
    let spread = |(p, interval): (usize, &Interval)| {
        let values: Vec<f64> = near.iter().map(|set| set[p]).collect();
        let minimum = values.iter().copied().fold(f64::INFINITY, f64::min);
        let maximum = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        ParameterSpread {
            best: best[p],
            minimum,
            maximum,
            mean: mean(&values),
            standard_deviation: (values.len() > 1).then(|| standard_deviation(&values)),
            share: if interval.width() > 0.0 {
                (maximum - minimum) / interval.width()
            } else {
                0.0
            },
            bound: bound_of(best[p], *interval),
            mark: mark(
                best[p],
                Interval::new(minimum, maximum),
                *interval,
                settings,
            ),
        }
    };
    Ok(NearOptimal {
        best_cost,
        threshold,
        n_near_optimal: near.len(),
        n_sets: sets.len(),
        parameters: bounds.iter().enumerate().map(spread).collect(),
    })
}
