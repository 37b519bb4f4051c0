//! A draw of the posterior by randomised maximum likelihood.

use rand::Rng;
use rand_pcg::Pcg64;

use super::Target;
use super::descent::{Aim, Descent, End, Mode};
use crate::normal::quantile;
use crate::random::{Purpose, generator};

/// Halvings of the way from the mode to where a linear model would have a draw.
const HALVINGS: i32 = 6;

/// Standard deviations beyond which what a draw leaves is not what errors and prior let expect.
const FARTHEST: f64 = 3.0;

/// A draw of a posterior.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw<Q> {
    /// Standard coordinates.
    pub u: Vec<f64>,
    /// What the model says there.
    pub seen: Q,
    /// Whether the descent ended by itself, and where errors and prior let expect it.
    pub converged: bool,
    /// How often the model was asked.
    pub evaluations: usize,
}

/// The draw of a seed and an index: a descent from a point of the prior, or from nearer to the mode where the model has no
/// answer there. Begun near the mode, all draws would be of its valley, and others that serve alike would be missed. A descent
/// that ends higher than errors and prior let expect is begun again, from where a linear model would have the draw, then from
/// the mode. None where their matrices have no factors.
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
    // Of a linear model, half the added χ² of the data, and the cross term with what the mode leaves.
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
