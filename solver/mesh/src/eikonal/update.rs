//! The local problem of the eikonal equation: earliest arrival at a corner from the simplex of the
//! other corners.

use crate::vec3::{Vec3, dot, norm};

/// Earliest arrival at the origin from the simplex of `rays` (displacement divided by speed, in ms)
/// with linear arrival `times` on it: min over λ ≥ 0, Σ λ = 1 of λ·t + |Σ λ r|. Infinite if no time
/// is finite.
///
/// In the interior, the minimum τ solves (τ1 − t)ᵀ G⁻¹ (τ1 − t) = 1 with G = rᵀr, and λ is parallel
/// to G⁻¹ (τ1 − t). If this λ is not positive, the minimum lies on the simplex's boundary.
pub fn arrival<const N: usize>(rays: &[Vec3; N], times: &[f64; N]) -> f64 {
    if times.iter().all(|time| time.is_finite())
        && let Some(time) = inside(rays, times)
    {
        return time;
    }
    let mut best = f64::INFINITY;
    match N {
        3 => {
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                best = best.min(arrival(&[rays[i], rays[j]], &[times[i], times[j]]));
            }
        }
        _ => {
            for (ray, time) in rays.iter().zip(times) {
                best = best.min(time + norm(*ray));
            }
        }
    }
    best
}

/// Stationary arrival within a simplex of two or three corners, if it exists.
fn inside<const N: usize>(rays: &[Vec3; N], times: &[f64; N]) -> Option<f64> {
    let gram: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| dot(rays[i], rays[j])));
    // Times relative to the earliest one keep their precision even late in the activation.
    let first = times.iter().copied().fold(f64::INFINITY, f64::min);
    let later = times.map(|time| time - first);
    let a = solve(&gram, &[1.0; N])?;
    let b = solve(&gram, &later)?;
    let sum = |x: &[f64; N]| x.iter().sum::<f64>();
    let (aa, ab, bb) = (
        sum(&a),
        sum(&b),
        b.iter().zip(&later).map(|(x, t)| x * t).sum::<f64>(),
    );
    // aa τ² − 2 ab τ + bb − 1 = 0
    let under = ab * ab - aa * (bb - 1.0);
    if !(aa > 0.0 && under >= 0.0) {
        return None;
    }
    let tau = (ab + under.sqrt()) / aa;
    let feasible = (0..N).all(|i| a[i] * tau - b[i] >= 0.0);
    feasible.then_some(first + tau)
}

/// Solves G x = b by Cholesky factorisation; `None` if G is not positive definite.
fn solve<const N: usize>(gram: &[[f64; N]; N], right: &[f64; N]) -> Option<[f64; N]> {
    let mut lower = [[0.0; N]; N];
    let mut x = *right;
    for i in 0..N {
        for j in 0..=i {
            let inner: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = gram[i][j] - inner;
            if i == j {
                // Flat elements have no stationary point of their own.
                if rest <= 1e-14 * gram[i][i] {
                    return None;
                }
                lower[i][i] = rest.sqrt();
            } else {
                lower[i][j] = rest / lower[j][j];
            }
        }
    }
    for i in 0..N {
        let inner: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - inner) / lower[i][i];
    }
    for i in (0..N).rev() {
        let inner: f64 = (i + 1..N).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - inner) / lower[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Compared with a search over the simplex.
        #[test]
        fn arrival_is_the_minimum_over_the_simplex(
            rays in prop::array::uniform3(prop::array::uniform3(-2.0..2.0f64)),
            times in prop::array::uniform3(0.0..3.0f64),
        ) {
            let found = arrival(&rays, &times);
            let cost = |l: [f64; 3]| {
                let at: Vec3 = std::array::from_fn(|k| (0..3).map(|i| l[i] * rays[i][k]).sum());
                (0..3).map(|i| l[i] * times[i]).sum::<f64>() + norm(at)
            };
            let n = 120;
            let mut least = f64::INFINITY;
            for i in 0..=n {
                for j in 0..=n - i {
                    let l = [f64::from(i), f64::from(j), f64::from(n - i - j)].map(|x| x / f64::from(n));
                    least = least.min(cost(l));
                }
            }
            prop_assert!(found <= least + 1e-9, "{found} {least}");
            prop_assert!(found >= least - 0.05, "{found} {least}");
        }
    }

    #[test]
    fn corners_that_are_not_reached_yet_do_not_take_part() {
        let rays = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        assert_eq!(arrival(&rays, &[f64::INFINITY; 3]), f64::INFINITY);
        assert_eq!(arrival(&rays, &[f64::INFINITY, 1.0, f64::INFINITY]), 3.0);
    }
}
