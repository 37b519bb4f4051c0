//! Space mapping of step 1: logarithms of its six parameters within physiological ranges.

use super::{Effort, Nearness, Problem, Run, propose};
use crate::fixed_point::{Outcome, Weights, driver};
use crate::{Interval, least_squares};
use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_vocabulary::step1::{Step1Parameter, Step1Parameters};
use cardiotwin_vocabulary::step1_settings::{Bounds, Step1Settings};
use serde::{Deserialize, Serialize};

/// Largest change of a parameter's logarithm in the first corrected step, in which the correction
/// rests on a single run.
pub const FIRST_RADIUS: f64 = 1.0;

/// The model is rough at a thousandth; more precise steps are not worth their beats.
const EFFORT: Effort = Effort::Gradients {
    points: 48,
    best: 2,
    local: least_squares::Settings {
        cost_tolerance: 1e-4,
        step_tolerance: 1e-4,
        max_steps: 25,
        difference_step: 1e-5,
    },
};

/// Weight of the distance from the start before the first run, if the cheap model may be wrong by a
/// fifth. It keeps the first run where the model's error is known from other patients.
const NEARNESS_AT_FIRST: f64 = 0.05;
/// Weight of the distance from a point that is trusted. It only selects among equal misfits.
const NEARNESS: f64 = 0.005;

/// A simulation of step 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Step1Run {
    /// Parameters with which the organ was simulated.
    pub parameters: Step1Parameters,
    /// Outcome of the simulation.
    pub outcome: Outcome,
    /// Misfit of the corrected cheap model at these parameters; `None` if no proposal led to them.
    pub predicted_misfit: Option<f64>,
}

/// Input of a proposal of step 1.
#[derive(Debug, Clone, Copy)]
pub struct Step1Problem<'a> {
    /// Measured biomarkers, which are the targets.
    pub measured: &'a Biomarkers,
    /// All runs, oldest first.
    pub runs: &'a [Step1Run],
    /// Initial guess, which gives the values of frozen parameters.
    pub initial: &'a Step1Parameters,
    /// Bounds and frozen parameters.
    pub settings: &'a Step1Settings,
    /// Weights of the biomarkers.
    pub weights: &'a Weights,
    /// Expected correction factors, as in [`Problem::expected`].
    pub expected: [f64; Biomarker::OF_ORGAN.len()],
    /// Whether the cheap model is as right before the first run as after it, so that the first run need
    /// not stay near the initial guess.
    pub is_trusted: bool,
    /// Seed of the starting points of searches.
    pub seed: u64,
}

/// Interval in which a proposal searches for a parameter, from physiological values; the settings'
/// bounds restrict it further.
#[must_use]
pub fn plausible(parameter: Step1Parameter) -> Bounds {
    let (lower, upper) = match parameter {
        Step1Parameter::SmaxRef => (20.0, 600.0),
        Step1Parameter::TauSrRef => (0.3, 150.0),
        Step1Parameter::TauSd => (3.0, 300.0),
        Step1Parameter::TCr => (80.0, 700.0),
        Step1Parameter::RAvF => (1e-4, 0.1),
        Step1Parameter::RMvF => (1e-3, 0.3),
    };
    Bounds { lower, upper }
}

/// The next parameters of step 1 and their proposal, by [`propose()`].
pub fn propose_step1(
    problem: &Step1Problem<'_>,
    cheap: &dyn Fn(&Step1Parameters) -> Outcome,
) -> Option<(Step1Parameters, super::Proposal)> {
    // As in the fixed point, parameters keep their value if no measured biomarker depends on them.
    let moves = |p: &Step1Parameter| {
        !problem.settings.is_frozen(*p) && problem.measured.get(driver(*p).0).is_some()
    };
    let moving: Vec<Step1Parameter> = Step1Parameter::ALL.into_iter().filter(moves).collect();
    let logarithms = |p: &Step1Parameters| -> Vec<f64> {
        moving
            .iter()
            .map(|parameter| p.get(*parameter).ln())
            .collect()
    };
    let parameters = |x: &[f64]| {
        let mut parameters = *problem.initial;
        moving
            .iter()
            .zip(x)
            .for_each(|(parameter, x)| parameters.set(*parameter, x.exp()));
        parameters
    };
    let run = |run: &Step1Run| Run {
        x: logarithms(&run.parameters),
        outcome: run.outcome,
        also: Vec::new(),
        predicted_misfit: run.predicted_misfit,
    };
    let runs: Vec<Run> = problem.runs.iter().map(run).collect();
    let intervals: Vec<Interval> = moving
        .iter()
        .map(|parameter| interval(*parameter, problem.settings))
        .collect();
    let general = Problem {
        measured: problem.measured,
        weights: problem.weights,
        runs: &runs,
        start: &logarithms(&problem.settings.clamp(problem.initial)),
        intervals: &intervals,
        prior: &[],
        nearness: Nearness {
            at_first: if problem.is_trusted {
                NEARNESS
            } else {
                NEARNESS_AT_FIRST
            },
            of_best: NEARNESS,
            of_doubt: 0.0,
        },
        expected: problem.expected,
        reach: [f64::INFINITY; Biomarker::OF_ORGAN.len()],
        first_radius: FIRST_RADIUS,
        effort: EFFORT,
        seed: problem.seed,
    };
    let proposal = propose(&general, &|x| cheap(&parameters(x)).into())?;
    Some((parameters(&proposal.x), proposal))
}

fn interval(parameter: Step1Parameter, settings: &Step1Settings) -> Interval {
    let (inner, outer) = (plausible(parameter), settings.bounds_of(parameter));
    // The interval is for logarithms, so that the lower bound must be positive.
    let outer_lower = outer.lower.max(1e-9);
    let (mut lower, mut upper) = (inner.lower.max(outer_lower), inner.upper.min(outer.upper));
    if lower > upper {
        (lower, upper) = (outer_lower, outer.upper);
    }
    Interval::new(lower.ln(), upper.ln())
}
