//! Draws from a posterior by randomised maximum likelihood.

use rand::Rng;
use rand_pcg::Pcg64;

use super::Target;
use super::descent::{Aim, Descent, End, Mode};
use crate::normal::quantile;
use crate::random::{Purpose, generator};

/// Number of halvings of the way from the mode to the draw that a linear model predicts.
const HALVINGS: i32 = 6;

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

/// The draw with a seed and an index; `None` if no descent has a matrix with a factorisation.
///
/// The draw is a descent from a point of the prior, or from closer to the mode if the model has no
/// result there. Starts near the mode would confine all draws to its valley and miss other valleys
/// with equal misfit. If the descent ends higher than errors and prior make plausible, it is
/// repeated from the draw that a linear model predicts, and then from the mode.
#[must_use]
pub fn draw<Q>(
    target: &Target<'_, Q>,
    mode: &Mode,
    seed: u64,
    index: u64,
    max_steps: usize,
) -> Option<Draw<Q>> {
    let mut generator = generator(seed, Purpose::Posterior, [index, 0]);
    let prior = deviates(&mut generator, mode.u.len());
    let errors = deviates(&mut generator, mode.residuals.len());
    let way: Vec<f64> = prior
        .iter()
        .zip(&mode.u)
        .map(|(prior, mode)| prior - mode)
        .collect();
    let mut descent = Descent {
        target,
        aim: Aim { errors, prior },
        evaluations: 0,
    };
    let (step, _) = descent.step(&mode.u, &mode.residuals, &mode.jacobian, 0.0, f64::INFINITY)?;
    // For a linear model: half of the χ² that the errors add to the data, and the cross term with
    // the residuals at the mode.
    let m = mode.residuals.len() as f64;
    let left: f64 = mode.residuals.iter().map(|r| r * r).sum();
    let farthest = mode.height() + 0.5 * m + FARTHEST * (0.5 * m + left).sqrt();
    let mut best: Option<(f64, End<Q>)> = None;
    for (way, jacobian) in [
        (way.as_slice(), None),
        (step.as_slice(), None),
        (&vec![0.0; mode.u.len()][..], Some(mode.jacobian.clone())),
    ] {
        let part = |share: f64| -> Vec<f64> {
            mode.u.iter().zip(way).map(|(u, s)| u + s * share).collect()
        };
        let shares = (0..HALVINGS)
            .map(|halvings| 0.5_f64.powi(halvings))
            .chain([0.0]);
        let Some((u, found)) = shares
            .map(part)
            .find_map(|u| descent.at(&u).map(|found| (u, found)))
        else {
            continue;
        };
        let Some(end) = descent.from(u, found, jacobian, max_steps) else {
            continue;
        };
        let height = descent.height(&end.u, &end.found.residuals);
        if best.as_ref().is_none_or(|(lowest, _)| height < *lowest) {
            best = Some((height, end));
        }
        if best.as_ref().is_some_and(|(lowest, _)| *lowest <= farthest) {
            break;
        }
    }
    let (height, end) = best?;
    let converged = end.converged && height <= farthest;
    let Descent { evaluations, .. } = descent;
    Some(Draw {
        u: end.u,
        seen: end.found.seen,
        converged,
        evaluations,
    })
}

fn deviates(generator: &mut Pcg64, n: usize) -> Vec<f64> {
    (0..n)
        .map(|_| quantile(generator.random::<f64>().max(f64::MIN_POSITIVE)))
        .collect()
}
