//! A draw of a posterior, and the random numbers that define it.

use rand::Rng;
use rand_pcg::Pcg64;

use super::mode::Mode;
use crate::normal::quantile;

/// Number of standard deviations above its expected value at which the final height of a draw
/// counts as too high.
const FARTHEST: f64 = 3.0;

/// A draw of a posterior.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw<Q> {
    /// Draw in standard coordinates.
    pub u: Vec<f64>,
    /// Further quantities of the model at the draw.
    pub seen: Q,
    /// Whether the descent ended by itself, at a height that errors and prior make plausible.
    pub converged: bool,
    /// Number of evaluations of the model.
    pub evaluations: usize,
}

/// Height above which the end of a draw is not plausible. For a linear model: half of the χ² that the
/// errors add to the data, and the cross term with the residuals at the mode.
pub(super) fn farthest(mode: &Mode) -> f64 {
    let m = mode.residuals.len() as f64;
    let left: f64 = mode.residuals.iter().map(|r| r * r).sum();
    mode.height() + 0.5 * m + FARTHEST * (0.5 * m + left).sqrt()
}

/// Independent standard normal deviates.
pub(super) fn deviates(generator: &mut Pcg64, n: usize) -> Vec<f64> {
    (0..n)
        .map(|_| quantile(generator.random::<f64>().max(f64::MIN_POSITIVE)))
        .collect()
}
