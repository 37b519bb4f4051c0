//! State machine of CMA-ES: its batches, its restarts and its end.

use super::distribution::{Axes, Distribution, Rates};
use crate::population::{PopulationError, check, scale, unit_guesses};
use crate::random::{Purpose, generator};
use crate::storage::worst_if_not_finite;
use crate::{Interval, normal};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Ratio of axes at which a run ends.
const WORST_CONDITION: f64 = 1e7;

/// Settings of the strategy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Number of candidates per generation of the first run; 4 + ⌊3 ln D⌋ if `None`. Each restart
    /// doubles it.
    pub n_candidates: Option<usize>,
    /// Standard deviation at the start of each run, as a fraction of the intervals.
    pub first_deviation: f64,
    /// A run ends when its best costs have changed by at most this fraction over many generations,
    /// dimensionless.
    pub tol: f64,
    /// Added to that threshold, in the cost's unit.
    pub atol: f64,
    /// A run ends when no coordinate's standard deviation exceeds this fraction of its interval.
    pub step_tolerance: f64,
    /// The optimisation ends when this number of runs has ended at the best cost (to a thousandth).
    pub n_agreeing_runs: usize,
    /// No generation starts after this number of evaluations.
    pub max_evaluations: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            n_candidates: None,
            first_deviation: 0.3,
            tol: 1e-9,
            atol: 1e-12,
            step_tolerance: 1e-9,
            n_agreeing_runs: 2,
            max_evaluations: 30_000,
            seed: 0,
        }
    }
}

impl Settings {
    fn validate(&self) -> Result<(), PopulationError> {
        let n_candidates = self.n_candidates.unwrap_or(4);
        let deviation = self.first_deviation;
        check(
            "n_candidates",
            n_candidates as f64,
            n_candidates >= 4,
            "at least 4",
        )?;
        check(
            "first_deviation",
            deviation,
            deviation > 0.0 && deviation <= 1.0,
            "above 0 and at most 1",
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
            "step_tolerance",
            self.step_tolerance,
            self.step_tolerance > 0.0,
            "above 0",
        )?;
        check(
            "n_agreeing_runs",
            self.n_agreeing_runs as f64,
            self.n_agreeing_runs > 0,
            "at least 1",
        )?;
        check(
            "max_evaluations",
            self.max_evaluations as f64,
            self.max_evaluations > 0,
            "at least 1",
        )
    }
}

/// Reason for the end of the optimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// Enough runs ended at the best cost.
    Agreement,
    /// The largest number of evaluations was reached.
    Evaluations,
}

/// CMA-ES with restarts. The state can be serialised after any [`CmaEs::tell`] and continues bit
/// for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CmaEs {
    settings: Settings,
    bounds: Vec<Interval>,
    /// Indices of the parameters whose intervals have a width.
    free: Vec<usize>,
    /// Starts of the first runs, in unit coordinates.
    guesses: Vec<Vec<f64>>,
    distribution: Distribution,
    run: usize,
    /// Generation within the run.
    generation: usize,
    /// Best cost of each of the last generations of the run.
    #[serde(with = "crate::storage::costs")]
    history: Vec<f64>,
    /// Best cost of each run that has ended.
    #[serde(with = "crate::storage::costs")]
    run_costs: Vec<f64>,
    #[serde(with = "crate::storage::cost")]
    run_best: f64,
    best: Vec<f64>,
    #[serde(with = "crate::storage::cost")]
    best_cost: f64,
    n_evaluations: usize,
    ending: Option<StopReason>,
}

impl CmaEs {
    /// Starts at the first guess, or at the middle of the box. Further guesses, shape (any, D), are
    /// the starts of the restarts.
    ///
    /// # Errors
    /// [`PopulationError`] if the box, a setting or a guess is invalid.
    pub fn new(
        bounds: &[Interval],
        guesses: &[Vec<f64>],
        settings: Settings,
    ) -> Result<Self, PopulationError> {
        Interval::validate(bounds)?;
        settings.validate()?;
        let mut free: Vec<usize> = (0..bounds.len())
            .filter(|i| bounds[*i].width() > 0.0)
            .collect();
        if free.is_empty() {
            // Nothing can move: the first coordinate is sampled without an effect until the costs
            // agree.
            free.push(0);
        }
        let guesses: Vec<Vec<f64>> = unit_guesses(guesses, bounds, usize::MAX)?
            .into_iter()
            .map(|guess| free.iter().map(|i| guess[*i]).collect())
            .collect();
        let mean = guesses
            .first()
            .cloned()
            .unwrap_or_else(|| vec![0.5; free.len()]);
        Ok(Self {
            distribution: Distribution::new(mean.clone(), settings.first_deviation),
            settings,
            bounds: bounds.to_vec(),
            free,
            guesses,
            run: 0,
            generation: 0,
            history: Vec::new(),
            run_costs: Vec::new(),
            run_best: f64::INFINITY,
            best: mean,
            best_cost: f64::INFINITY,
            n_evaluations: 0,
            ending: None,
        })
    }

    /// Number of candidates per generation of the current run.
    fn n_candidates(&self) -> usize {
        let first = self
            .settings
            .n_candidates
            .unwrap_or(4 + (3.0 * (self.free.len() as f64).ln()) as usize);
        first << self.run.min(10)
    }

    /// Steps of a generation, in units of sigma.
    fn steps(&self, axes: &Axes) -> Vec<Vec<f64>> {
        let generation = ((self.run as u64) << 32) | self.generation as u64;
        (0..self.n_candidates())
            .map(|candidate| {
                let position = [generation, candidate as u64];
                let mut random = generator(self.settings.seed, Purpose::Deviates, position);
                let normal: Vec<f64> = (0..self.free.len())
                    .map(|_| normal::quantile(random.random_range(1e-15..1.0 - 1e-15)))
                    .collect();
                axes.step(&normal)
            })
            .collect()
    }

    /// Position that a step leads to, which may lie outside the box.
    fn sample(&self, step: &[f64]) -> Vec<f64> {
        self.distribution
            .mean
            .iter()
            .zip(step)
            .map(|(m, s)| m + self.distribution.sigma * s)
            .collect()
    }

    /// Point of the box at which a sample is evaluated, in the parameters' units.
    fn point(&self, sample: &[f64]) -> Vec<f64> {
        let mut unit = vec![0.5; self.bounds.len()];
        for (position, value) in self.free.iter().zip(sample) {
            unit[*position] = value.clamp(0.0, 1.0);
        }
        scale(&unit, &self.bounds)
    }

    /// The points to evaluate next, in the parameters' units and inside the box; empty at the end.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        if self.is_ended() {
            return Vec::new();
        }
        self.steps(&self.distribution.axes())
            .iter()
            .map(|step| self.point(&self.sample(step)))
            .collect()
    }

    /// Takes the costs of the points that [`Self::ask`] returned, in the same order. Costs that are
    /// not finite count as infinite.
    ///
    /// # Errors
    /// [`PopulationError`] if the number of costs differs or the optimisation has ended.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), PopulationError> {
        if self.is_ended() {
            return Err(PopulationError::Ended);
        }
        let n_points = self.n_candidates();
        if costs.len() != n_points {
            return Err(PopulationError::Costs {
                n_costs: costs.len(),
                n_points,
            });
        }
        self.n_evaluations += n_points;
        let costs: Vec<f64> = costs.iter().copied().map(worst_if_not_finite).collect();
        let axes = self.distribution.axes();
        let steps = self.steps(&axes);
        for (step, cost) in steps.iter().zip(&costs) {
            if *cost < self.best_cost {
                self.best = self
                    .sample(step)
                    .iter()
                    .map(|x| x.clamp(0.0, 1.0))
                    .collect();
                self.best_cost = *cost;
            }
        }
        let ranked = self.rank(steps, &costs);
        self.distribution
            .update(&ranked, &Rates::new(self.free.len(), n_points), &axes);
        let best = costs.iter().copied().fold(f64::INFINITY, f64::min);
        self.run_best = self.run_best.min(best);
        self.history.push(best);
        let n_remembered = 10 + 30 * self.free.len() / n_points;
        if self.history.len() > n_remembered {
            self.history.remove(0);
        }
        self.generation += 1;
        let run_ends = self.run_ends(n_remembered, &axes);
        if run_ends {
            self.run_costs.push(self.run_best);
        }
        let agreeing = self
            .run_costs
            .iter()
            .filter(|c| (**c - self.best_cost).abs() <= 1e-3 * self.best_cost.abs() + 1e-9)
            .count();
        if run_ends && agreeing >= self.settings.n_agreeing_runs {
            self.ending = Some(StopReason::Agreement);
        } else if self.n_evaluations >= self.settings.max_evaluations {
            self.ending = Some(StopReason::Evaluations);
        } else if run_ends {
            self.restart();
        }
        Ok(())
    }

    /// Orders steps from best to worst, by cost and by distance beyond the bounds.
    fn rank(&self, steps: Vec<Vec<f64>>, costs: &[f64]) -> Vec<Vec<f64>> {
        let mut finite: Vec<f64> = costs.iter().copied().filter(|c| c.is_finite()).collect();
        finite.sort_by(f64::total_cmp);
        let quartile = |share: f64| {
            finite
                .get((share * (finite.len() as f64 - 1.0)) as usize)
                .copied()
                .unwrap_or(0.0)
        };
        let weight = 2.0 * (quartile(0.75) - quartile(0.25)) / self.distribution.mean_variance();
        let beyond = |step: &[f64]| {
            let square = |x: f64| (x - x.clamp(0.0, 1.0)).powi(2);
            self.sample(step).into_iter().map(square).sum::<f64>() / self.free.len() as f64
        };
        let mut ranked: Vec<(f64, Vec<f64>)> = steps
            .into_iter()
            .zip(costs)
            .map(|(step, cost)| (cost + weight * beyond(&step), step))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.into_iter().map(|(_, step)| step).collect()
    }

    fn run_ends(&self, n_remembered: usize, axes: &Axes) -> bool {
        let (low, high) = self
            .history
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| {
                (c.min(low), c.max(high))
            });
        let flat = self.history.len() >= n_remembered
            && (high - low <= self.settings.atol + self.settings.tol * low.abs()
                || low.is_infinite());
        flat || self.distribution.largest_deviation() <= self.settings.step_tolerance
            || axes.condition() > WORST_CONDITION
    }

    fn restart(&mut self) {
        self.run += 1;
        self.generation = 0;
        self.history.clear();
        self.run_best = f64::INFINITY;
        let mut random = generator(self.settings.seed, Purpose::Starts, [self.run as u64, 0]);
        let mean = match self.guesses.get(self.run) {
            Some(guess) => guess.clone(),
            None => (0..self.free.len()).map(|_| random.random()).collect(),
        };
        self.distribution = Distribution::new(mean, self.settings.first_deviation);
    }

    /// Whether the optimisation has ended.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.ending.is_some()
    }

    /// Reason for the end; `None` while the optimisation continues.
    #[must_use]
    pub fn ending(&self) -> Option<StopReason> {
        self.ending
    }

    /// Best cost of each run that has ended.
    #[must_use]
    pub fn run_costs(&self) -> &[f64] {
        &self.run_costs
    }

    /// Number of evaluations so far.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        self.n_evaluations
    }

    /// Best parameters so far, in their units, and their cost.
    #[must_use]
    pub fn best(&self) -> (Vec<f64>, f64) {
        (self.point(&self.best), self.best_cost)
    }
}
