//! The corrected cheap model's best parameters in a box.

use crate::least_squares::{self, Settings};
use crate::{Interval, latin_hypercube};
use std::cell::Cell;

/// Points that are looked at before the local searches begin.
const N_POINTS: usize = 48;
/// Local searches from the best of them, beside those from given starts.
const N_BEST: usize = 2;
/// The model is rough at a thousandth; more precise steps are not worth their beats.
const LOCAL: Settings = Settings { cost_tolerance: 1e-4, step_tolerance: 1e-4, max_steps: 25 };

/// The lowest sum of squares found, and how often the model was asked. `None` where none is finite.
pub(super) fn minimise(
    residuals: &dyn Fn(&[f64]) -> Vec<f64>,
    starts: &[Vec<f64>],
    intervals: &[Interval],
    seed: u64,
) -> (Option<Vec<f64>>, usize) {
    let asked = Cell::new(0);
    let counted = |x: &[f64]| {
        asked.set(asked.get() + 1);
        residuals(x)
    };
    let cost = |x: &[f64]| counted(x).iter().map(|r| r * r).sum::<f64>();
    let mut found: Vec<(f64, Vec<f64>)> = latin_hypercube::sample(intervals, N_POINTS, seed)
        .unwrap_or_default()
        .into_iter()
        .map(|x| (cost(&x), x))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(N_BEST);
    let mut best: Option<(f64, Vec<f64>)> = None;
    for start in starts.iter().chain(found.iter().map(|(_, x)| x)) {
        let Ok(fit) = least_squares::fit(&counted, start, intervals, LOCAL) else { continue };
        if best.as_ref().is_none_or(|(lowest, _)| fit.sum_of_squares < *lowest) {
            best = Some((fit.sum_of_squares, fit.parameters));
        }
    }
    (best.map(|(_, x)| x), asked.get())
}
