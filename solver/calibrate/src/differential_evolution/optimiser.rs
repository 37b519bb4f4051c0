//! State machine of differential evolution: its batches, its updates and its end.

use super::{Settings, Updating};
use crate::polish::Polish;
use crate::population::{PopulationError, scale, unit_guesses};
use crate::random::{Purpose, generator};
use crate::statistics::{mean, population_standard_deviation};
use crate::storage::worst_if_not_finite;
use crate::{Interval, latin_hypercube};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Stage of an optimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// [`DifferentialEvolution::ask`] returns the first population.
    FirstPopulation,
    /// [`DifferentialEvolution::ask`] returns trials of a generation.
    Evolution,
    /// A local search polishes the best member.
    Polish,
    /// The optimisation has ended, and no more points are requested.
    Ended,
}

/// Reason for the end of the generations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// The spread of the costs fell below the tolerance.
    Converged,
    /// The largest number of generations was reached.
    Generations,
}

/// Result of an optimisation that has ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Best parameters, in their units.
    pub parameters: Vec<f64>,
    /// Cost of the best parameters; infinite if no evaluation succeeded.
    #[serde(with = "crate::storage::cost")]
    pub cost: f64,
    /// Reason for the end of the generations.
    pub ending: StopReason,
    /// Number of generations after the first population.
    pub n_generations: usize,
    /// Number of evaluations: members × (generations + 1) + (D + 1) × gradients of the polish.
    pub n_evaluations: usize,
    /// Number of evaluations of the polish.
    pub n_polish_evaluations: usize,
    /// Whether the polish found a lower cost; [`Self::parameters`] are then its result.
    pub polished: bool,
}

/// Differential evolution. The state can be serialised after any [`DifferentialEvolution::tell`]
/// and continues bit for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DifferentialEvolution {
    settings: Settings,
    bounds: Vec<Interval>,
    /// Members in unit coordinates, shape (members, D); the best one is first once all are
    /// evaluated.
    population: Vec<Vec<f64>>,
    #[serde(with = "crate::storage::costs")]
    costs: Vec<f64>,
    stage: Stage,
    /// Generation requested next, counted from 1; 0 is the first population.
    generation: usize,
    /// Member whose trial is requested next (immediate updating).
    candidate: usize,
    n_evaluations: usize,
    ending: Option<StopReason>,
    polish: Option<Polish>,
    /// Trials under way, kept so that they are computed once. They follow from the rest and are not
    /// stored.
    #[serde(skip)]
    pending: Pending,
}

/// Cached trials. They follow from the rest of the state, so that two states with and without them
/// are equal.
#[derive(Debug, Clone, Default)]
struct Pending(Vec<Vec<f64>>);

impl PartialEq for Pending {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl DifferentialEvolution {
    /// Starts from a Latin hypercube in the box. Guesses, shape (any, D), are clamped to the box
    /// and replace its first members.
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
        let n_members = settings.n_members(bounds);
        let mut population = latin_hypercube::unit(n_members, bounds.len(), settings.seed);
        for (member, guess) in population
            .iter_mut()
            .zip(unit_guesses(guesses, bounds, n_members)?)
        {
            *member = guess;
        }
        Ok(Self {
            settings,
            bounds: bounds.to_vec(),
            costs: vec![f64::INFINITY; n_members],
            population,
            stage: Stage::FirstPopulation,
            generation: 0,
            candidate: 0,
            n_evaluations: 0,
            ending: None,
            polish: None,
            pending: Pending::default(),
        })
    }

    /// Points to evaluate next, each of length D, in the parameters' units and inside the box;
    /// empty at the end.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        match self.stage {
            Stage::Polish => self.polish.as_ref().map_or_else(Vec::new, Polish::ask),
            _ if self.pending.0.is_empty() => self
                .make_trials()
                .iter()
                .map(|trial| self.scale(trial))
                .collect(),
            _ => self
                .pending
                .0
                .iter()
                .map(|trial| self.scale(trial))
                .collect(),
        }
    }

    /// Takes the costs of the points that [`Self::ask`] returned, in the same order. Costs that are
    /// not finite count as infinite.
    ///
    /// # Errors
    /// [`PopulationError`] if the number of costs differs or the optimisation has ended.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), PopulationError> {
        if self.stage == Stage::Polish {
            return self.tell_polish(costs);
        }
        self.tell_trials(costs)?;
        if self.stage == Stage::Evolution {
            self.pending = Pending(self.make_trials());
        }
        Ok(())
    }

    fn tell_trials(&mut self, costs: &[f64]) -> Result<(), PopulationError> {
        let n_points = match (self.stage, self.settings.updating) {
            (Stage::Ended, _) => return Err(PopulationError::Ended),
            (Stage::Evolution, Updating::Immediate) => 1,
            _ => self.population.len(),
        };
        if costs.len() != n_points {
            return Err(PopulationError::Costs {
                n_costs: costs.len(),
                n_points,
            });
        }
        self.n_evaluations += n_points;
        let costs: Vec<f64> = costs.iter().copied().map(worst_if_not_finite).collect();
        match (self.stage, self.settings.updating) {
            (Stage::FirstPopulation, _) => {
                self.costs = costs;
                self.promote_best();
                self.stage = Stage::Evolution;
                self.generation = 1;
                Ok(())
            }
            (_, Updating::Deferred) => {
                let trials = self.take_trials();
                for (i, (trial, cost)) in trials.into_iter().zip(costs).enumerate() {
                    self.select(i, trial, cost);
                }
                self.promote_best();
                self.end_generation()
            }
            (_, Updating::Immediate) => {
                let trial = self.take_trials().swap_remove(0);
                if self.select(self.candidate, trial, costs[0]) && costs[0] <= self.costs[0] {
                    self.promote_best();
                }
                self.candidate += 1;
                if self.candidate < self.population.len() {
                    return Ok(());
                }
                self.candidate = 0;
                self.end_generation()
            }
        }
    }

    /// Stage to which the next batch belongs.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Number of generations completed after the first population.
    #[must_use]
    pub fn n_generations(&self) -> usize {
        match self.stage {
            Stage::FirstPopulation | Stage::Evolution => self.generation.saturating_sub(1),
            Stage::Polish | Stage::Ended => self.generation,
        }
    }

    /// Number of evaluations so far, the polish included.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        self.n_evaluations + self.n_polish_evaluations()
    }

    /// Standard deviation of the costs over the magnitude of their mean, dimensionless. The
    /// population has converged at `tol` or below.
    #[must_use]
    pub fn spread(&self) -> f64 {
        if self.costs.iter().any(|c| c.is_infinite()) {
            return f64::INFINITY;
        }
        population_standard_deviation(&self.costs) / (mean(&self.costs).abs() + f64::EPSILON)
    }

    /// Best parameters so far, in their units, and their cost.
    #[must_use]
    pub fn best(&self) -> (Vec<f64>, f64) {
        match self.polish.as_ref().and_then(Polish::gain) {
            Some((point, cost)) => (point.to_vec(), cost),
            None => (self.scale(&self.population[0]), self.costs[0]),
        }
    }

    /// All members in their units, shape (members, D), and their costs, the best one first.
    /// Near-optimal members show what the data determine.
    #[must_use]
    pub fn members(&self) -> (Vec<Vec<f64>>, &[f64]) {
        (
            self.population.iter().map(|m| self.scale(m)).collect(),
            &self.costs,
        )
    }

    /// Result, once the optimisation has ended.
    #[must_use]
    pub fn outcome(&self) -> Option<Outcome> {
        let ending = self.ending.filter(|_| self.stage == Stage::Ended)?;
        let (parameters, cost) = self.best();
        Some(Outcome {
            parameters,
            cost,
            ending,
            n_generations: self.generation,
            n_evaluations: self.n_evaluations(),
            n_polish_evaluations: self.n_polish_evaluations(),
            polished: self
                .polish
                .as_ref()
                .is_some_and(|polish| polish.gain().is_some()),
        })
    }

    fn n_polish_evaluations(&self) -> usize {
        self.polish.as_ref().map_or(0, Polish::n_evaluations)
    }

    fn scale(&self, member: &[f64]) -> Vec<f64> {
        scale(member, &self.bounds)
    }

    /// Takes the trials under way, or computes them again if the state was stored since they were
    /// requested.
    fn take_trials(&mut self) -> Vec<Vec<f64>> {
        if self.pending.0.is_empty() {
            self.make_trials()
        } else {
            std::mem::take(&mut self.pending.0)
        }
    }

    /// Points of the next batch, in unit coordinates.
    fn make_trials(&self) -> Vec<Vec<f64>> {
        match (self.stage, self.settings.updating) {
            (Stage::FirstPopulation, _) => self.population.clone(),
            (Stage::Evolution, Updating::Deferred) => {
                let scale = self.mutation_scale();
                (0..self.population.len())
                    .map(|i| self.trial(i, scale))
                    .collect()
            }
            (Stage::Evolution, Updating::Immediate) => {
                vec![self.trial(self.candidate, self.mutation_scale())]
            }
            (Stage::Polish | Stage::Ended, _) => Vec::new(),
        }
    }

    /// Mutation scale of the present generation.
    fn mutation_scale(&self) -> f64 {
        let [low, high] = self.settings.mutation;
        let u: f64 = generator(
            self.settings.seed,
            Purpose::Dither,
            [self.generation as u64, 0],
        )
        .random();
        low + (high - low) * u
    }

    /// Trial of one member by DE/best/1/bin.
    fn trial(&self, candidate: usize, scale: f64) -> Vec<f64> {
        let position = [self.generation as u64, candidate as u64];
        let mut rng = generator(self.settings.seed, Purpose::Trials, position);
        let (n, n_dimensions) = (self.population.len(), self.bounds.len());
        let mut other = |taken: &[usize]| loop {
            let i = rng.random_range(0..n);
            if !taken.contains(&i) {
                return i;
            }
        };
        let first = other(&[candidate]);
        let second = other(&[candidate, first]);
        let from_mutant = rng.random_range(0..n_dimensions);
        let (best, a, b) = (
            &self.population[0],
            &self.population[first],
            &self.population[second],
        );
        let mut trial = self.population[candidate].clone();
        for (d, value) in trial.iter_mut().enumerate() {
            let crossover = rng.random::<f64>() < self.settings.recombination;
            if crossover || d == from_mutant {
                *value = best[d] + scale * (a[d] - b[d]);
            }
            if !(0.0..=1.0).contains(value) {
                *value = rng.random();
            }
        }
        trial
    }

    /// Replaces a member by its trial if the trial's cost is not higher.
    fn select(&mut self, i: usize, trial: Vec<f64>, cost: f64) -> bool {
        let accepted = cost <= self.costs[i];
        if accepted {
            self.population[i] = trial;
            self.costs[i] = cost;
        }
        accepted
    }

    /// Exchanges the first member with the best one.
    fn promote_best(&mut self) {
        let mut best = 0;
        for (i, cost) in self.costs.iter().enumerate() {
            if *cost < self.costs[best] {
                best = i;
            }
        }
        self.population.swap(0, best);
        self.costs.swap(0, best);
    }

    fn is_converged(&self) -> bool {
        self.costs.iter().all(|c| c.is_finite())
            && population_standard_deviation(&self.costs)
                <= self.settings.atol + self.settings.tol * mean(&self.costs).abs()
    }

    fn end_generation(&mut self) -> Result<(), PopulationError> {
        self.ending = if self.is_converged() {
            Some(StopReason::Converged)
        } else if self.generation >= self.settings.maxiter {
            Some(StopReason::Generations)
        } else {
            None
        };
        if self.ending.is_none() {
            self.generation += 1;
            return Ok(());
        }
        let start = self.scale(&self.population[0]);
        self.polish = Polish::new(&start, self.costs[0], &self.bounds, &self.settings.polish)?;
        self.stage = if self.polish.is_some() {
            Stage::Polish
        } else {
            Stage::Ended
        };
        Ok(())
    }

    fn tell_polish(&mut self, costs: &[f64]) -> Result<(), PopulationError> {
        let Some(polish) = &mut self.polish else {
            return Err(PopulationError::Ended);
        };
        polish.tell(costs)?;
        if polish.is_ended() {
            self.stage = Stage::Ended;
        }
        Ok(())
    }
}
