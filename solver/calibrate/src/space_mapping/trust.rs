//! Trust region: the distance from the best run over which predictions held.

use super::run::Run;
use crate::fixed_point::Outcome;

/// Smallest and largest radius.
const RANGE: [f64; 2] = [0.02, 2.0];
/// Share of the predicted gain below which a step was too long.
const POOR: f64 = 0.25;
/// Share of the predicted gain above which the next step may be longer.
const GOOD: f64 = 0.75;

/// Radius after the last of `runs`, starting from `first`. `misfits` are those of the runs, `None`
/// if a run failed.
///
/// The radius shrinks to half the length of a step that gained little, and to a quarter of the
/// length of one that failed or lost the whole beat. It grows to twice the length of a step that
/// kept its promise.
pub(super) fn radius(
    runs: &[Run],
    misfits: &[Option<f64>],
    first: f64,
    is_whole: &dyn Fn(usize) -> bool,
) -> f64 {
    let mut radius = first;
    for last in 1..runs.len() {
        let best = |admits: &dyn Fn(usize) -> bool| {
            (0..last)
                .filter(|i| admits(*i))
                .filter_map(|i| Some((i, misfits[i]?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let Some((base, before)) = best(is_whole).or_else(|| best(&|_| true)) else {
            continue;
        };
        let length = runs[last]
            .x
            .iter()
            .zip(&runs[base].x)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        radius = match (&runs[last].outcome, misfits[last]) {
            (Outcome::Simulated(_), Some(_)) if !is_whole(base) => first,
            (Outcome::NoWholeBeat(_), Some(_)) if !is_whole(base) => radius,
            (Outcome::Simulated(_), Some(misfit)) => {
                // A run without a prediction says nothing about predictions.
                let Some(predicted) = runs[last].predicted_misfit else {
                    continue;
                };
                let share = (before - misfit)
                    / (before - predicted)
                        .max(1e-9 * before)
                        .max(f64::MIN_POSITIVE);
                if share < POOR {
                    0.5 * length
                } else if share > GOOD {
                    radius.max(2.0 * length)
                } else {
                    radius
                }
            }
            _ => 0.25 * length,
        }
        .clamp(RANGE[0], RANGE[1]);
    }
    radius
}
