//! Proposal of the next parameters from all runs so far.

use super::correction::{Correction, logarithms};
use super::minimise::{Effort, Near, Residuals, Where, distance, minimise};
use super::run::Run;
use super::trust;
use crate::Interval;
use crate::fixed_point::{Cost, Outcome, Weights};
use crate::truncated_normal::Prior;
use cardiotwin_vocabulary::biomarkers::{Biomarker, Biomarkers};
use serde::{Deserialize, Serialize};

/// Relative difference assigned to each biomarker if the cheap model cannot finish its beat.
const FAILED: f64 = 3.0;

/// A beat of the cheap model.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Outcome of the beat.
    pub outcome: Outcome,
    /// Residuals outside the biomarkers, over their standard deviations. Their number is the same
    /// for every beat, including failed ones. The correction adds their difference at the best run.
    pub also: Vec<f64>,
}

impl From<Outcome> for Trial {
    fn from(outcome: Outcome) -> Self {
        Self {
            outcome,
            also: Vec::new(),
        }
    }
}

/// Weights of the squared distance, in logarithms, from the start of a search. They select among
/// parameters with equal misfit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Nearness {
    /// Weight of the distance from the start, before the first run.
    pub at_first: f64,
    /// Weight of the distance from the best run.
    pub of_best: f64,
    /// Share that counts of the misfit that the correction's error is expected to add, from the second
    /// run on.
    pub of_doubt: f64,
}

/// Input of a proposal. A point holds the logarithms of the magnitudes of the moving parameters.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// Measured biomarkers, which are the targets.
    pub measured: &'a Biomarkers,
    /// Weights of the squared relative differences.
    pub weights: &'a Weights,
    /// All runs, oldest first.
    pub runs: &'a [Run],
    /// Starting point if there are no runs.
    pub start: &'a [f64],
    /// Search interval of each parameter.
    pub intervals: &'a [Interval],
    /// Priors of the parameters, which hold those that the biomarkers do not determine; empty for
    /// none.
    pub prior: &'a [Prior],
    /// Weights that hold parameters near the start or the best run.
    pub nearness: Nearness,
    /// Factors of the cheap model's biomarkers expected before any run, in the order of
    /// [`Biomarker::OF_ORGAN`].
    pub expected: [f64; Biomarker::OF_ORGAN.len()],
    /// Distance of the best run's biomarker from its measurement, as a logarithm, at which its own
    /// factor and the expected one count half each. If infinite, only the best run's factor counts.
    pub reach: [f64; Biomarker::OF_ORGAN.len()],
    /// Largest change of a logarithm in the first corrected step.
    pub first_radius: f64,
    /// Method and effort of the search.
    pub effort: Effort,
    /// Seed of the starting points of searches.
    pub seed: u64,
}

/// Next point to simulate, with the prediction for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// Point to simulate next.
    pub x: Vec<f64>,
    /// Biomarkers of the corrected cheap model at the point.
    pub biomarkers: Biomarkers,
    /// Cost of these biomarkers.
    pub cost: f64,
    /// Weighted misfit of these biomarkers: the minimised sum without prior and nearness.
    pub misfit: f64,
    /// Run at which the correction is exact and from which the step is measured; `None` before the
    /// first useful run.
    pub base: Option<usize>,
    /// Largest change of a parameter's logarithm that the trust region allowed.
    pub radius: Option<f64>,
    /// Largest change of a parameter's logarithm that was made.
    pub step: Option<f64>,
    /// Factors of the cheap model's biomarkers at the base.
    pub correction: Vec<(Biomarker, f64)>,
    /// Number of beats of the cheap model.
    pub cheap_beats: usize,
}

/// Proposes the next point to simulate; `None` if nothing is left to try. The function is pure if
/// `cheap` is.
///
/// Before the first run, the proposal is the optimum of the cheap model times the expected factors.
/// Afterwards it is the optimum of the cheap model times the correction, within the trust region
/// around the best run; the correction is exact at the best run if that is near the measurement
/// ([`Problem::reach`]). Runs without a whole beat guide the search by their available biomarkers
/// until there is a whole beat. A failed run shortens the step. If no run is useful, the start is
/// next.
pub fn propose(problem: &Problem<'_>, cheap: &dyn Fn(&[f64]) -> Trial) -> Option<Proposal> {
    let search = Search::new(problem, cheap);
    match search.base() {
        Some(base) => search.corrected(base),
        None if problem.runs.is_empty() => search.first(),
        None => search.without_any(),
    }
}

struct Search<'a> {
    problem: &'a Problem<'a>,
    cheap: &'a dyn Fn(&[f64]) -> Trial,
    /// Misfit of each run; `None` if it failed.
    misfits: Vec<Option<f64>>,
}

fn found(outcome: &Outcome) -> Option<&Biomarkers> {
    match outcome {
        Outcome::Simulated(found) | Outcome::NoWholeBeat(found) => Some(found),
        Outcome::Failed => None,
    }
}

/// Shift that makes the cheap model's other residuals exact at a run; empty if the cheap model
/// cannot finish its beat.
fn shift(run: &Run, trial: &Trial) -> Vec<f64> {
    let of_ended = found(&trial.outcome).is_some();
    if of_ended {
        run.also
            .iter()
            .zip(&trial.also)
            .map(|(run, cheap)| run - cheap)
            .collect()
    } else {
        Vec::new()
    }
}

/// Adds the shift to the residuals; residuals beyond the end of `shift` do not change.
fn shifted(residuals: &[f64], shift: &[f64]) -> Vec<f64> {
    let shift = shift.iter().copied().chain(std::iter::repeat(0.0));
    residuals
        .iter()
        .zip(shift)
        .map(|(residual, shift)| residual + shift)
        .collect()
}

/// Misfit that the correction's error is expected to add per distance from the base: the squared change
/// of the models' gap from the base to another run over their distance, the mean over the other runs; 0
/// without one. The gap is taken for a random walk, whose variance grows with the distance, because both
/// models are rough in the parameters.
fn doubt(gaps: &[(&[f64], Vec<f64>)], base: usize) -> f64 {
    let (x, gap) = &gaps[base];
    let others = gaps.iter().enumerate().filter(|(i, _)| *i != base);
    let rates: Vec<f64> = others
        .filter(|(_, (_, other))| other.len() == gap.len())
        .map(|(_, (at, other))| (distance(at, x), distance(other, gap)))
        .filter(|(moved, _)| *moved > 0.0)
        .map(|(moved, changed)| changed * changed / moved)
        .collect();
    rates.iter().sum::<f64>() / rates.len().max(1) as f64
}

fn sum_of_squares(residuals: &[f64]) -> f64 {
    residuals.iter().map(|r| r * r).sum()
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem<'a>, cheap: &'a dyn Fn(&[f64]) -> Trial) -> Self {
        let misfit = |run: &Run| {
            found(&run.outcome).map(|found| {
                problem.weights.misfit(problem.measured, found) + sum_of_squares(&run.also)
            })
        };
        Self {
            misfits: problem.runs.iter().map(misfit).collect(),
            problem,
            cheap,
        }
    }

    fn expected(&self) -> [f64; super::correction::N] {
        self.problem.expected.map(f64::ln)
    }

    /// Weight of the base's own factor per biomarker. It is 1 for a biomarker that meets the
    /// measurement and falls with the distance from it.
    fn weights_of_base(&self, base: usize) -> [f64; super::correction::N] {
        let found = found(&self.problem.runs[base].outcome);
        std::array::from_fn(|j| {
            let ratio = found
                .and_then(|found| found.ratio_to(self.problem.measured, Biomarker::OF_ORGAN[j]));
            ratio.map_or(1.0, |ratio| {
                1.0 / (1.0 + (ratio.ln() / self.problem.reach[j]).powi(2))
            })
        })
    }

    /// Residuals of a run less those of the cheap model there; empty if either lacks its beat.
    fn gap(&self, run: &Run, trial: &Trial) -> Vec<f64> {
        let Problem {
            measured, weights, ..
        } = self.problem;
        let residuals =
            |outcome: &Outcome| found(outcome).map(|found| weights.residuals(measured, found));
        match (residuals(&run.outcome), residuals(&trial.outcome)) {
            (Some(run_residuals), Some(cheap)) => run_residuals
                .iter()
                .zip(cheap)
                .map(|(run, cheap)| run - cheap)
                .chain(shift(run, trial))
                .collect(),
            _ => Vec::new(),
        }
    }

    fn is_whole(&self, run: usize) -> bool {
        matches!(self.problem.runs[run].outcome, Outcome::Simulated(_))
    }

    /// Index of the best whole run, or else of the best run that ended.
    fn base(&self) -> Option<usize> {
        let best = |whole: bool| {
            (0..self.misfits.len())
                .filter(|i| self.is_whole(*i) == whole)
                .filter_map(|i| Some((i, self.misfits[i]?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
        };
        best(true).or_else(|| best(false)).map(|(run, _)| run)
    }

    /// The box, restricted to a radius around a point. A point outside the box draws the step back
    /// into it.
    fn around(&self, centre: &[f64], radius: f64) -> Vec<Interval> {
        let cut = |(whole, x): (&Interval, &f64)| {
            Interval::new(whole.clamp(x - radius), whole.clamp(x + radius))
        };
        self.problem.intervals.iter().zip(centre).map(cut).collect()
    }

    fn clamped(x: &[f64], intervals: &[Interval]) -> Vec<f64> {
        x.iter()
            .zip(intervals)
            .map(|(x, interval)| interval.clamp(*x))
            .collect()
    }

    /// Optimum of the corrected cheap model in a box, with its promise.
    fn best(
        &self,
        correction: &Correction,
        shift: &[f64],
        near: &Near<'_>,
        intervals: &[Interval],
        start: Vec<f64>,
    ) -> Option<Proposal> {
        let Problem {
            measured,
            weights,
            prior,
            effort,
            seed,
            ..
        } = *self.problem;
        let residuals = |x: &[f64]| -> Residuals {
            let trial = (self.cheap)(x);
            let ended = found(&trial.outcome);
            let mut data: Vec<f64> = match ended {
                Some(found) => weights.residuals(measured, &correction.apply(x, found)),
                None => weights
                    .residuals(measured, &Biomarkers::default())
                    .iter()
                    .map(|r| FAILED * r)
                    .collect(),
            };
            data.extend(shifted(&trial.also, shift));
            Residuals {
                data,
                is_ended: ended.is_some(),
            }
        };
        let place = Where {
            start: &start,
            intervals,
            prior,
            near,
        };
        let (x, asked) = minimise(&residuals, &place, effort, seed);
        let x = x?;
        let trial = (self.cheap)(&x);
        let biomarkers = correction.apply(&x, found(&trial.outcome)?);
        Some(Proposal {
            x,
            biomarkers,
            cost: Cost::of(measured, &biomarkers).total,
            misfit: weights.misfit(measured, &biomarkers)
                + sum_of_squares(&shifted(&trial.also, shift)),
            base: None,
            radius: None,
            step: None,
            correction: Vec::new(),
            cheap_beats: asked + 1,
        })
    }

    fn first(&self) -> Option<Proposal> {
        let Problem {
            intervals,
            start,
            nearness,
            ..
        } = *self.problem;
        let start = Self::clamped(start, intervals);
        let correction = Correction::expected(start.len(), self.expected());
        self.best(
            &correction,
            &[],
            &Near {
                x: &start,
                weight: nearness.at_first,
                doubt: 0.0,
            },
            intervals,
            start.clone(),
        )
    }

    fn corrected(&self, base: usize) -> Option<Proposal> {
        let runs = self.problem.runs;
        let is_whole = |run: usize| self.is_whole(run);
        let radius = trust::radius(runs, &self.misfits, self.problem.first_radius, &is_whole);
        let centre = &runs[base].x;
        // Runs with a whole beat say little about the surroundings of a base without one, and vice
        // versa.
        let used: Vec<usize> = (0..runs.len())
            .filter(|i| self.is_whole(*i) == self.is_whole(base) && self.misfits[*i].is_some())
            .collect();
        let trials: Vec<Trial> = used.iter().map(|i| (self.cheap)(&runs[*i].x)).collect();
        let factors =
            |(run, trial): (&Run, &Trial)| match (found(&run.outcome), found(&trial.outcome)) {
                (Some(expensive), Some(cheap)) => (run.x.clone(), logarithms(expensive, cheap)),
                _ => (run.x.clone(), [None; super::correction::N]),
            };
        let all: Vec<_> = used
            .iter()
            .map(|i| &runs[*i])
            .zip(&trials)
            .map(factors)
            .collect();
        let position = used.iter().position(|i| *i == base)?;
        let correction =
            Correction::of(position, &all, self.expected(), &self.weights_of_base(base));
        let intervals = self.around(centre, radius);
        let start = Self::clamped(centre, &intervals);
        let shift = shift(&runs[base], &trials[position]);
        let nearness = self.problem.nearness;
        let gaps: Vec<(&[f64], Vec<f64>)> = used
            .iter()
            .zip(&trials)
            .map(|(i, trial)| (&runs[*i].x[..], self.gap(&runs[*i], trial)))
            .collect();
        let mut proposal = self.best(
            &correction,
            &shift,
            &Near {
                x: centre,
                weight: nearness.of_best,
                doubt: nearness.of_doubt * doubt(&gaps, position),
            },
            &intervals,
            start,
        )?;
        let step = proposal
            .x
            .iter()
            .zip(centre)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        proposal.base = Some(base);
        proposal.radius = Some(radius);
        proposal.step = Some(step);
        let is_measured =
            |(biomarker, _): &(Biomarker, f64)| self.problem.measured.get(*biomarker).is_some();
        proposal.correction = Biomarker::OF_ORGAN
            .into_iter()
            .zip(correction.factors())
            .filter(is_measured)
            .collect();
        proposal.cheap_beats += used.len();
        Some(proposal)
    }

    /// Proposal if no run ended: the start, then points between it and the first run.
    fn without_any(&self) -> Option<Proposal> {
        let Problem {
            measured,
            weights,
            runs,
            start,
            ..
        } = *self.problem;
        let far = &runs.first()?.x;
        let share = *[1.0, 0.5, 0.75, 0.25].get(runs.len() - 1)?;
        let x: Vec<f64> = start
            .iter()
            .zip(far)
            .map(|(i, f)| f + share * (i - f))
            .collect();
        let biomarkers = found(&(self.cheap)(&x).outcome)
            .copied()
            .unwrap_or_default();
        Some(Proposal {
            x,
            biomarkers,
            cost: Cost::of(measured, &biomarkers).total,
            misfit: weights.misfit(measured, &biomarkers),
            base: None,
            radius: None,
            step: None,
            correction: Vec::new(),
            cheap_beats: 1,
        })
    }
}
