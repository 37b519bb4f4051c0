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

/// The draw of a seed and an index: a descent from where a linear model would have it, or from nearer to the mode where the
/// model has no answer there. Begun at the mode itself, descents end too near to it. None where their matrices have no factors.
#[must_use]
pub fn draw<Q>(target: &Target<'_, Q>, mode: &Mode, seed: u64, index: u64, max_steps: usize) -> Option<Draw<Q>> {
    let mut generator = generator(seed, Purpose::Posterior, [index, 0]);
    let prior = deviates(&mut generator, mode.u.len());
    let errors = deviates(&mut generator, mode.residuals.len());
    let mut descent = Descent { target, aim: Aim { errors, prior }, evaluations: 0 };
    let (step, _) = descent.step(&mode.u, &mode.residuals, &mode.jacobian, 0.0, f64::INFINITY)?;
    let part = |share: f64| -> Vec<f64> { mode.u.iter().zip(&step).map(|(u, s)| u + s * share).collect() };
    let shares = (0..HALVINGS).map(|halvings| 0.5_f64.powi(halvings)).chain([0.0]);
    let (u, found) = shares.map(part).find_map(|u| descent.at(&u).map(|found| (u, found)))?;
    let mut end = descent.from(u, found, None, max_steps)?;
    // Of a linear model, half the added χ² of the data, and the cross term with what the mode leaves.
    let m = mode.residuals.len() as f64;
    let left: f64 = mode.residuals.iter().map(|r| r * r).sum();
    let farthest = mode.height() + 0.5 * m + FARTHEST * (0.5 * m + left).sqrt();
    let height = |descent: &Descent<'_, Q>, end: &End<Q>| descent.height(&end.u, &end.found.residuals);
    if height(&descent, &end) > farthest {
        // Caught on the way: once more, from the mode.
        let found = descent.at(&mode.u)?;
        let again = descent.from(mode.u.clone(), found, Some(mode.jacobian.clone()), max_steps)?;
        if height(&descent, &again) < height(&descent, &end) {
            end = again;
        }
    }
    let converged = end.converged && height(&descent, &end) <= farthest;
    let Descent { evaluations, .. } = descent;
    Some(Draw { u: end.u, seen: end.found.seen, converged, evaluations })
}

fn deviates(generator: &mut Pcg64, n: usize) -> Vec<f64> {
    (0..n).map(|_| quantile(generator.random::<f64>().max(f64::MIN_POSITIVE))).collect()
}
