//! State machine of L-BFGS-B: its batches, its updates and its end.

use super::line_search::{LineSearch, Verdict};
use super::model::{Memory, minimiser};
use crate::storage::worst_if_not_finite;
use crate::{Interval, IntervalError};
use serde::{Deserialize, Serialize};

/// Step length of a finite difference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DifferenceStep {
    /// Length in the parameters' own units, as `SciPy`'s default of 1e-8.
    Absolute(f64),
    /// Fraction of each interval's width, for costs with numerical noise such as an integrator's.
    OfWidth(f64),
}

/// Tolerances and limits; defaults are `SciPy`'s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Number of pairs that build the matrix.
    pub n_pairs: usize,
    /// The search ends when an iteration lowers the cost by less than this times the largest of
    /// both costs and one, dimensionless.
    pub cost_tolerance: f64,
    /// The search ends when no component of the projected gradient exceeds this, cost per
    /// parameter's unit.
    pub gradient_tolerance: f64,
    /// Step of the finite differences.
    pub step: DifferenceStep,
    /// Largest number of iterations.
    pub max_iterations: usize,
    /// No iteration starts after this number of evaluations.
    pub max_evaluations: usize,
    /// Largest number of steps in one line search.
    pub max_line_search: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            n_pairs: 10,
            cost_tolerance: 1e7 * f64::EPSILON,
            gradient_tolerance: 1e-5,
            step: DifferenceStep::Absolute(1e-8),
            max_iterations: 15_000,
            max_evaluations: 15_000,
            max_line_search: 20,
        }
    }
}

/// Reason for the end of the optimisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// The projected gradient vanishes.
    Gradient,
    /// The cost no longer falls.
    Cost,
    /// The line search finds no lower cost even along the gradient.
    LineSearch,
    /// The largest number of iterations was reached.
    Iterations,
    /// The largest number of evaluations was reached.
    Evaluations,
    /// The cost at the start is not finite.
    StartNotFinite,
}

impl StopReason {
    /// Whether the result is a minimum within the tolerances.
    #[must_use]
    pub fn is_success(self) -> bool {
        matches!(self, Self::Gradient | Self::Cost)
    }
}

/// Invalid input to the optimiser.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LbfgsbError {
    /// The box is empty, or an interval is not finite and in order.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// The start has another dimension than the box.
    #[error("the start has {n_start} parameters, but the box has {n_bounds}")]
    Dimension {
        /// Length of the start.
        n_start: usize,
        /// Number of intervals of the box.
        n_bounds: usize,
    },
    /// The number of costs differs from the number of points requested.
    #[error("{n_costs} costs were given for {n_points} points")]
    Costs {
        /// Number of costs given.
        n_costs: usize,
        /// Number of points requested.
        n_points: usize,
    },
    /// Costs were given after the end of the optimisation.
    #[error("costs were given after the optimisation had ended")]
    Ended,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Phase {
    Start,
    Searching(Search),
    Ended(StopReason),
}

/// A line search in progress from the current point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Search {
    /// Minimiser of the model, which is the point at step one.
    target: Vec<f64>,
    direction: Vec<f64>,
    line: LineSearch,
    slope: f64,
    n_steps: usize,
}

/// Bounded limited-memory quasi-Newton minimisation. The state can be stored between
/// [`Lbfgsb::tell`] and the next [`Lbfgsb::ask`] and continues bit for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lbfgsb {
    settings: Settings,
    bounds: Vec<Interval>,
    /// Current point; initially the start.
    x: Vec<f64>,
    #[serde(with = "crate::storage::cost")]
    cost: f64,
    gradient: Vec<f64>,
    memory: Memory,
    n_iterations: usize,
    n_evaluations: usize,
    phase: Phase,
}

impl Lbfgsb {
    /// Starts at a point, which is clamped to the box.
    ///
    /// # Errors
    /// [`LbfgsbError`] if the box is invalid or its dimension differs from the start's.
    pub fn new(
        start: &[f64],
        bounds: &[Interval],
        settings: Settings,
    ) -> Result<Self, LbfgsbError> {
        Interval::validate(bounds)?;
        if start.len() != bounds.len() {
            return Err(LbfgsbError::Dimension {
                n_start: start.len(),
                n_bounds: bounds.len(),
            });
        }
        Ok(Self {
            settings,
            bounds: bounds.to_vec(),
            x: start.iter().zip(bounds).map(|(x, b)| b.clamp(*x)).collect(),
            cost: f64::INFINITY,
            gradient: vec![0.0; start.len()],
            memory: Memory::new(settings.n_pairs.max(1)),
            n_iterations: 0,
            n_evaluations: 0,
            phase: Phase::Start,
        })
    }

    /// Points to evaluate next, shape (D + 1, D): a trial and its D differences. Empty once the
    /// optimisation has ended.
    #[must_use]
    pub fn ask(&self) -> Vec<Vec<f64>> {
        let Some(trial) = self.trial() else {
            return Vec::new();
        };
        let mut points = Vec::with_capacity(trial.len() + 1);
        points.push(trial.clone());
        for i in 0..trial.len() {
            let mut point = trial.clone();
            point[i] = self.shifted(i, trial[i]);
            points.push(point);
        }
        points
    }

    /// Takes the costs of the points that [`Self::ask`] returned, in the same order. Costs that are
    /// not finite count as infinite.
    ///
    /// # Errors
    /// [`LbfgsbError`] if the number of costs differs or the optimisation has ended.
    pub fn tell(&mut self, costs: &[f64]) -> Result<(), LbfgsbError> {
        let trial = self.trial().ok_or(LbfgsbError::Ended)?;
        if costs.len() != trial.len() + 1 {
            return Err(LbfgsbError::Costs {
                n_costs: costs.len(),
                n_points: trial.len() + 1,
            });
        }
        self.n_evaluations += costs.len();
        let cost = worst_if_not_finite(costs[0]);
        let gradient: Vec<f64> = (0..trial.len())
            .map(|i| {
                let step = self.shifted(i, trial[i]) - trial[i];
                let slope = (costs[i + 1] - cost) / step;
                // A failed difference, or an interval without width, leaves this direction unused.
                if slope.is_finite() { slope } else { 0.0 }
            })
            .collect();
        self.phase = match std::mem::replace(&mut self.phase, Phase::Start) {
            Phase::Start => self.begin(cost, gradient),
            Phase::Searching(search) => self.search(search, trial, cost, gradient),
            ended @ Phase::Ended(_) => ended,
        };
        Ok(())
    }

    /// Reason for the end; `None` while the optimisation continues.
    #[must_use]
    pub fn ending(&self) -> Option<StopReason> {
        match self.phase {
            Phase::Ended(ending) => Some(ending),
            _ => None,
        }
    }

    /// Best point so far and its cost.
    #[must_use]
    pub fn best(&self) -> (&[f64], f64) {
        (&self.x, self.cost)
    }

    /// Gradient of the cost at the best point, per parameter's unit.
    #[must_use]
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// Number of evaluations so far, a multiple of D + 1.
    #[must_use]
    pub fn n_evaluations(&self) -> usize {
        self.n_evaluations
    }

    /// Number of iterations made.
    #[must_use]
    pub fn n_iterations(&self) -> usize {
        self.n_iterations
    }

    fn trial(&self) -> Option<Vec<f64>> {
        match &self.phase {
            Phase::Start => Some(self.x.clone()),
            Phase::Searching(search) => Some(self.point_at(search)),
            Phase::Ended(_) => None,
        }
    }

    fn point_at(&self, search: &Search) -> Vec<f64> {
        let step = search.line.step();
        if step == 1.0 {
            return search.target.clone();
        }
        let along = |i: usize| self.bounds[i].clamp(self.x[i] + step * search.direction[i]);
        (0..self.x.len()).map(along).collect()
    }

    /// Moves a coordinate by the step of the difference, to the other side if it would leave the
    /// box.
    fn shifted(&self, i: usize, x: f64) -> f64 {
        let bounds = self.bounds[i];
        let step = match self.settings.step {
            DifferenceStep::Absolute(h) => h,
            DifferenceStep::OfWidth(fraction) => fraction * bounds.width(),
        };
        // As in SciPy, a step that vanishes next to the coordinate is replaced by one of half its
        // digits.
        let step = if x + step == x {
            f64::EPSILON.sqrt() * x.abs().max(1.0)
        } else {
            step
        };
        if x + step <= bounds.upper {
            x + step
        } else if x - step >= bounds.lower {
            x - step
        } else if bounds.upper - x >= x - bounds.lower {
            bounds.upper
        } else {
            bounds.lower
        }
    }

    fn begin(&mut self, cost: f64, gradient: Vec<f64>) -> Phase {
        (self.cost, self.gradient) = (cost, gradient);
        if cost.is_infinite() {
            return Phase::Ended(StopReason::StartNotFinite);
        }
        if self.projected_gradient() <= self.settings.gradient_tolerance {
            return Phase::Ended(StopReason::Gradient);
        }
        self.iterate()
    }

    /// Largest component of the projected gradient.
    fn projected_gradient(&self) -> f64 {
        let component = |i: usize| {
            let (x, g) = (self.x[i], self.gradient[i]);
            if g < 0.0 {
                (x - self.bounds[i].upper).max(g)
            } else {
                (x - self.bounds[i].lower).min(g)
            }
        };
        (0..self.x.len())
            .map(|i| component(i).abs())
            .fold(0.0, f64::max)
    }

    /// Starts an iteration: a direction of descent and a line search along it.
    fn iterate(&mut self) -> Phase {
        loop {
            if let Some(search) = self.new_search() {
                return Phase::Searching(search);
            }
            if self.memory.is_empty() {
                return Phase::Ended(StopReason::LineSearch);
            }
            self.memory.clear();
        }
    }

    fn new_search(&self) -> Option<Search> {
        let target = minimiser(&self.x, &self.gradient, &self.bounds, &self.memory)?;
        let direction: Vec<f64> = target.iter().zip(&self.x).map(|(t, x)| t - x).collect();
        let slope: f64 = direction
            .iter()
            .zip(&self.gradient)
            .map(|(d, g)| d * g)
            .sum();
        if slope >= 0.0 || !slope.is_finite() {
            return None;
        }
        let max_step = if self.n_iterations == 0 {
            1.0
        } else {
            self.room(&direction)
        };
        let step = max_step.min(1.0);
        let line = LineSearch::new(self.cost, slope, step, max_step);
        (step > 0.0).then_some(Search {
            target,
            direction,
            line,
            slope,
            n_steps: 0,
        })
    }

    /// Largest step along a direction within the box.
    fn room(&self, direction: &[f64]) -> f64 {
        let of = |i: usize| match direction[i] {
            d if d > 0.0 => (self.bounds[i].upper - self.x[i]) / d,
            d if d < 0.0 => (self.bounds[i].lower - self.x[i]) / d,
            _ => f64::INFINITY,
        };
        (0..self.x.len()).map(of).fold(1e10, f64::min)
    }

    fn search(
        &mut self,
        mut search: Search,
        trial: Vec<f64>,
        cost: f64,
        gradient: Vec<f64>,
    ) -> Phase {
        search.n_steps += 1;
        let slope: f64 = search
            .direction
            .iter()
            .zip(&gradient)
            .map(|(d, g)| d * g)
            .sum();
        let verdict = if cost.is_finite() {
            search.line.advance(cost, slope)
        } else {
            search.line.shrink();
            Verdict::Evaluate
        };
        if verdict == Verdict::Evaluate {
            if search.n_steps < self.settings.max_line_search {
                return Phase::Searching(search);
            }
            // No point on the line is good. Without the memory, the direction is along the
            // gradient.
            if self.memory.is_empty() {
                return Phase::Ended(StopReason::LineSearch);
            }
            self.memory.clear();
            return self.iterate();
        }
        self.accept(&search, trial, cost, gradient, slope)
    }

    fn accept(
        &mut self,
        search: &Search,
        x: Vec<f64>,
        cost: f64,
        gradient: Vec<f64>,
        slope: f64,
    ) -> Phase {
        self.n_iterations += 1;
        let step_length = search.line.step();
        let change: Vec<f64> = gradient
            .iter()
            .zip(&self.gradient)
            .map(|(new, old)| new - old)
            .collect();
        let step: Vec<f64> = search.direction.iter().map(|d| step_length * d).collect();
        let cost_before = self.cost;
        (self.x, self.cost, self.gradient) = (x, cost, gradient);
        if self.n_iterations >= self.settings.max_iterations {
            return Phase::Ended(StopReason::Iterations);
        }
        if self.n_evaluations > self.settings.max_evaluations {
            return Phase::Ended(StopReason::Evaluations);
        }
        if self.projected_gradient() <= self.settings.gradient_tolerance {
            return Phase::Ended(StopReason::Gradient);
        }
        let scale = cost_before.abs().max(cost.abs()).max(1.0);
        if cost_before - cost <= self.settings.cost_tolerance * scale {
            return Phase::Ended(StopReason::Cost);
        }
        let curvature = (slope - search.slope) * step_length;
        if curvature > f64::EPSILON * -search.slope * step_length {
            self.memory.push(step, change, curvature);
        }
        self.iterate()
    }
}
