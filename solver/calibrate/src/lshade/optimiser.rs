//! State machine of L-SHADE: its batches, its updates and its end.

use super::memory::{Memory, Success};
use crate::polish::{LocalSearch, Polish};
use crate::population::{PopulationError, check, scale, unit_guesses};
use crate::random::{Purpose, generator};
use crate::statistics::{mean, population_standard_deviation};
use crate::storage::worst_if_not_finite;
use crate::{Interval, latin_hypercube};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Number of members at the end.
const FEWEST_MEMBERS: usize = 4;

/// Settings of L-SHADE; defaults are the source's except for budget, tolerance and polish.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Members of the first population for each parameter whose interval has a width.
    pub popsize: usize,
    /// Share of the best members towards which mutants move, dimensionless.
    pub best_share: f64,
    /// Size of the archive of replaced members, per member.
    pub archive_rate: f64,
    /// Number of cells of the success history.
    pub n_memory: usize,
    /// Evaluations over which the population shrinks, and after which no generation starts.
    pub max_evaluations: usize,
    /// The population has converged if the standard deviation of the costs is at most this fraction
    /// of the magnitude of their mean, dimensionless.
    pub tol: f64,
    /// Added to that threshold, in the cost's unit.
    pub atol: f64,
    /// Local searches at the end, one after the other.
    pub polish: Vec<LocalSearch>,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            popsize: 18,
            best_share: 0.11,
            archive_rate: 2.6,
            n_memory: 6,
            max_evaluations: 30_000,
            tol: 0.01,
            atol: 0.0,
            polish: vec![LocalSearch::default()],
            seed: 0,
        }
    }
}

impl Settings {
    fn validate(&self) -> Result<(), PopulationError> {
        check(
            "popsize",
            self.popsize as f64,
            self.popsize > 0,
            "at least 1",
        )?;
        check(
            "best_share",
            self.best_share,
            self.best_share > 0.0 && self.best_share <= 1.0,
            "above 0 and at most 1",
        )?;
        check(
            "archive_rate",
            self.archive_rate,
            (0.0..=100.0).contains(&self.archive_rate),
            "from 0 to 100",
        )?;
        check(
            "n_memory",
            self.n_memory as f64,
            self.n_memory > 0,
            "at least 1",
        )?;
        check(
            "max_evaluations",
            self.max_evaluations as f64,
            self.max_evaluations > 0,
            "at least 1",
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
        )
    }
}

/// Stage of an optimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// [`LShade::ask`] returns the first population.
    FirstPopulation,
    /// [`LShade::ask`] returns the candidates of a generation.
    Evolution,
    /// A local search polishes the best member.
    Polish,
    /// The optimisation has ended, and no more points are requested.
    Ended,
}

/// L-SHADE; serialise it after any [`LShade::tell`] to continue from there bit for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LShade {
    settings: Settings,
    bounds: Vec<Interval>,
    /// Members in unit coordinates; the best one is first once all are evaluated.
    population: Vec<Vec<f64>>,
    #[serde(with = "crate::storage::costs")]
    costs: Vec<f64>,
    archive: Vec<Vec<f64>>,
    memory: Memory,
    n_first: usize,
    stage: Stage,
    /// Generation requested next, counted from 1; 0 is the first population.
    generation: usize,
    n_evaluations: usize,
    converged: bool,
    polish: Option<Polish>,
}

/// A candidate with the scale and rate that made it.
struct Trial {
    point: Vec<f64>,
    scale: f64,
    rate: f64,
}

impl LShade {
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
        let n_free = bounds.iter().filter(|b| b.width() > 0.0).count().max(1);
        let n_first = (settings.popsize * n_free).max(FEWEST_MEMBERS);
        let mut population = latin_hypercube::unit(n_first, bounds.len(), settings.seed);
        for (member, guess) in population
            .iter_mut()
            .zip(unit_guesses(guesses, bounds, n_first)?)
        {
            *member = guess;
        }
        Ok(Self {
            bounds: bounds.to_vec(),
            costs: vec![f64::INFINITY; n_first],
            population,
            archive: Vec::new(),
            memory: Memory::new(settings.n_memory),
            n_first,
            stage: Stage::FirstPopulation,
            generation: 0,
            n_evaluations: 0,
            converged: false,
            polish: None,
            settings,
        })
    }

    /// The points to evaluate next, in the parameters' units and inside the box; empty at the end.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        match self.stage {
            Stage::FirstPopulation => self
                .population
                .iter()
                .map(|m| scale(m, &self.bounds))
                .collect(),
            Stage::Evolution => self
                .trials()
                .iter()
                .map(|t| scale(&t.point, &self.bounds))
                .collect(),
            Stage::Polish => self.polish.as_ref().map_or_else(Vec::new, Polish::ask),
            Stage::Ended => Vec::new(),
        }
    }

    /// Takes the costs of the points that [`Self::ask`] returned, in the same order. Costs that are
    /// not finite count as infinite.
    ///
    /// # Errors
    /// [`PopulationError`] if the number of costs differs or the optimisation has ended.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), PopulationError> {
        match self.stage {
            Stage::Ended => return Err(PopulationError::Ended),
            Stage::Polish => return self.tell_polish(costs),
            Stage::FirstPopulation | Stage::Evolution => {}
        }
        if costs.len() != self.population.len() {
            return Err(PopulationError::Costs {
                n_costs: costs.len(),
                n_points: self.population.len(),
            });
        }
        self.n_evaluations += costs.len();
        let costs: Vec<f64> = costs.iter().copied().map(worst_if_not_finite).collect();
        if self.stage == Stage::FirstPopulation {
            self.costs = costs;
            self.stage = Stage::Evolution;
        } else {
            self.select(&costs);
        }
        self.sort_and_shrink();
        self.generation += 1;
        let finite = self.costs.iter().all(|c| c.is_finite());
        let bound = self.settings.atol + self.settings.tol * mean(&self.costs).abs();
        self.converged =
            finite && self.generation > 1 && population_standard_deviation(&self.costs) <= bound;
        if self.converged || self.n_evaluations >= self.settings.max_evaluations {
            self.begin_polish()?;
        }
        Ok(())
    }

    fn select(&mut self, costs: &[f64]) {
        let mut successes = Vec::new();
        for (i, (trial, cost)) in self.trials().into_iter().zip(costs).enumerate() {
            if *cost > self.costs[i] || cost.is_infinite() {
                continue;
            }
            let parent = std::mem::replace(&mut self.population[i], trial.point);
            let fall = self.costs[i] - cost;
            self.costs[i] = *cost;
            if fall > 0.0 {
                self.archive.push(parent);
                successes.push(Success {
                    scale: trial.scale,
                    rate: trial.rate,
                    fall,
                });
            }
        }
        self.memory.learn(&successes);
    }

    /// Sorts members by cost and shrinks the population and the archive with the number of
    /// evaluations.
    fn sort_and_shrink(&mut self) {
        let mut order: Vec<usize> = (0..self.costs.len()).collect();
        order.sort_by(|a, b| self.costs[*a].total_cmp(&self.costs[*b]));
        let used = (self.n_evaluations as f64 / self.settings.max_evaluations as f64).min(1.0);
        let wanted = self.n_first as f64 - used * (self.n_first - FEWEST_MEMBERS) as f64;
        order.truncate((wanted.round() as usize).clamp(FEWEST_MEMBERS, self.population.len()));
        self.population = order
            .iter()
            .map(|i| std::mem::take(&mut self.population[*i]))
            .collect();
        self.costs = order.iter().map(|i| self.costs[*i]).collect();
        let n_archive =
            (self.settings.archive_rate * self.population.len() as f64).round() as usize;
        let mut random = generator(
            self.settings.seed,
            Purpose::Archive,
            [self.generation as u64, 0],
        );
        while self.archive.len() > n_archive {
            self.archive
                .swap_remove(random.random_range(0..self.archive.len()));
        }
    }

    /// Candidates of a generation. They follow from the state and need not be stored.
    fn trials(&self) -> Vec<Trial> {
        (0..self.population.len()).map(|i| self.trial(i)).collect()
    }

    fn trial(&self, candidate: usize) -> Trial {
        let position = [self.generation as u64, candidate as u64];
        let mut random = generator(self.settings.seed, Purpose::AdaptiveTrials, position);
        let (n, parent) = (self.population.len(), &self.population[candidate]);
        let (scale, rate) = self.memory.draw(&mut random);
        let n_best = ((self.settings.best_share * n as f64).round() as usize).clamp(2, n);
        let best = &self.population[random.random_range(0..n_best)];
        let mut other = |n: usize, taken: &[usize]| loop {
            let i = random.random_range(0..n);
            if !taken.contains(&i) {
                return i;
            }
        };
        let first = other(n, &[candidate]);
        let second = other(n + self.archive.len(), &[candidate, first]);
        let a = &self.population[first];
        let b = if second < n {
            &self.population[second]
        } else {
            &self.archive[second - n]
        };
        let from_mutant = random.random_range(0..parent.len());
        let mut point = parent.clone();
        for d in 0..point.len() {
            if random.random::<f64>() < rate || d == from_mutant {
                let value = parent[d] + scale * (best[d] - parent[d]) + scale * (a[d] - b[d]);
                // A coordinate that would cross a bound goes half way to it.
                point[d] = match value {
                    v if v < 0.0 => 0.5 * parent[d],
                    v if v > 1.0 => 0.5 * (1.0 + parent[d]),
                    v => v,
                };
            }
        }
        Trial { point, scale, rate }
    }

    fn begin_polish(&mut self) -> Result<(), PopulationError> {
        let start = scale(&self.population[0], &self.bounds);
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

    /// Stage to which the next batch belongs.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Whether the optimisation has ended.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.stage == Stage::Ended
    }

    /// Whether the generations ended by the tolerance rather than by the budget.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.converged
    }

    /// Number of generations so far, the first population included.
    #[must_use]
    pub fn n_generations(&self) -> usize {
        self.generation
    }

    /// Number of evaluations so far, the polish included.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        self.n_evaluations + self.polish.as_ref().map_or(0, Polish::n_evaluations)
    }

    /// Best parameters so far, in their units, and their cost.
    #[must_use]
    pub fn best(&self) -> (Vec<f64>, f64) {
        match self.polish.as_ref().and_then(Polish::gain) {
            Some((point, cost)) => (point.to_vec(), cost),
            None => (scale(&self.population[0], &self.bounds), self.costs[0]),
        }
    }

    /// All members in their units and their costs, the best one first.
    #[must_use]
    pub fn members(&self) -> (Vec<Vec<f64>>, &[f64]) {
        (
            self.population
                .iter()
                .map(|m| scale(m, &self.bounds))
                .collect(),
            &self.costs,
        )
    }
}
