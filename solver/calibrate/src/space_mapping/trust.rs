//! How far the next parameters may lie from the best run: as far as predictions held.

use super::Run;
use crate::fixed_point::Outcome;

/// Smallest and largest radius.
const RANGE: [f64; 2] = [0.02, 2.0];
/// A step that gains less than this share of what was predicted was too long …
const POOR: f64 = 0.25;
/// … and one that gains more than this share may be longer.
const GOOD: f64 = 0.75;

/// The radius after the last of `runs`, beginning with `first`; `misfits` are theirs, none where a run failed.
///
/// Shrinks to half the length of a step that gained little, to a quarter of one that ended without a whole beat; grows to
/// twice the length of one that kept what it promised.
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
                // A run that nobody predicted says nothing of predictions.
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
