//! Uncertainty of a twin: the posterior of its parameters in the one-fibre ventricle, corrected to
//! the twin's beat.
//!
//! Samples of pressure and volume are those of the twin plus the change that the one-fibre
//! ventricle predicts for other parameters; biomarkers are multiplied by its ratios. The errors of
//! the data are the noise stated in the patient's file and, beyond it, the deviation of the twin's
//! beat from the traces. If the ventricle has no beat with the twin's parameters, draws are those of
//! the ventricle without a correction, and the result says so. [`cardiotwin_calibrate::posterior`] makes the draws.

mod likelihood;
mod model;
mod summary;

use cardiotwin_calibrate::posterior::Ensemble;
use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::posterior::PosteriorSpec;
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use self::model::Model;
use self::summary::Sampled;
use super::proposal::learned::learned_law;
use crate::context::Context;
use crate::error::TaskError;

/// Largest number of steps in the search for a draw.
const DRAW_STEPS: usize = 60;
/// Smallest number of draws that makes a distribution.
const FEWEST: usize = 20;

/// Samples the posterior.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models, when the one-fibre
/// ventricle cannot reproduce the twin's beat, or when a stop is requested.
pub fn run(spec: &PosteriorSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    context.check_stop()?;
    let model = Model::new(spec)?;
    let evaluate = |x: &[f64]| model.evaluate(x);
    let target = model.target(&evaluate);
    context
        .progress
        .report("posterior", 0.0, None, || "finding its mode".to_owned());
    let mode = model.mode(&target)?;
    let pool = ThreadPoolBuilder::new()
        .num_threads(context.threads.max(1) as usize)
        .build();
    let pool = pool.map_err(TaskError::Threads)?;
    let (stop, closed) = (context.stop.clone(), context.closed.clone());
    let stopped = || stop.is_raised() || closed.as_ref().is_some_and(|closed| closed.exists());
    let n = u64::from(spec.settings.draws);
    let mut ensemble = Ensemble::new(&target, &mode, spec.seed, n, DRAW_STEPS);
    loop {
        context.check_stop()?;
        let pending = ensemble.pending();
        if pending.is_empty() {
            break;
        }
        let done = n - pending.len() as u64;
        context
            .progress
            .report("posterior", done as f64, Some(n as f64), || {
                format!("{done} of {n} draws")
            });
        let results = pool.install(|| {
            let one = |index| (!stopped()).then(|| ensemble.next(index));
            pending.into_par_iter().filter_map(one).collect()
        });
        ensemble.tell(results);
    }
    let mut draws = ensemble.draws();
    for draw in &mut draws {
        let x = target.parameters(&draw.u);
        if let Some(x) = model.tolerated(&x) {
            draw.u = target.standard(&x);
        }
    }
    context.check_stop()?;
    if draws.len() < FEWEST {
        return Err(TaskError::NoPosterior);
    }
    Ok(TaskResult::Posterior(Box::new(summary::of(&Sampled {
        spec,
        axes: &model.axes,
        prior: &model.prior,
        draws: &draws,
        asked_for: n,
        is_corrected: model.likelihood.is_corrected(),
        left: mode.left(spec.settings.error_factor),
        deviations: model.likelihood.deviations,
        evaluations: (mode.evaluations + draws.iter().map(|draw| draw.evaluations).sum::<usize>())
            as u64,
        learned_law: learned_law(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?,
    }))))
}

#[cfg(test)]
mod tests;
