//! What the data determine of fitted parameters: profiles of the cost, and the spread of near-optimal sets.
//!
//! A set of parameters is near-optimal when its cost is below a threshold above the best one's. [`Profile`] finds, for
//! each parameter, the values with which a near-optimal set exists, all others fitted anew (Raue et al. 2009,
//! Bioinformatics 25:1923); [`near_optimal`] looks at sets that are there already, such as the results of several seeds.
//! Both say which parameters are determined, which are sloppy, and which the data press against a bound.

mod profile;
mod spread;
#[cfg(test)]
mod tests;

use crate::lbfgsb::LbfgsbError;
use crate::{Interval, IntervalError, lbfgsb};
pub use profile::{Profile, ProfileEnd, ProfiledParameter};
use serde::{Deserialize, Serialize};
pub use spread::{NearOptimal, ParameterSpread, near_optimal};

/// What is near-optimal, what is determined, and how hard the profiles try.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Near-optimal costs lie at most this above the best, in the cost's unit, or:
    pub absolute_rise: f64,
    /// at most this fraction of the best above it, dimensionless; the larger of the two counts.
    pub relative_rise: f64,
    /// A parameter is determined when its near-optimal values fill at most this fraction of its interval.
    pub determined_fraction: f64,
    /// First step of a profile, as a fraction of the interval; each next one is twice as long.
    pub first_step: f64,
    /// A profile's end is known to this fraction of the interval.
    pub precision: f64,
    /// Refitting the others at one value of a profile.
    pub refit: lbfgsb::Settings,
}

impl Default for Settings {
    /// For costs that sum squared relative differences: 0.01 is one biomarker off by 10 %.
    fn default() -> Self {
        Self {
            absolute_rise: 0.01,
            relative_rise: 0.1,
            determined_fraction: 0.2,
            first_step: 0.05,
            precision: 0.02,
            refit: lbfgsb::Settings {
                step: lbfgsb::DifferenceStep::OfWidth(1e-4),
                max_iterations: 50,
                max_evaluations: 500,
                cost_tolerance: 1e-6,
                ..lbfgsb::Settings::default()
            },
        }
    }
}

impl Settings {
    /// Largest near-optimal cost above a best one.
    #[must_use]
    pub fn threshold(&self, best_cost: f64) -> f64 {
        best_cost + self.absolute_rise.max(self.relative_rise * best_cost.abs())
    }

    fn validate(&self) -> Result<(), IdentifiabilityError> {
        let checks = [
            (
                "absolute_rise",
                self.absolute_rise,
                self.absolute_rise >= 0.0 && self.absolute_rise.is_finite(),
            ),
            (
                "relative_rise",
                self.relative_rise,
                self.relative_rise >= 0.0 && self.relative_rise.is_finite(),
            ),
            (
                "determined_fraction",
                self.determined_fraction,
                (0.0..=1.0).contains(&self.determined_fraction),
            ),
            (
                "first_step",
                self.first_step,
                self.first_step > 0.0 && self.first_step <= 1.0,
            ),
            (
                "precision",
                self.precision,
                self.precision > 0.0 && self.precision <= 1.0,
            ),
        ];
        match checks.into_iter().find(|(_, _, ok)| !ok) {
            Some((key, value, _)) => Err(IdentifiabilityError::Setting { key, value }),
            None => Ok(()),
        }
    }
}

/// One of an interval's ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bound {
    /// The smallest value.
    Lower,
    /// The largest value.
    Upper,
}

/// What the data say of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mark {
    /// Near-optimal values fill a small part of the interval, away from its ends.
    Determined,
    /// Near-optimal values fill much of the interval.
    Sloppy,
    /// Near-optimal values fill a small part of the interval, and the best one is its end: the data would have it beyond.
    AtBound,
}

/// A best value this close to a bound, as a fraction of the interval, sits on it.
const ON_BOUND: f64 = 1e-3;

/// Which bound a value sits on.
fn bound_of(value: f64, interval: Interval) -> Option<Bound> {
    let near = ON_BOUND * interval.width();
    match value {
        v if v - interval.lower <= near => Some(Bound::Lower),
        v if interval.upper - v <= near => Some(Bound::Upper),
        _ => None,
    }
}

fn mark(best: f64, near_optimal: Interval, interval: Interval, settings: &Settings) -> Mark {
    if near_optimal.width() > settings.determined_fraction * interval.width() {
        Mark::Sloppy
    } else if bound_of(best, interval).is_some() {
        Mark::AtBound
    } else {
        Mark::Determined
    }
}

/// What is wrong with what was to be looked at.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentifiabilityError {
    /// The box makes no sense.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// A setting that makes no sense.
    #[error("setting {key} is {value}, but must be a fraction or, for a rise, not negative")]
    Setting {
        /// Key of the setting.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// Parameters of another dimension than the box.
    #[error("a set has {n_parameters} parameters, but the box has {n_bounds}")]
    Dimension {
        /// Parameters of the set.
        n_parameters: usize,
        /// Number of intervals.
        n_bounds: usize,
    },
    /// No set, or a best cost that is not finite.
    #[error("there is no set with a finite cost to begin with")]
    NoBest,
    /// Another number of costs than points were asked for.
    #[error("{n_costs} costs were told for {n_points} points")]
    Costs {
        /// Costs told.
        n_costs: usize,
        /// Points asked.
        n_points: usize,
    },
    /// A refit refused its start or its costs.
    #[error("the refit of the other parameters failed")]
    Refit(#[from] LbfgsbError),
}
