//! Identifiability of the fitted parameters: a profile of the cost for each of them.

use cardiotwin_calibrate::identifiability::{
    Mark, Profile, ProfileEnd, ProfiledParameter, Settings,
};
use cardiotwin_calibrate::lbfgsb;
use cardiotwin_schemas::outcome::{Determination, Identifiability, NearOptimal};

use super::batches::Batches;
use super::objective::Objective;
use crate::context::Context;
use crate::error::TaskError;

/// Largest number of evaluations, as a share of the fit's.
const SHARE: f64 = 0.3;

/// Near-optimal values of every parameter whose interval has a width.
pub struct Profiled {
    /// Near-optimal values in the order of the parameters; `None` for an interval without width.
    pub parameters: Vec<Option<NearOptimal>>,
    /// Threshold of the cost, evaluations, and whether all profiles are complete.
    pub identifiability: Identifiability,
}

/// Computes the profiles around the best set. `n_evaluations` is the number of evaluations of the
/// fit.
///
/// # Errors
/// [`TaskError`] when a stop is requested or the journal cannot be written.
pub fn profile(
    objective: &Objective,
    best: &[f64],
    cost: f64,
    n_evaluations: usize,
    batches: &mut Batches<'_>,
    context: &mut Context,
) -> Result<Profiled, TaskError> {
    let settings = settings();
    let bounds = objective.bounds();
    let mut profile = Profile::new(best, cost, bounds, settings)?;
    let most = (SHARE * n_evaluations as f64) as usize;
    while !profile.is_ended() {
        let points = profile.ask();
        if profile.n_evaluations() + points.len() > most {
            break;
        }
        profile.tell(&batches.costs(&points, context)?)?;
        let done = profile.n_evaluations();
        context
            .progress
            .report("identifiability", done as f64, Some(most as f64), || {
                format!("{done} evaluations")
            });
        batches.check_stop(context)?;
    }
    let complete = profile.is_ended();
    let mut parameters = vec![None; bounds.len()];
    for found in profile.so_far() {
        let interval = bounds[found.parameter];
        let value = |end, bound| match end {
            ProfileEnd::Value(value) => value,
            ProfileEnd::Bound => bound,
        };
        parameters[found.parameter] = Some(NearOptimal {
            lower: value(found.lower, interval.lower),
            upper: value(found.upper, interval.upper),
            mark: determination(&found),
        });
    }
    let evaluations = profile.n_evaluations() as u64;
    let identifiability = Identifiability {
        threshold: settings.threshold(cost),
        evaluations,
        complete,
    };
    Ok(Profiled {
        parameters,
        identifiability,
    })
}

/// Finds the ends of a profile to a twentieth of the interval, with few iterations in each refit,
/// because only the order of magnitude matters.
fn settings() -> Settings {
    let own = Settings::default();
    Settings {
        first_step: 0.1,
        precision: 0.05,
        refit: lbfgsb::Settings {
            max_iterations: 8,
            cost_tolerance: 1e-3,
            ..own.refit
        },
        ..own
    }
}

fn determination(found: &ProfiledParameter) -> Determination {
    match (found.lower, found.upper, found.mark) {
        (ProfileEnd::Bound, ProfileEnd::Bound, _) => Determination::NotDetermined,
        (_, _, Mark::Determined) => Determination::Determined,
        (_, _, Mark::Sloppy) => Determination::Sloppy,
        (_, _, Mark::AtBound) => Determination::AtBound,
    }
}
