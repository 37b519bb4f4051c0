//! Step 2: a global fit of the 0D cell, and the identifiability of its parameters.
//!
//! Each generation is one batch on the cell engine. Costs are recorded batch by batch, and a later
//! attempt at the same task continues from them. Random numbers depend only on seed, generation and
//! candidate. The answer is therefore the same for any number of threads and interruptions.
//!
//! Artefacts: `cell.csv` (`time_ms,Sa_kPa,Ca_uM,lambda`) and `convergence.csv`.

mod batches;
mod identifiability;
pub mod objective;
pub mod optimiser;
mod unreachable;

use std::fmt::Write as _;
use std::path::Path;

use cardiotwin_cell_engine::CellTrace;
use cardiotwin_schemas::hash::{canonical_json, sha256_hex};
use cardiotwin_schemas::outcome::{CellFitResult, FittedParameter, TaskResult};
use cardiotwin_schemas::task::{CellFitSpec, TaskSpec};

use self::batches::Batches;
use self::objective::{Evaluation, Objective, WORST};
use self::optimiser::{Optimiser, SearchProgress};
use self::unreachable::{Beyond, past_the_bound};
use crate::context::Context;
use crate::error::TaskError;
use crate::nodal::number;

/// Name of the checkpoint.
const CHECKPOINT: &str = "told-costs";
/// Distance from a bound, as a share of the interval, within which a value counts as lying on the
/// bound.
const AT_BOUND: f64 = 1e-3;

/// Fits the cell's parameters to the targets.
///
/// # Errors
/// [`TaskError`] when the specification is invalid, no cell could be computed, or a stop is
/// requested.
pub fn run(spec: &CellFitSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    let objective = Objective::new(spec, context.instruction_set)?;
    let guesses = objective.guesses(&spec.settings.initial)?;
    let mut optimiser = Optimiser::new(&spec.settings, spec.seed, objective.bounds(), &guesses)?;
    let journal = context
        .checkpoints
        .journal(CHECKPOINT, &search(spec))
        .map_err(TaskError::Checkpoint)?;
    if let Some(earlier) = journal.from() {
        tracing::info!(from = %earlier.display(), "continuing the fit of an earlier attempt");
    }
    let mut batches = Batches::new(&objective, journal, context.threads)?;
    let convergence = minimise(&mut optimiser, &mut batches, context)?;
    let (best, cost) = optimiser.best();
    if cost >= WORST {
        return Err(TaskError::NoCell);
    }
    let evaluation = objective.evaluate(&best)?;
    let mut parameters = fitted(&objective, &best);
    let mut identifiability = None;
    if spec.settings.identifiability {
        let n_evaluations = optimiser.n_evaluations();
        let profiled = identifiability::profile(
            &objective,
            &best,
            cost,
            n_evaluations,
            &mut batches,
            context,
        )?;
        parameters
            .iter_mut()
            .zip(profiled.parameters)
            .for_each(|(parameter, found)| parameter.near_optimal = found);
        identifiability = Some(profiled.identifiability);
    }
    context
        .artefacts
        .write("cell", "cell.csv", &cell_csv(&evaluation.trace))?;
    context.artefacts.write(
        "convergence",
        "convergence.csv",
        &convergence_csv(&convergence),
    )?;
    Ok(TaskResult::CellFit(CellFitResult {
        lambda_0: spec.lambda_0,
        unreachable_targets: unreachable_targets(&objective, &parameters, &evaluation)?,
        parameters,
        reached: evaluation.biomarkers,
        targets: spec.targets,
        cost: evaluation.cost,
        cost_terms: evaluation.terms,
        evaluations: optimiser.n_evaluations() as u64,
        generations: optimiser.n_generations() as u64,
        converged: optimiser.is_converged(),
        identifiability,
    }))
}

/// Result of a search without profiles.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Best parameters, in the order in which they are fitted.
    pub parameters: Vec<f64>,
    /// Cost of these parameters.
    pub cost: f64,
    /// Number of cell evaluations.
    pub evaluations: usize,
}

/// Runs the search on one thread, without files, profiles and interruptions.
///
/// # Errors
/// [`TaskError`] when the specification is invalid.
pub fn search_alone(spec: &CellFitSpec) -> Result<Found, TaskError> {
    let mut context = Context::plain(Path::new("."), 1);
    let objective = Objective::new(spec, context.instruction_set)?;
    let guesses = objective.guesses(&spec.settings.initial)?;
    let mut optimiser = Optimiser::new(&spec.settings, spec.seed, objective.bounds(), &guesses)?;
    let journal = context
        .checkpoints
        .journal(CHECKPOINT, "")
        .map_err(TaskError::Checkpoint)?;
    minimise(
        &mut optimiser,
        &mut Batches::new(&objective, journal, 1)?,
        &mut context,
    )?;
    let (parameters, cost) = optimiser.best();
    Ok(Found {
        parameters,
        cost,
        evaluations: optimiser.n_evaluations(),
    })
}

/// Identity of a search: the task without the settings that only determine its end. A longer search
/// begins with the same points as a shorter one.
fn search(spec: &CellFitSpec) -> String {
    let task = TaskSpec::CellFit(Box::new(spec.clone()));
    let mut value: serde_json::Value = serde_json::from_str(&task.canonical()).unwrap_or_default();
    if let Some(settings) = value["settings"].as_object_mut() {
        settings.retain(|key, _| {
            ![
                "tol",
                "atol",
                "max_generations",
                "polish",
                "identifiability",
            ]
            .contains(&key.as_str())
        });
    }
    sha256_hex(canonical_json(&value).unwrap_or_default().as_bytes())
}

/// Runs the optimiser until it ends.
fn minimise(
    optimiser: &mut Optimiser,
    batches: &mut Batches<'_>,
    context: &mut Context,
) -> Result<Vec<SearchProgress>, TaskError> {
    let mut convergence = Vec::new();
    let limit = context.checkpoints.last_generation();
    loop {
        let points = optimiser.ask();
        if points.is_empty() {
            return Ok(convergence);
        }
        let is_begun = optimiser.n_evaluations() > 0;
        if is_begun && limit.is_some_and(|limit| optimiser.n_generations() as u64 >= limit) {
            batches.forget();
        }
        convergence.extend(optimiser.tell(&batches.costs(&points, context)?)?);
        let generation = optimiser.n_generations();
        // The number of generations is not known in advance.
        let last = convergence.last();
        context
            .progress
            .report(optimiser.phase(), generation as f64, None, || {
                let (best, mean) = last.map_or((f64::NAN, f64::NAN), |last| (last.best, last.mean));
                format!("generation {generation}, cost {best:.4}, mean {mean:.4}")
            });
        batches.check_stop(context)?;
    }
}

fn fitted(objective: &Objective, best: &[f64]) -> Vec<FittedParameter> {
    let fitted = objective.names().iter().zip(objective.bounds()).zip(best);
    let parameter =
        |((name, bounds), value): ((&String, &cardiotwin_calibrate::Interval), &f64)| {
            FittedParameter {
                name: name.clone(),
                value: *value,
                lower: bounds.lower,
                upper: bounds.upper,
                at_bound: (value - bounds.lower).min(bounds.upper - value)
                    <= AT_BOUND * bounds.width(),
                near_optimal: None,
            }
        };
    fitted.map(parameter).collect()
}

fn unreachable_targets(
    objective: &Objective,
    parameters: &[FittedParameter],
    evaluation: &Evaluation,
) -> Result<Vec<String>, TaskError> {
    let value = |name: &str| match parameters.iter().find(|parameter| parameter.name == name) {
        Some(parameter) => Ok(parameter.value),
        None => objective.fixed_value(name),
    };
    let is_fitted = objective.names().iter().any(|name| name == "Smax_ref_kPa");
    let smax_ref = if is_fitted {
        None
    } else {
        Some(value("Smax_ref_kPa")?)
    };
    let beyond = beyond_bounds(objective, parameters);
    let reached = &evaluation.biomarkers;
    Ok(unreachable::describe(
        objective.targets(),
        reached,
        &beyond,
        smax_ref,
        value("a_p_kPa")?,
    ))
}

/// Evaluates the cell with each parameter that lies on a bound moved past it, one at a time.
fn beyond_bounds(objective: &Objective, parameters: &[FittedParameter]) -> Vec<Beyond> {
    let values: Vec<f64> = parameters.iter().map(|parameter| parameter.value).collect();
    let moved = parameters
        .iter()
        .enumerate()
        .filter_map(|(idx, parameter)| {
            let value = past_the_bound(parameter)?;
            let mut values = values.clone();
            values[idx] = value;
            let reached = objective.evaluate(&values).ok()?.biomarkers;
            let bound = if value > parameter.value {
                parameter.upper
            } else {
                parameter.lower
            };
            Some(Beyond {
                name: parameter.name.clone(),
                bound,
                value,
                reached,
            })
        });
    moved.collect()
}

fn cell_csv(trace: &CellTrace) -> String {
    let mut text = "time_ms,Sa_kPa,Ca_uM,lambda\n".to_owned();
    let rows = trace
        .sa_kpa
        .iter()
        .zip(&trace.calcium_um)
        .zip(&trace.lambda)
        .enumerate();
    for (time, ((sa, ca), lambda)) in rows {
        let values = [time as f64, *sa, *ca, *lambda].map(number);
        let _ = writeln!(text, "{}", values.join(","));
    }
    text
}

fn convergence_csv(generations: &[SearchProgress]) -> String {
    let mut text = "generation,best_cost,mean_cost,evaluations\n".to_owned();
    for row in generations {
        let _ = writeln!(
            text,
            "{},{},{},{}",
            row.generation,
            number(row.best),
            number(row.mean),
            row.evaluations
        );
    }
    text
}
