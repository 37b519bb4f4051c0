//! Step 2: differential evolution over the 0D cell.
//!
//! The state of the optimiser is kept after every batch, and a later attempt at the same task goes on from it. Random
//! numbers depend on seed, generation and candidate alone, so the answer is the same however often the work was
//! interrupted and on however many threads it runs.
//!
//! Artefacts: `cell.csv` (`time_ms,Sa_kPa,Ca_uM,lambda`) and `convergence.csv`.

pub mod objective;
mod unreachable;

use std::fmt::Write as _;

use cardiotwin_calibrate::differential_evolution::{DifferentialEvolution, Ending, Settings, Stage, Updating};
use cardiotwin_calibrate::lbfgsb::{self, DifferenceStep};
use cardiotwin_calibrate::statistics::mean;
use cardiotwin_models::cell0d::CellBeat;
use cardiotwin_schemas::outcome::{CellFitResult, FittedParameter, TaskResult};
use cardiotwin_schemas::settings;
use cardiotwin_schemas::task::CellFitSpec;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::objective::{Objective, WORST};
use self::unreachable::{Beyond, past_the_bound};
use crate::context::Context;
use crate::error::TaskError;
use crate::nodal::number;
use crate::tasks::targets::to_schema;

/// Name of the checkpoint.
const CHECKPOINT: &str = "differential-evolution.json";
/// A value so close to a bound, as a share of the interval, sits on it.
const AT_BOUND: f64 = 1e-3;
/// Step of the polish's finite differences, as a share of each interval: the integrator's own error makes the cost rough
/// at smaller ones.
const DIFFERENCE: f64 = 1e-4;
/// The polish ends when an iteration gains less: the integrator's error, not the minimum, decides beyond.
const POLISH_GAIN: f64 = 1e-8;

/// Everything that a later attempt needs.
#[derive(Debug, Serialize, Deserialize)]
struct Progress {
    optimiser: DifferentialEvolution,
    convergence: Vec<Generation>,
}

/// A line of `convergence.csv`.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Generation {
    generation: usize,
    best: f64,
    mean: f64,
    evaluations: usize,
}

/// Fits the cell.
///
/// # Errors
/// [`TaskError`] when the specification makes no sense, no cell could be computed, or stopping was asked for.
pub fn run(spec: &CellFitSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    let objective = Objective::new(spec)?;
    let mut progress = match context.checkpoints.load::<Progress>(CHECKPOINT) {
        Some((generation, progress)) => {
            tracing::info!(
                generation,
                evaluations = progress.optimiser.n_evaluations(),
                "continuing the fit of an earlier attempt"
            );
            progress
        }
        None => Progress {
            optimiser: DifferentialEvolution::new(
                objective.bounds(),
                &objective.guesses(spec)?,
                optimiser_settings(spec),
            )?,
            convergence: Vec::new(),
        },
    };
    minimise(&objective, &mut progress, context)?;
    result(spec, &objective, &progress, context)
}

fn optimiser_settings(spec: &CellFitSpec) -> Settings {
    let from = &spec.settings;
    let polish = lbfgsb::Settings {
        step: DifferenceStep::OfWidth(DIFFERENCE),
        cost_tolerance: POLISH_GAIN,
        ..lbfgsb::Settings::default()
    };
    Settings {
        popsize: from.popsize as usize,
        mutation: from.mutation,
        recombination: from.recombination,
        tol: from.tol,
        atol: from.atol,
        maxiter: from.max_generations as usize,
        updating: match from.updating {
            settings::Updating::Deferred => Updating::Deferred,
            settings::Updating::Immediate => Updating::Immediate,
        },
        polish: from.polish.then_some(polish),
        seed: spec.seed,
    }
}

/// Asks, computes and tells until the end.
fn minimise(objective: &Objective, progress: &mut Progress, context: &mut Context) -> Result<(), TaskError> {
    let threads =
        (context.threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(context.threads as usize).build());
    let pool = threads.transpose().map_err(TaskError::Threads)?;
    let mut beat = CellBeat::default();
    loop {
        let points = progress.optimiser.ask();
        if points.is_empty() {
            return Ok(());
        }
        let costs: Vec<f64> = match &pool {
            Some(pool) => pool.install(|| {
                let costs = points.par_iter().map_init(CellBeat::default, |beat, point| objective.cost(point, beat));
                costs.collect()
            }),
            None => points.iter().map(|point| objective.cost(point, &mut beat)).collect(),
        };
        let before = progress.optimiser.n_generations();
        let first = progress.optimiser.stage() == Stage::FirstPopulation;
        progress.optimiser.tell(&costs)?;
        if first || progress.optimiser.n_generations() > before {
            progress.note_generation();
        }
        report(progress, context);
        // Immediate updating asks for one point at a time: keeping every one would cost more than it saves.
        if points.len() > 1 || progress.optimiser.n_evaluations().is_multiple_of(100) {
            context.keep(CHECKPOINT, progress)?;
        }
        context.check_stop().inspect_err(|_| {
            // The last state is kept even where the batch was not.
            let _ = context.checkpoints.save(CHECKPOINT, progress);
        })?;
    }
}

impl Progress {
    fn note_generation(&mut self) {
        let (_, costs) = self.optimiser.members();
        let (best, mean) = (self.optimiser.best().1, mean(costs));
        let (generation, evaluations) = (self.optimiser.n_generations(), self.optimiser.n_evaluations());
        self.convergence.push(Generation { generation, best, mean, evaluations });
    }
}

fn report(progress: &Progress, context: &mut Context) {
    let optimiser = &progress.optimiser;
    let phase = if optimiser.stage() == Stage::Polish { "polish" } else { "differential evolution" };
    let generation = optimiser.n_generations();
    // The number of generations is not known beforehand: the spread of costs tells how near the end is.
    context.progress.report(phase, generation as f64, None, || {
        format!("generation {generation}, cost {:.4}, spread {:.3}", optimiser.best().1, optimiser.spread())
    });
}

fn result(
    spec: &CellFitSpec,
    objective: &Objective,
    progress: &Progress,
    context: &mut Context,
) -> Result<TaskResult, TaskError> {
    let outcome = progress.optimiser.outcome().filter(|outcome| outcome.cost < WORST).ok_or(TaskError::NoCell)?;
    let mut beat = CellBeat::default();
    let evaluation = objective.evaluate(&outcome.parameters, &mut beat)?;
    context.artefacts.write("cell", "cell.csv", &cell_csv(&beat))?;
    context.artefacts.write("convergence", "convergence.csv", &convergence_csv(&progress.convergence))?;
    let fitted = objective.names().iter().zip(objective.bounds()).zip(&outcome.parameters);
    let parameters: Vec<FittedParameter> = fitted
        .map(|((name, bounds), value)| FittedParameter {
            name: name.clone(),
            value: *value,
            lower: bounds.lower,
            upper: bounds.upper,
            at_bound: (value - bounds.lower).min(bounds.upper - value) <= AT_BOUND * bounds.width(),
            near_optimal: None,
        })
        .collect();
    let reached = to_schema(&evaluation.biomarkers);
    let smax_ref = (!objective.names().iter().any(|name| name == "Smax_ref_kPa"))
        .then(|| objective.fixed_value("Smax_ref_kPa"))
        .transpose()?;
    let beyond = beyond_bounds(objective, &parameters);
    let a_p = match parameters.iter().find(|parameter| parameter.name == "a_p_kPa") {
        Some(parameter) => parameter.value,
        None => objective.fixed_value("a_p_kPa")?,
    };
    Ok(TaskResult::CellFit(CellFitResult {
        unreachable_targets: unreachable::describe(&spec.targets, &reached, &beyond, smax_ref, a_p),
        parameters,
        reached,
        targets: spec.targets,
        cost: evaluation.total(),
        cost_terms: evaluation.terms(),
        evaluations: outcome.n_evaluations as u64,
        generations: outcome.n_generations as u64,
        converged: outcome.ending == Ending::Converged,
        identifiability: None,
    }))
}

/// The cell with each parameter on a bound moved past it in turn.
fn beyond_bounds(objective: &Objective, parameters: &[FittedParameter]) -> Vec<Beyond> {
    let values: Vec<f64> = parameters.iter().map(|parameter| parameter.value).collect();
    let mut beat = CellBeat::default();
    let moved = parameters.iter().enumerate().filter_map(|(idx, parameter)| {
        let value = past_the_bound(parameter)?;
        let mut values = values.clone();
        values[idx] = value;
        let reached = to_schema(&objective.evaluate(&values, &mut beat).ok()?.biomarkers);
        let bound = if value > parameter.value { parameter.upper } else { parameter.lower };
        Some(Beyond { name: parameter.name.clone(), bound, value, reached })
    });
    moved.collect()
}

fn cell_csv(beat: &CellBeat) -> String {
    let mut text = "time_ms,Sa_kPa,Ca_uM,lambda\n".to_owned();
    for (idx, time) in beat.time_ms.iter().enumerate() {
        let values = [*time, beat.sa_kpa[idx], beat.ca_um[idx], beat.lambda[idx]].map(number);
        let _ = writeln!(text, "{}", values.join(","));
    }
    text
}

fn convergence_csv(generations: &[Generation]) -> String {
    let mut text = "generation,best_cost,mean_cost,evaluations\n".to_owned();
    for row in generations {
        let _ = writeln!(text, "{},{},{},{}", row.generation, number(row.best), number(row.mean), row.evaluations);
    }
    text
}
