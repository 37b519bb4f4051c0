//! Common interface of step 2's strategies.

use cardiotwin_calibrate::Interval;
use cardiotwin_calibrate::cma_es::{self, CmaEs};
use cardiotwin_calibrate::differential_evolution::{
    self, DifferentialEvolution, Stage, StopReason,
};
use cardiotwin_calibrate::lbfgsb::{self, DifferenceStep};
use cardiotwin_calibrate::polish::{Coordinates, LocalSearch};
use cardiotwin_calibrate::statistics::mean;
use cardiotwin_schemas::settings::{CellFitSettings, Strategy};

use crate::error::TaskError;

/// Stages of the polish: in the parameters' own units, then in shares of their intervals, and both
/// again, each with its finite-difference step (also a share of the interval). The cost has valleys
/// along directions that the targets do not determine. With longer steps, curvature dominates the
/// difference along these valleys instead of the slope.
const POLISH: [(Coordinates, f64); 4] = [
    (Coordinates::OwnUnits, 1e-5),
    (Coordinates::Shares, 1e-6),
    (Coordinates::OwnUnits, 1e-5),
    (Coordinates::Shares, 1e-6),
];
/// Gain below which a local search ends. Along the valley where Rice's two time constants and the
/// resting calcium compensate each other, the cost falls by 1e-5 from end to end. With 1e-8,
/// searches stop half-way, each at a different place.
const POLISH_GAIN: f64 = 1e-10;
/// Largest number of evaluations for CMA-ES, which plans with a budget.
const BUDGET: usize = 30_000;

/// One of the strategies.
#[derive(Debug)]
pub enum Optimiser {
    /// Differential evolution, as in the paper.
    Differential(Box<DifferentialEvolution>),
    /// CMA-ES, with the number of generations and the mean cost of the last one.
    CmaEs(Box<CmaEs>, usize, f64),
}

/// One entry of the search's history.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchProgress {
    /// Number of completed generations.
    pub generation: usize,
    /// Best cost so far.
    pub best: f64,
    /// Mean cost of the population; for CMA-ES, of the last generation.
    pub mean: f64,
    /// Number of evaluations so far.
    pub evaluations: usize,
}

impl Optimiser {
    /// Starts a search.
    ///
    /// # Errors
    /// [`TaskError`] when the bounds, a setting or a guess is invalid.
    pub fn new(
        settings: &CellFitSettings,
        seed: u64,
        bounds: &[Interval],
        guesses: &[Vec<f64>],
    ) -> Result<Self, TaskError> {
        let search = |(coordinates, difference)| LocalSearch {
            coordinates,
            settings: lbfgsb::Settings {
                step: DifferenceStep::OfWidth(difference),
                cost_tolerance: POLISH_GAIN,
                ..lbfgsb::Settings::default()
            },
        };
        let polish: Vec<LocalSearch> = if settings.polish {
            POLISH.into_iter().map(search).collect()
        } else {
            Vec::new()
        };
        let popsize = settings.popsize as usize;
        let budget =
            BUDGET.min((settings.max_generations as usize).saturating_mul(popsize * bounds.len()));
        Ok(match settings.strategy {
            Strategy::DifferentialEvolution => {
                let settings = differential_evolution::Settings {
                    popsize,
                    mutation: settings.mutation,
                    recombination: settings.recombination,
                    tol: settings.tol,
                    atol: settings.atol,
                    maxiter: settings.max_generations as usize,
                    updating: settings.updating,
                    polish,
                    seed,
                };
                Self::Differential(Box::new(DifferentialEvolution::new(
                    bounds, guesses, settings,
                )?))
            }
            Strategy::CmaEs => {
                let settings = cma_es::Settings {
                    max_evaluations: budget,
                    seed,
                    ..cma_es::Settings::default()
                };
                Self::CmaEs(
                    Box::new(CmaEs::new(bounds, guesses, settings)?),
                    0,
                    f64::INFINITY,
                )
            }
        })
    }

    /// Points to evaluate next; empty at the end of the search.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        match self {
            Self::Differential(optimiser) => optimiser.ask(),
            Self::CmaEs(optimiser, ..) => optimiser.ask(),
        }
    }

    /// Takes the costs of the requested points. Returns the state of the search if a generation
    /// ended with them.
    ///
    /// # Errors
    /// [`TaskError`] when the number of costs is wrong.
    pub fn tell(&mut self, costs: &[f64]) -> Result<Option<SearchProgress>, TaskError> {
        let was_first = match self {
            Self::Differential(optimiser) => optimiser.stage() == Stage::FirstPopulation,
            Self::CmaEs(..) => false,
        };
        let before = self.n_generations();
        match self {
            Self::Differential(optimiser) => optimiser.tell(costs)?,
            Self::CmaEs(optimiser, generations, last_mean) => {
                optimiser.tell(costs)?;
                *generations += 1;
                *last_mean = mean(costs);
            }
        }
        Ok((was_first || self.n_generations() > before).then(|| self.standing()))
    }

    /// Number of completed generations. Like SciPy, differential evolution does not count the first
    /// population.
    #[must_use]
    pub fn n_generations(&self) -> usize {
        match self {
            Self::Differential(optimiser) => optimiser.n_generations(),
            Self::CmaEs(_, generations, _) => *generations,
        }
    }

    /// Number of evaluations so far.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        match self {
            Self::Differential(optimiser) => optimiser.n_evaluations(),
            Self::CmaEs(optimiser, ..) => optimiser.n_evaluations(),
        }
    }

    /// Best parameters so far, and their cost.
    #[must_use]
    pub fn best(&self) -> (Vec<f64>, f64) {
        match self {
            Self::Differential(optimiser) => optimiser.best(),
            Self::CmaEs(optimiser, ..) => optimiser.best(),
        }
    }

    /// Whether the search ended by its tolerance and not by its budget.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        match self {
            Self::Differential(optimiser) => optimiser
                .outcome()
                .is_some_and(|o| o.ending == StopReason::Converged),
            Self::CmaEs(optimiser, ..) => optimiser.ending() == Some(cma_es::StopReason::Agreement),
        }
    }

    /// Name of the current phase.
    #[must_use]
    pub fn phase(&self) -> &'static str {
        match self {
            Self::Differential(optimiser) if optimiser.stage() == Stage::Polish => "polish",
            Self::Differential(_) => "differential evolution",
            Self::CmaEs(..) => "cma-es",
        }
    }

    fn standing(&self) -> SearchProgress {
        let mean = match self {
            Self::Differential(optimiser) => mean(optimiser.members().1),
            Self::CmaEs(_, _, mean) => *mean,
        };
        let (generation, evaluations) = (self.n_generations(), self.n_evaluations());
        SearchProgress {
            generation,
            best: self.best().1,
            mean,
            evaluations,
        }
    }
}
