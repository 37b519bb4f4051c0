//! Random numbers.

use rand::Rng;
use std::f64::consts::TAU;

/// A standard normal number (Box–Muller transform).
pub(crate) fn standard_normal(random: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
}
