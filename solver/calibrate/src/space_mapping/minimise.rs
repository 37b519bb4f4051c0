//! Minimisation of the corrected cheap model within a box.

use crate::cma_es::{self, CmaEs};
use crate::least_squares::{self, Settings};
use crate::{Interval, latin_hypercube};
use serde::{Deserialize, Serialize};
use std::cell::Cell;

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
}

/// The lowest sum of squares found and the number of evaluations; `None` if no sum is finite.
pub(super) fn minimise(
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
    start: &[f64],
    intervals: &[Interval],
    effort: Effort,
    seed: u64,
) -> (Option<Vec<f64>>, usize) {
    let asked = Cell::new(0);
    let counted = |x: &[f64]| {
        asked.set(asked.get() + 1);
        residuals(x)
    };
    let cost = |x: &[f64]| counted(x).iter().map(|r| r * r).sum::<f64>();
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
