//! Uncertainty of a twin: the posterior of its parameters in the one-fibre ventricle, corrected to
//! the twin's beat.
//!
//! Samples of pressure and volume are those of the twin plus the change that the one-fibre
//! ventricle predicts for other parameters; biomarkers are multiplied by its ratios. The errors of
//! the data are the noise stated in the patient's file and, beyond it, the deviation of the twin's
//! beat from the traces. [`cardiotwin_calibrate::posterior`] makes the draws.

mod likelihood;
mod summary;

use cardiotwin_calibrate::posterior::{Ensemble, Evaluated, Target, TruncatedNormal, mode};
use cardiotwin_schemas::outcome::{OrganBeatResult, TaskResult};
use cardiotwin_schemas::posterior::PosteriorSpec;
use cardiotwin_schemas::task::OrganBeatSpec;
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use self::likelihood::Likelihood;
use self::summary::{Sampled, Seen};
use super::proposal::axes::{Axis, axes, named, point, tolerated};
use super::proposal::learned::learned_law;
use super::proposal::surrogate;
use crate::context::Context;
use crate::error::TaskError;
use crate::tasks::organ_beat::{reduced, reduced_beat};

/// Shortest time step of the one-fibre ventricle, as in step 3's searches.
const TIME_STEP_MS: f64 = 2.0;
/// The same in the organ's law. Its error cancels in the difference from the twin's beat, but for a
/// small rest: the draws' medians move by a twentieth of their intervals (root mean square), as with
/// other random numbers.
const STEP_IN_LAW_MS: f64 = 4.0;
/// Largest number of steps in the search for the mode.
const MODE_STEPS: usize = 100;
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
    let axes = axes(&spec.parameters);
    let prior: Vec<TruncatedNormal> = axes.iter().map(Axis::truncated).collect();
    let organ = surrogate(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?;
    let shortest_step_ms = if organ.law.is_some() {
        STEP_IN_LAW_MS
    } else {
        TIME_STEP_MS
    };
    let beat = OrganBeatSpec {
        time_step_ms: spec.beat.time_step_ms.max(shortest_step_ms),
        ..spec.beat.clone()
    };
    // Reports errors that are common to all draws: an invalid effect, a parameter
    // outside the range of the models.
    reduced(&beat, &organ)?;
    let simulate = |x: &[f64]| -> Option<OrganBeatResult> {
        let trial = beat.with_parameters(&named(&axes, &tolerated(&beat, &axes, x)?));
        reduced_beat(&trial, &organ)
            .ok()
            .flatten()
            .filter(|beat| beat.failed_check().is_none())
    };
    let of_twin = point(&axes, &spec.twin.parameters);
    let cheap = simulate(&of_twin).ok_or(TaskError::NoPosterior)?;
    let likelihood = Likelihood::of(spec, &cheap);
    let model = |x: &[f64]| {
        let beat = simulate(x)?;
        let (samples, biomarkers) = likelihood.corrected(&beat);
        let residuals = likelihood.residuals(&samples, &biomarkers);
        Some(Evaluated {
            residuals,
            seen: Seen {
                biomarkers,
                samples,
            },
        })
    };
    let target = Target {
        prior: &prior,
        model: &model,
    };
    context
        .progress
        .report("posterior", 0.0, None, || "finding its mode".to_owned());
    let mode =
        mode(&target, &target.standard(&of_twin), MODE_STEPS).ok_or(TaskError::NoPosterior)?;
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
        if let Some(x) = tolerated(&beat, &axes, &x) {
            draw.u = target.standard(&x);
        }
    }
    context.check_stop()?;
    if draws.len() < FEWEST {
        return Err(TaskError::NoPosterior);
    }
    Ok(TaskResult::Posterior(Box::new(summary::of(&Sampled {
        spec,
        axes: &axes,
        prior: &prior,
        draws: &draws,
        asked_for: n,
        left: mode.left(spec.settings.error_factor),
        deviations: likelihood.deviations,
        evaluations: (mode.evaluations + draws.iter().map(|draw| draw.evaluations).sum::<usize>())
            as u64,
        learned_law: learned_law(&spec.beat, spec.law.as_deref(), spec.prior.as_ref())?,
    }))))
}

#[cfg(test)]
mod tests;
