//! What a user may set of the fixed point.

use super::{Bounds, FixedPointError, Parameter, Parameters, Weights};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// When the loop is content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// At the first iteration whose cost is within the tolerance, as in the paper.
    #[default]
    FirstConverged,
    /// Within the tolerance, and another rule's next parameters promise little: see [`super::content`].
    NoPromise,
    /// Goes on to the limit (or stagnation) and takes the best iteration.
    BestOfLimit,
}

/// Settings of the fixed point; defaults are the paper's where it prints one, else docs/models.md's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Cost at or below which an iteration is converged, dimensionless.
    pub tolerance: f64,
    /// Exponent of the updates' ratios, in (0, 1]: 1 is the paper's update, smaller is more careful.
    pub damping: f64,
    /// Largest number of iterations under these settings.
    pub max_iterations: usize,
    /// So many iterations in a row that do not lower the best cost enough end the loop.
    pub stagnation_iterations: usize,
    /// What counts as enough: relative fall of the best cost, dimensionless.
    pub stagnation_fraction: f64,
    /// Intervals that differ from [`Bounds::default_of`].
    pub bounds: BTreeMap<Parameter, Bounds>,
    /// Parameters that keep their value.
    pub frozen: BTreeSet<Parameter>,
    /// When the loop is content.
    pub stop: Stop,
    /// By which the best iteration is chosen, among those within the tolerance where there are any.
    pub weights: Weights,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            tolerance: 0.1,
            damping: 1.0,
            max_iterations: 10,
            stagnation_iterations: 3,
            stagnation_fraction: 0.05,
            bounds: BTreeMap::new(),
            frozen: BTreeSet::new(),
            stop: Stop::default(),
            weights: Weights::default(),
        }
    }
}

impl Settings {
    /// The interval of a parameter.
    #[must_use]
    pub fn bounds_of(&self, parameter: Parameter) -> Bounds {
        self.bounds
            .get(&parameter)
            .copied()
            .unwrap_or_else(|| Bounds::default_of(parameter))
    }

    /// Whether all parameters that may move lie within their bounds.
    #[must_use]
    pub fn admits(&self, parameters: &Parameters) -> bool {
        super::PARAMETERS
            .into_iter()
            .filter(|p| !self.frozen.contains(p))
            .all(|p| self.bounds_of(p).contains(parameters.get(p)))
    }

    /// Parameters moved into their bounds; frozen ones keep their value.
    #[must_use]
    pub fn clamp(&self, parameters: &Parameters) -> Parameters {
        let mut inside = *parameters;
        for p in super::PARAMETERS
            .into_iter()
            .filter(|p| !self.frozen.contains(p))
        {
            let bounds = self.bounds_of(p);
            inside.set(p, parameters.get(p).clamp(bounds.lower, bounds.upper));
        }
        inside
    }

    /// Looks for values that make no sense.
    ///
    /// # Errors
    /// [`FixedPointError::Setting`] or [`FixedPointError::Bounds`] naming the setting, its value and what it must be.
    pub fn validate(&self) -> Result<(), FixedPointError> {
        let setting = |key, value: f64, ok: bool, expected| {
            if ok {
                Ok(())
            } else {
                Err(FixedPointError::Setting {
                    key,
                    value,
                    expected,
                })
            }
        };
        setting(
            "tolerance",
            self.tolerance,
            self.tolerance > 0.0 && self.tolerance.is_finite(),
            "positive",
        )?;
        setting(
            "damping",
            self.damping,
            self.damping > 0.0 && self.damping <= 1.0,
            "above 0 and at most 1",
        )?;
        setting(
            "max_iterations",
            self.max_iterations as f64,
            self.max_iterations > 0,
            "at least 1",
        )?;
        let n = self.stagnation_iterations;
        setting("stagnation_iterations", n as f64, n > 0, "at least 1")?;
        let f = self.stagnation_fraction;
        setting(
            "stagnation_fraction",
            f,
            (0.0..1.0).contains(&f),
            "at least 0 and below 1",
        )?;
        for (parameter, b) in &self.bounds {
            if !(b.lower > 0.0 && b.lower <= b.upper && b.upper.is_finite()) {
                return Err(FixedPointError::Bounds {
                    parameter: *parameter,
                    lower: b.lower,
                    upper: b.upper,
                });
            }
        }
        Ok(())
    }
}
