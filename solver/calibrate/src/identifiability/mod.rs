//! Identifiability of fitted parameters: profiles of the cost, and the spread of near-optimal sets.
//!
//! A set of parameters is near-optimal when its cost exceeds the best cost by less than a
//! threshold. [`Profile`] finds, for each parameter, the values at which a near-optimal set exists
//! after all other parameters are fitted again (Raue et al. 2009, Bioinformatics 25:1923).
//! [`near_optimal`] examines existing sets, such as the results of several seeds. Both report which
//! parameters are determined, which are sloppy, and which the data press against a bound.

mod profile;
mod spread;
#[cfg(test)]
mod tests;

use crate::lbfgsb::LbfgsbError;
use crate::{Interval, IntervalError, lbfgsb};
pub use profile::{Profile, ProfileEnd, ProfiledParameter};
use serde::{Deserialize, Serialize};
pub use spread::{NearOptimal, ParameterSpread, near_optimal};

/// Thresholds for near-optimal sets and determined parameters, and the effort of the profiles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Largest rise of a near-optimal cost above the best cost, in the cost's unit. The larger of
    /// this and [`Self::relative_rise`] counts.
    pub absolute_rise: f64,
    /// Largest rise of a near-optimal cost, as a fraction of the best cost, dimensionless.
    pub relative_rise: f64,
    /// A parameter is determined if its near-optimal values fill at most this fraction of its
    /// interval.
    pub determined_fraction: f64,
    /// First step of a profile, as a fraction of the interval; each further step is twice as long.
    pub first_step: f64,
    /// Precision of a profile's end, as a fraction of the interval.
    pub precision: f64,
    /// Settings of the refit of the other parameters at one value of a profile.
    pub refit: lbfgsb::Settings,
}

impl Default for Settings {
    /// Suits costs that sum squared relative differences: 0.01 is one biomarker off by 10 %.
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
    /// Largest cost that counts as near-optimal, given the best cost.
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
    /// End of the smallest value.
    Lower,
    /// End of the largest value.
    Upper,
}

/// Extent to which the data determine a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mark {
    /// Near-optimal values fill a small part of the interval, away from its ends.
    Determined,
    /// Near-optimal values fill much of the interval.
    Sloppy,
    /// Near-optimal values fill a small part of the interval and the best one lies at an end of it:
    /// the data would place the parameter beyond the bound.
    AtBound,
}

/// A best value within this distance of a bound, as a fraction of the interval, counts as on it.
const ON_BOUND: f64 = 1e-3;

/// The bound that a value lies on, if any.
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

/// Invalid input to an identifiability analysis.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentifiabilityError {
    /// The box is empty, or an interval is not finite and in order.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// A setting outside its range.
    #[error("setting {key} is {value}, but must be a fraction or, for a rise, not negative")]
    Setting {
        /// Key of the setting.
        key: &'static str,
        /// Value that was given.
        value: f64,
    },
    /// A set with another number of parameters than the box.
    #[error("a set has {n_parameters} parameters, but the box has {n_bounds}")]
    Dimension {
        /// Number of parameters of the set.
        n_parameters: usize,
        /// Number of intervals of the box.
        n_bounds: usize,
    },
    /// No set was given, or the best cost is not finite.
    #[error("there is no set with a finite cost to begin with")]
    NoBest,
    /// The number of costs differs from the number of points requested.
    #[error("{n_costs} costs were given for {n_points} points")]
    Costs {
        /// Number of costs given.
        n_costs: usize,
        /// Number of points requested.
        n_points: usize,
    },
    /// A refit rejected its start or its costs.
    #[error("the refit of the other parameters failed")]
    Refit(#[from] LbfgsbError),
}
