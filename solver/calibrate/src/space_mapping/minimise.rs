//! The corrected cheap model's best parameters in a box.

use crate::cma_es::{self, CmaEs};
use crate::least_squares::{self, Settings};
use crate::{Interval, latin_hypercube};
use serde::{Deserialize, Serialize};
use std::cell::Cell;

/// How a search goes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Effort {
    /// Local searches by gradients.
    Gradients {
        /// Points of a Latin hypercube that are looked at before the local searches begin.
        points: usize,
        /// Local searches from the best of them, beside the one from the start.
        best: usize,
        /// Limits of a local search.
        local: Settings,
    },
    /// Evolution of a population from the start, for a model that is rough and has many parameters; then one local search.
    Evolution {
        /// Evaluations after which no generation begins.
        evaluations: usize,
        /// Candidates of a generation.
        candidates: usize,
        /// Standard deviation of the first generation over the widths of the intervals.
        deviation: f64,
        /// Limits of the local search.
        local: Settings,
    },
}

/// The lowest sum of squares found, and how often the model was asked. `None` where none is finite.
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

/// The best member of a population that begins at `start`; none where the settings make no sense.
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
