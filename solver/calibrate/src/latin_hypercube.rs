//! Latin hypercube sampling for first populations and for designs of robustness sweeps.

use crate::interval::{Interval, IntervalError};
use crate::random::{Purpose, generator};
use rand::Rng;
use rand::seq::SliceRandom;

/// Points in the unit cube, shape (`n_points`, `n_dimensions`). Each of the `n_points` equal strata
/// of a dimension holds one point.
///
/// Source: McKay, Beckman and Conover 1979, Technometrics 21:239. As in `SciPy`, a point lies
/// anywhere in its stratum.
#[must_use]
pub fn unit(n_points: usize, n_dimensions: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = generator(seed, Purpose::LatinHypercube, [0, 0]);
    let width = 1.0 / n_points as f64;
    let mut points = vec![vec![0.0; n_dimensions]; n_points];
    for d in 0..n_dimensions {
        let mut strata: Vec<usize> = (0..n_points).collect();
        strata.shuffle(&mut rng);
        for (point, stratum) in points.iter_mut().zip(strata) {
            let offset: f64 = rng.random();
            point[d] = (width * (stratum as f64 + offset)).min(1.0);
        }
    }
    points
}

/// Points in a box, shape (`n_points`, number of intervals), in the intervals' units.
///
/// # Errors
/// [`IntervalError`] if the box is invalid.
pub fn sample(
    intervals: &[Interval],
    n_points: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, IntervalError> {
    Interval::validate(intervals)?;
    let scale = |point: Vec<f64>| {
        point
            .iter()
            .zip(intervals)
            .map(|(u, i)| i.from_unit(*u))
            .collect()
    };
    Ok(unit(n_points, intervals.len(), seed)
        .into_iter()
        .map(scale)
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn each_stratum_holds_one_point(n in 1usize..60, d in 1usize..8, seed: u64) {
            let points = unit(n, d, seed);
            for dimension in 0..d {
                let mut strata: Vec<usize> = points.iter().map(|p| ((p[dimension] * n as f64) as usize).min(n - 1)).collect();
                strata.sort_unstable();
                // A product that rounds up to the edge of the next stratum is not a second point of
                // that stratum.
                prop_assert!(strata.iter().enumerate().all(|(i, s)| s.abs_diff(i) <= 1));
            }
            prop_assert_eq!(&points, &unit(n, d, seed));
        }
    }

    #[test]
    fn strata_of_a_design_of_ten() {
        let intervals = [Interval::new(0.9, 1.1), Interval::new(-5.0, 5.0)];
        let points = sample(&intervals, 10, 7).unwrap();
        for (d, interval) in intervals.iter().enumerate() {
            let mut strata: Vec<usize> = points
                .iter()
                .map(|p| ((p[d] - interval.lower) / interval.width() * 10.0) as usize)
                .collect();
            strata.sort_unstable();
            assert_eq!(strata, (0..10).collect::<Vec<_>>());
        }
        assert_ne!(points, sample(&intervals, 10, 8).unwrap());
        assert!(sample(&[], 10, 7).is_err());
    }
}
