//! The next parameters from all runs so far.

use super::correction::{Correction, logarithms};
use super::minimise::minimise;
use super::trust;
use crate::Interval;
use crate::fixed_point::{Biomarker, Biomarkers, Bounds, Cost, Outcome, PARAMETERS, Parameter, Parameters, Settings};
use serde::{Deserialize, Serialize};

/// Weight of the squared distance of the logarithms from the best run: chooses among parameters that serve alike.
const NEARNESS: f64 = 0.005;
/// The same before the first run, from the initial guess.
const NEARNESS_AT_FIRST: f64 = 0.05;
/// Residual of each biomarker where the cheap model cannot even end its beat.
const FAILED: f64 = 3.0;

/// A run of the expensive model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// What was simulated.
    pub parameters: Parameters,
    /// What came of it.
    pub outcome: Outcome,
    /// Misfit of the corrected cheap model there, where a proposal led to it.
    pub predicted_misfit: Option<f64>,
}

/// Everything that a proposal follows from.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// What is to be reached.
    pub measured: &'a Biomarkers,
    /// All runs, oldest first.
    pub runs: &'a [Run],
    /// Initial guess: frozen parameters have its values.
    pub initial: &'a Parameters,
    /// Bounds, frozen parameters, weights of the biomarkers.
    pub settings: &'a Settings,
    /// Factors of the cheap model's biomarkers that are expected before any run, in the order of [`Biomarker::ALL`].
    pub expected: [f64; Biomarker::ALL.len()],
    /// For the points from which searches start.
    pub seed: u64,
}

/// The next parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// To be simulated next.
    pub parameters: Parameters,
    /// What the corrected cheap model gives there.
    pub biomarkers: Biomarkers,
    /// Its cost.
    pub cost: f64,
    /// Its misfit by the settings' weights: what was minimised, but for nearness.
    pub misfit: f64,
    /// The run that the correction is exact at, and the step is measured from; none before the first of use.
    pub base: Option<usize>,
    /// Largest change of a parameter's logarithm from there that was allowed.
    pub radius: Option<f64>,
    /// Largest change that was made.
    pub step: Option<f64>,
    /// Factors of the cheap model's biomarkers at the base.
    pub correction: Vec<(Biomarker, f64)>,
    /// Beats of the cheap model.
    pub cheap_beats: usize,
}

/// Interval in which a proposal looks for a parameter, cut by the settings' bounds: what hearts have.
#[must_use]
pub fn plausible(parameter: Parameter) -> Bounds {
    let (lower, upper) = match parameter {
        Parameter::SmaxRef => (20.0, 600.0),
        Parameter::TauSrRef => (0.3, 150.0),
        Parameter::TauSd => (3.0, 300.0),
        Parameter::TCr => (80.0, 700.0),
        Parameter::RAvF => (1e-4, 0.1),
        Parameter::RMvF => (1e-3, 0.3),
    };
    Bounds { lower, upper }
}

/// What to simulate next: a pure function, if `cheap` is one. None when nothing is left to try.
///
/// Before the first run the optimum of the cheap model times what is expected; then that of the cheap model times the correction, which makes it
/// exact at the best run, within the trust region around that. A run without a whole beat leads on until there is a whole
/// one, by the biomarkers that it has; one that failed shortens the step. Where no run is of use, the initial guess is next.
pub fn propose(problem: &Problem<'_>, cheap: &dyn Fn(&Parameters) -> Outcome) -> Option<Proposal> {
    let search = Search::new(problem, cheap);
    match search.base() {
        Some(base) => search.corrected(base),
        None if problem.runs.is_empty() => search.first(),
        None => search.without_any(),
    }
}

struct Search<'a> {
    problem: &'a Problem<'a>,
    cheap: &'a dyn Fn(&Parameters) -> Outcome,
    /// Parameters that may move.
    moving: Vec<Parameter>,
    /// Logarithms of each run's moving parameters.
    x: Vec<Vec<f64>>,
    /// Misfit of each run; none where it failed.
    misfits: Vec<Option<f64>>,
}

fn found(outcome: &Outcome) -> Option<&Biomarkers> {
    match outcome {
        Outcome::Simulated(found) | Outcome::NoWholeBeat(found) => Some(found),
        Outcome::Failed => None,
    }
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem<'a>, cheap: &'a dyn Fn(&Parameters) -> Outcome) -> Self {
        // What no measured biomarker speaks of stays, as with the fixed point.
        let moves =
            |p: &Parameter| !problem.settings.frozen.contains(p) && problem.measured.get(p.driver().0).is_some();
        let moving: Vec<Parameter> = PARAMETERS.into_iter().filter(moves).collect();
        let misfit =
            |run: &Run| found(&run.outcome).map(|found| problem.settings.weights.misfit(problem.measured, found));
        Self {
            x: problem.runs.iter().map(|run| logarithms_of(&moving, &run.parameters)).collect(),
            misfits: problem.runs.iter().map(misfit).collect(),
            problem,
            cheap,
            moving,
        }
    }

    fn expected(&self) -> [f64; super::correction::N] {
        self.problem.expected.map(f64::ln)
    }

    fn is_whole(&self, run: usize) -> bool {
        matches!(self.problem.runs[run].outcome, Outcome::Simulated(_))
    }

    /// The best whole run, else the best of those that ended.
    fn base(&self) -> Option<usize> {
        let best = |whole: bool| {
            (0..self.x.len())
                .filter(|i| self.is_whole(*i) == whole)
                .filter_map(|i| Some((i, self.misfits[i]?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
        };
        best(true).or_else(|| best(false)).map(|(run, _)| run)
    }

    /// Logarithms of the box, around `centre` where there is one.
    fn intervals(&self, around: Option<(&[f64], f64)>) -> Vec<Interval> {
        let interval = |(k, parameter): (usize, &Parameter)| {
            let (inner, outer) = (plausible(*parameter), self.problem.settings.bounds_of(*parameter));
            let (mut lower, mut upper) = (inner.lower.max(outer.lower), inner.upper.min(outer.upper));
            if lower > upper {
                (lower, upper) = (outer.lower, outer.upper);
            }
            let whole = Interval::new(lower.ln(), upper.ln());
            match around {
                None => whole,
                // A base outside the box draws the step back into it.
                Some((centre, radius)) => {
                    Interval::new(whole.clamp(centre[k] - radius), whole.clamp(centre[k] + radius))
                }
            }
        };
        self.moving.iter().enumerate().map(interval).collect()
    }

    fn parameters(&self, x: &[f64]) -> Parameters {
        let mut parameters = *self.problem.initial;
        self.moving.iter().zip(x).for_each(|(parameter, x)| parameters.set(*parameter, x.exp()));
        parameters
    }

    /// The best of the corrected cheap model in a box, with what it promises.
    fn best(
        &self,
        correction: &Correction,
        (near, weight): (&[f64], f64),
        intervals: &[Interval],
        starts: &[Vec<f64>],
    ) -> Option<Proposal> {
        let measured = self.problem.measured;
        let weights = &self.problem.settings.weights;
        let n_terms = weights.residuals(measured, measured).len();
        let residuals = |x: &[f64]| -> Vec<f64> {
            let mut all: Vec<f64> = match found(&(self.cheap)(&self.parameters(x))) {
                Some(found) => weights.residuals(measured, &correction.apply(x, found)),
                None => vec![FAILED; n_terms],
            };
            all.extend(x.iter().zip(near).map(|(x, near)| weight.sqrt() * (x - near)));
            all
        };
        let (x, asked) = minimise(&residuals, starts, intervals, self.problem.seed);
        let x = x?;
        let parameters = self.parameters(&x);
        let outcome = (self.cheap)(&parameters);
        let biomarkers = correction.apply(&x, found(&outcome)?);
        Some(Proposal {
            parameters,
            biomarkers,
            cost: Cost::of(measured, &biomarkers).total,
            misfit: weights.misfit(measured, &biomarkers),
            base: None,
            radius: None,
            step: None,
            correction: Vec::new(),
            cheap_beats: asked + 1,
        })
    }

    fn first(&self) -> Option<Proposal> {
        let intervals = self.intervals(None);
        let initial = logarithms_of(&self.moving, self.problem.initial);
        let start: Vec<f64> = initial.iter().zip(&intervals).map(|(x, i)| i.clamp(*x)).collect();
        let correction = Correction::expected(self.moving.len(), self.expected());
        self.best(&correction, (&start, NEARNESS_AT_FIRST), &intervals, std::slice::from_ref(&start))
    }

    fn corrected(&self, base: usize) -> Option<Proposal> {
        let runs = self.problem.runs;
        let is_whole = |run: usize| self.is_whole(run);
        let radius = trust::radius(runs, &self.x, &self.misfits, &is_whole);
        let centre = &self.x[base];
        // Runs of another kind than the base say little of its surroundings.
        let used: Vec<usize> = (0..runs.len())
            .filter(|i| self.is_whole(*i) == self.is_whole(base) && self.misfits[*i].is_some())
            .collect();
        let factors = |i: usize| {
            let cheap = (self.cheap)(&self.parameters(&self.x[i]));
            let (Some(expensive), Some(cheap)) = (found(&runs[i].outcome), found(&cheap)) else {
                return (self.x[i].clone(), [None; super::correction::N]);
            };
            (self.x[i].clone(), logarithms(expensive, cheap))
        };
        let all: Vec<_> = used.iter().map(|i| factors(*i)).collect();
        let position = used.iter().position(|i| *i == base)?;
        let correction = Correction::of(position, &all, self.expected());
        let intervals = self.intervals(Some((centre, radius)));
        let start: Vec<f64> = centre.iter().zip(&intervals).map(|(x, i)| i.clamp(*x)).collect();
        let mut proposal = self.best(&correction, (centre, NEARNESS), &intervals, &[start])?;
        let x = logarithms_of(&self.moving, &proposal.parameters);
        proposal.base = Some(base);
        proposal.radius = Some(radius);
        proposal.step = Some(x.iter().zip(centre).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max));
        let is_measured = |(biomarker, _): &(Biomarker, f64)| self.problem.measured.get(*biomarker).is_some();
        proposal.correction = Biomarker::ALL.into_iter().zip(correction.factors()).filter(is_measured).collect();
        proposal.cheap_beats += used.len();
        Some(proposal)
    }

    /// No run ended: the initial guess, then points between it and the first run.
    fn without_any(&self) -> Option<Proposal> {
        let initial = logarithms_of(&self.moving, &self.problem.settings.clamp(self.problem.initial));
        let far = self.x.first()?;
        let share = *[1.0, 0.5, 0.75, 0.25].get(self.x.len() - 1)?;
        let x: Vec<f64> = initial.iter().zip(far).map(|(i, f)| f + share * (i - f)).collect();
        let parameters = self.parameters(&x);
        let biomarkers = found(&(self.cheap)(&parameters)).copied().unwrap_or_default();
        Some(Proposal {
            parameters,
            biomarkers,
            cost: Cost::of(self.problem.measured, &biomarkers).total,
            misfit: self.problem.settings.weights.misfit(self.problem.measured, &biomarkers),
            base: None,
            radius: None,
            step: None,
            correction: Vec::new(),
            cheap_beats: 1,
        })
    }
}

fn logarithms_of(moving: &[Parameter], parameters: &Parameters) -> Vec<f64> {
    moving.iter().map(|parameter| parameters.get(*parameter).ln()).collect()
}
