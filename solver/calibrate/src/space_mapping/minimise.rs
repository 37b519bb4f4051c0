//! Minimisation of the corrected cheap model within a box.

use crate::cma_es::{self, CmaEs};
use crate::descent::{Aim, Descent, Evaluated};
use crate::least_squares::{self, Settings};
use crate::normal::quantile;
use crate::random::{Purpose, generator};
use crate::truncated_normal::{Prior, TruncatedNormal};
use crate::{Interval, latin_hypercube};
use rand::Rng as _;
use serde::{Deserialize, Serialize};
use std::cell::Cell;

/// Distance over which the doubt is smoothed in descents, a logarithm.
const SMOOTHED: f64 = 0.05;
/// Largest standard coordinate of a start. A point on a bound would not move.
const FARTHEST: f64 = 2.5;

/// Method and effort of a search.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Effort {
    /// Local gradient searches from the best points of a hypercube.
    Gradients {
        /// Number of points of a Latin hypercube evaluated before the local searches.
        points: usize,
        /// Number of local searches from the best of these points, in addition to the one from the
        /// start.
        best: usize,
        /// Limits of a local search.
        local: Settings,
    },
    /// Evolution of a population from the start, then one local search; for a rough model with many
    /// parameters.
    Evolution {
        /// Number of evaluations after which no generation starts.
        evaluations: usize,
        /// Number of candidates per generation.
        candidates: usize,
        /// Standard deviation of the first generation over the widths of the intervals.
        deviation: f64,
        /// Limits of the local search.
        local: Settings,
    },
    /// Gauss–Newton descents in the coordinates in which the prior is standard normal; for a smooth
    /// model with many parameters and residuals. The prior must not be empty.
    Descents {
        /// Number of random points around the start that are evaluated before the descents.
        points: usize,
        /// Number of descents from the best of these points, in addition to the one from the start.
        best: usize,
        /// Standard deviation of the points, over that of the prior.
        spread: f64,
        /// Largest number of steps of a descent.
        steps: usize,
        /// Weight of the squared distance from the prior's centre, in standard deviations.
        weight_of_prior: f64,
    },
}

/// Residuals of the corrected cheap model at a point.
pub(super) struct Residuals {
    /// Residuals of biomarkers and traces, over their standard deviations.
    pub(super) data: Vec<f64>,
    /// Whether the cheap model finished its beat.
    pub(super) is_ended: bool,
}

/// Point that a search is held near.
pub(super) struct Near<'a> {
    pub(super) x: &'a [f64],
    /// Weight of the squared distance.
    pub(super) weight: f64,
    /// Misfit that the correction's error adds per distance.
    pub(super) doubt: f64,
}

/// Where a search starts, and what holds it.
pub(super) struct Where<'a> {
    pub(super) start: &'a [f64],
    pub(super) intervals: &'a [Interval],
    /// Priors of the parameters; empty for none.
    pub(super) prior: &'a [Prior],
    pub(super) near: &'a Near<'a>,
}

pub(super) fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

impl Where<'_> {
    /// Residuals of data, nearness, doubt and prior.
    fn all(&self, x: &[f64], residuals: Residuals) -> Vec<f64> {
        let near = self.near;
        let weight = near.weight.sqrt();
        let mut all = residuals.data;
        all.extend(x.iter().zip(near.x).map(|(x, near)| weight * (x - near)));
        all.push((near.doubt * distance(x, near.x)).sqrt());
        all.extend(
            x.iter()
                .zip(self.prior)
                .map(|(x, prior)| (x - prior.centre) / prior.width),
        );
        all
    }

    /// Residuals of data, nearness and doubt. A descent's own coordinates hold the prior.
    ///
    /// The doubt d |x − x₀| is spread over the coordinates, as d |x − x₀|²/(|x − x₀| + ε), so that
    /// its derivatives stay finite near x₀.
    fn without_prior(&self, x: &[f64], residuals: Residuals) -> Vec<f64> {
        let near = self.near;
        let of_doubt = near.doubt / (distance(x, near.x) + SMOOTHED);
        let weight = (near.weight + of_doubt).sqrt();
        let mut all = residuals.data;
        all.extend(x.iter().zip(near.x).map(|(x, near)| weight * (x - near)));
        all
    }
}

/// The lowest sum of squares found and the number of evaluations; `None` if no sum is finite.
pub(super) fn minimise(
    model: &dyn Fn(&[f64]) -> Residuals,
    place: &Where<'_>,
    effort: Effort,
    seed: u64,
) -> (Option<Vec<f64>>, usize) {
    let asked = Cell::new(0);
    let counted_model = |x: &[f64]| {
        asked.set(asked.get() + 1);
        model(x)
    };
    let counted = |x: &[f64]| place.all(x, counted_model(x));
    let cost = |x: &[f64]| counted(x).iter().map(|r| r * r).sum::<f64>();
    let Where {
        start, intervals, ..
    } = *place;
    let (starts, local) = match effort {
        Effort::Gradients {
            points,
            best,
            local,
        } => {
            let mut found: Vec<(f64, Vec<f64>)> = latin_hypercube::sample(intervals, points, seed)
                .unwrap_or_default()
                .into_iter()
                .map(|x| (cost(&x), x))
                .collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            found.truncate(best);
            (
                std::iter::once(start.to_vec())
                    .chain(found.into_iter().map(|(_, x)| x))
                    .collect(),
                local,
            )
        }
        Effort::Evolution {
            evaluations,
            candidates,
            deviation,
            local,
        } => {
            let settings = cma_es::Settings {
                n_candidates: Some(candidates),
                first_deviation: deviation,
                max_evaluations: evaluations,
                seed,
                ..cma_es::Settings::default()
            };
            (
                vec![evolve(&cost, start, intervals, settings).unwrap_or_else(|| start.to_vec())],
                local,
            )
        }
        Effort::Descents {
            points,
            best,
            spread,
            steps,
            weight_of_prior,
        } => {
            let descents = Descents {
                points,
                best,
                spread,
                steps,
                weight_of_prior,
            };
            let found = descend(&counted_model, place, descents, seed);
            return (found, asked.get());
        }
    };
    let mut best: Option<(f64, Vec<f64>)> = None;
    for start in starts {
        let Ok(fit) = least_squares::fit(&counted, &start, intervals, local) else {
            continue;
        };
        if best
            .as_ref()
            .is_none_or(|(lowest, _)| fit.sum_of_squares < *lowest)
        {
            best = Some((fit.sum_of_squares, fit.parameters));
        }
    }
    (best.map(|(_, x)| x), asked.get())
}

/// As [`Effort::Descents`].
struct Descents {
    points: usize,
    best: usize,
    spread: f64,
    steps: usize,
    weight_of_prior: f64,
}

/// Lowest end of descents from the start and from the best of random points around it.
fn descend(
    model: &dyn Fn(&[f64]) -> Residuals,
    place: &Where<'_>,
    Descents {
        points,
        best,
        spread,
        steps,
        weight_of_prior,
    }: Descents,
    seed: u64,
) -> Option<Vec<f64>> {
    let axes: Vec<TruncatedNormal> = place
        .prior
        .iter()
        .zip(place.intervals)
        .map(|(prior, interval)| TruncatedNormal::new(*prior, *interval))
        .collect();
    let parameters = |u: &[f64]| -> Vec<f64> {
        u.iter()
            .zip(&axes)
            .map(|(u, axis)| axis.from_standard(*u))
            .collect()
    };
    let at = |u: &[f64]| {
        let x = parameters(u);
        let found = model(&x);
        let residuals = found
            .is_ended
            .then(|| place.without_prior(&x, found))
            .filter(|all| all.iter().all(|r| r.is_finite()))?;
        let seen = ();
        Some(Evaluated { residuals, seen })
    };
    let height = |u: &[f64], residuals: &[f64]| -> f64 {
        let square = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
        weight_of_prior * square(u) + square(residuals)
    };
    let start: Vec<f64> = place
        .start
        .iter()
        .zip(&axes)
        .map(|(x, axis)| axis.to_standard(*x).clamp(-FARTHEST, FARTHEST))
        .collect();
    let mut random = generator(seed, Purpose::Descents, [0, 0]);
    let mut around: Vec<(f64, Vec<f64>)> = (0..points)
        .filter_map(|_| {
            let u: Vec<f64> = start
                .iter()
                .map(|u| u + spread * quantile(random.random::<f64>().max(f64::MIN_POSITIVE)))
                .collect();
            Some((height(&u, &at(&u)?.residuals), u))
        })
        .collect();
    around.sort_by(|a, b| a.0.total_cmp(&b.0));
    around.truncate(best);
    let mut lowest: Option<(f64, Vec<f64>)> = None;
    for start in std::iter::once(start).chain(around.into_iter().map(|(_, u)| u)) {
        let Some(found) = at(&start) else { continue };
        let aim = Aim {
            errors: vec![0.0; found.residuals.len()],
            prior: vec![0.0; start.len()],
            weight: weight_of_prior,
        };
        let mut descent = Descent {
            model: &at,
            aim,
            evaluations: 0,
        };
        let Some(end) = descent.from(start, found, steps) else {
            continue;
        };
        let reached = height(&end.u, &end.found.residuals);
        if lowest.as_ref().is_none_or(|(least, _)| reached < *least) {
            lowest = Some((reached, end.u));
        }
    }
    lowest.map(|(_, u)| parameters(&u))
}

/// Best member of a population that starts at `start`; `None` if the settings are invalid.
fn evolve(
    cost: &dyn Fn(&[f64]) -> f64,
    start: &[f64],
    intervals: &[Interval],
    settings: cma_es::Settings,
) -> Option<Vec<f64>> {
    let mut population = CmaEs::new(intervals, &[start.to_vec()], settings).ok()?;
    while !population.is_ended() {
        let costs: Vec<f64> = population.ask().iter().map(|x| cost(x)).collect();
        population.tell(&costs).ok()?;
    }
    Some(population.best().0)
}
