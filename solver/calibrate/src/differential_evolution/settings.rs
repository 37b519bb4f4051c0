//! Settings of differential evolution.

use crate::Interval;
use crate::polish::LocalSearch;
use crate::population::{PopulationError, check};
use cardiotwin_vocabulary::step2_settings::Updating;
use serde::{Deserialize, Serialize};

/// Settings of differential evolution; defaults are `SciPy`'s except for the updating.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Members of the population for each parameter whose interval has a width.
    pub popsize: usize,
    /// Interval from which the mutation scale is drawn once per generation, dimensionless.
    pub mutation: [f64; 2],
    /// Probability that a parameter comes from the mutant, dimensionless.
    pub recombination: f64,
    /// The population has converged if the standard deviation of the costs is at most this fraction
    /// of the magnitude of their mean, dimensionless.
    pub tol: f64,
    /// Added to that threshold, in the cost's unit.
    pub atol: f64,
    /// Largest number of generations after the first population.
    pub maxiter: usize,
    /// Time at which a better trial replaces its member.
    pub updating: Updating,
    /// Local searches at the end, one after the other.
    pub polish: Vec<LocalSearch>,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            popsize: 15,
            mutation: [0.5, 1.0],
            recombination: 0.7,
            tol: 0.01,
            atol: 0.0,
            maxiter: 1000,
            updating: Updating::default(),
            polish: vec![LocalSearch::default()],
            seed: 0,
        }
    }
}

impl Settings {
    /// Number of members for a box: `popsize` for each parameter with a width, and at least five.
    #[must_use]
    pub fn n_members(&self, bounds: &[Interval]) -> usize {
        let n_free = bounds.iter().filter(|b| b.width() > 0.0).count();
        (self.popsize * n_free.max(1)).max(5)
    }

    pub(super) fn validate(&self) -> Result<(), PopulationError> {
        let [low, high] = self.mutation;
        check(
            "popsize",
            self.popsize as f64,
            self.popsize > 0,
            "at least 1",
        )?;
        check(
            "mutation",
            low,
            (0.0..2.0).contains(&low),
            "at least 0 and below 2",
        )?;
        check(
            "mutation",
            high,
            high >= low && high < 2.0,
            "at least the lower one and below 2",
        )?;
        check(
            "recombination",
            self.recombination,
            (0.0..=1.0).contains(&self.recombination),
            "from 0 to 1",
        )?;
        check(
            "tol",
            self.tol,
            self.tol >= 0.0 && self.tol.is_finite(),
            "at least 0",
        )?;
        check(
            "atol",
            self.atol,
            self.atol >= 0.0 && self.atol.is_finite(),
            "at least 0",
        )?;
        check(
            "maxiter",
            self.maxiter as f64,
            self.maxiter > 0,
            "at least 1",
        )
    }
}
