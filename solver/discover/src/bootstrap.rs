//! Significance: the posterior odds that noise alone gives to the best of all candidates, linearised
//! around a fit.
//!
//! It is a parametric bootstrap of the maximum over all candidates (Johansson et al. 2014, BMC Syst
//! Biol 8:46) in the tangent space. Residuals of a correct model are standard normal. A candidate's
//! evidence depends on their projection on its own direction, orthogonal to those of all fitted
//! parameters.

use crate::fit::Fit;
use crate::problem::Problem;
use crate::random::standard_normal;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Direction of a candidate at one of its starts.
#[derive(Debug, Clone)]
pub struct Tangent {
    /// Index of the candidate.
    pub term: usize,
    /// Unit direction orthogonal to the fitted parameters.
    direction: DVector<f64>,
    /// Length of the derivative with respect to the strength's z, orthogonal to the fitted
    /// parameters, with the prior included.
    pub length: f64,
    /// z of the smallest strength that may be named.
    floor: f64,
    /// Whether the strength may lie below and above its off-value.
    sides: (bool, bool),
    /// z of the typical strength.
    typical: f64,
    /// Twice the logarithm of the candidate's prior odds.
    log_prior: f64,
}

impl Tangent {
    /// Misfit that the typical strength leaves after all other parameters are refitted.
    #[must_use]
    pub fn expected_misfit(&self) -> f64 {
        (self.typical * self.typical * (self.length * self.length - 1.0)).max(0.0)
    }

    /// Evidence that the candidate would have if the model were linear: a score test orthogonal to
    /// all fitted parameters, regardless of the magnitude of the strength.
    ///
    /// - `residuals`: white residuals of the fit at which the tangent was computed, priors last
    #[must_use]
    pub fn score(&self, residuals: &DVector<f64>) -> f64 {
        let projection = -self.direction.rows(0, residuals.len()).dot(residuals);
        let side = if projection < 0.0 {
            self.sides.0
        } else {
            self.sides.1
        };
        (if side { projection * projection } else { 0.0 }) - 2.0 * self.length.ln()
    }

    /// Twice the logarithm of the candidate's posterior odds for these residuals; zero if the strength
    /// may not be named.
    fn log_odds(&self, noise: &DVector<f64>) -> f64 {
        let projection = self.direction.dot(noise);
        let strength = projection / self.length;
        let side = if strength < 0.0 {
            self.sides.0
        } else {
            self.sides.1
        };
        if !side || strength.abs() < self.floor {
            return 0.0;
        }
        projection * projection - 2.0 * self.length.ln() + self.log_prior
    }
}

/// Tangents of candidates at a fit, one per candidate and start.
#[must_use]
pub fn tangents(problem: &Problem<'_>, at: &Fit, among: &[usize]) -> Vec<Tangent> {
    let n_data = at.minimum.residuals.len() - at.z.len();
    let n = at.z.len();
    // The last row before the priors is a determinant, which noise does not change.
    let determinant = n_data - 1;
    // Orthonormal basis of the fitted parameters. Priors count as data, and one more row holds the
    // prior of the strength.
    let jacobian = DMatrix::from_fn(n_data + n + 1, n, |r, c| {
        if r < n_data + n && r != determinant {
            at.minimum.jacobian[(r, c)]
        } else {
            0.0
        }
    });
    let basis = jacobian.qr().q();
    let tasks: Vec<(usize, usize)> = among
        .iter()
        .filter(|term| !at.structure.terms.contains(term))
        .flat_map(|term| {
            (0..problem.forward.candidates()[*term].starts.len()).map(move |start| (*term, start))
        })
        .collect();
    tasks
        .par_iter()
        .filter_map(|(term, start)| {
            let candidate = &problem.forward.candidates()[*term];
            let strength = &candidate.parameters[0];
            let values = &candidate.starts[*start];
            let typical = strength.z(values[0]);
            let mut structure = at.structure.clone();
            structure.terms.push(*term);
            let parameters = problem.parameters(&structure);
            // A third of the typical strength, because some effects do not respond to small
            // strengths.
            let step = typical / 3.0;
            let mut z = at.z.clone();
            z.push(step);
            z.extend(
                candidate
                    .parameters
                    .iter()
                    .zip(values)
                    .skip(1)
                    .map(|(p, v)| p.z(*v)),
            );
            let (there, _) = problem.residuals(
                &structure,
                &parameters,
                &z,
                at.weights,
                Some(&at.minimum.warm),
            )?;
            let mut direction = DVector::zeros(n_data + n + 1);
            for i in 0..determinant {
                direction[i] = (there[i] - at.minimum.residuals[i]) / step;
            }
            direction[n_data + n] = 1.0;
            let across = &direction - &basis * basis.tr_mul(&direction);
            let length = across.norm();
            let (low, high) = strength.z_bounds();
            Some(Tangent {
                term: *term,
                direction: across / length,
                length,
                floor: (candidate.smallest / strength.sd).abs(),
                sides: (low < -1e-9, high > 1e-9),
                typical,
                log_prior: candidate.log_prior,
            })
        })
        .collect()
}

/// Largest logarithm of any candidate's posterior odds, times two, in each of `n` draws of noise, in
/// ascending order.
#[must_use]
pub fn null_maxima(tangents: &[Tangent], n: usize, seed: u64) -> Vec<f64> {
    let Some(first) = tangents.first() else {
        return vec![0.0; n];
    };
    let size = first.direction.len();
    let mut random = Pcg64::seed_from_u64(seed);
    let draws: Vec<DVector<f64>> = (0..n)
        .map(|_| DVector::from_fn(size, |_, _| standard_normal(&mut random)))
        .collect();
    let mut maxima: Vec<f64> = draws
        .par_iter()
        .map(|noise| {
            tangents
                .iter()
                .map(|t| t.log_odds(noise))
                .fold(0.0, f64::max)
        })
        .collect();
    maxima.sort_by(f64::total_cmp);
    maxima
}

/// Share of the sorted maxima that reach this value, (1 + number) / (1 + n), which is never
/// zero.
#[must_use]
pub fn p_value(maxima: &[f64], value: f64) -> f64 {
    let reached = maxima.iter().filter(|m| **m >= value).count();
    (1 + reached) as f64 / (1 + maxima.len()) as f64
}

/// Quantile of sorted values.
#[must_use]
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted
        .get(((share * sorted.len() as f64) as usize).min(sorted.len().saturating_sub(1)))
        .copied()
        .unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tangent(axis: usize, length: f64, floor: f64, sides: (bool, bool)) -> Tangent {
        let mut direction = DVector::zeros(40);
        direction[axis] = 1.0;
        Tangent {
            term: axis,
            direction,
            length,
            floor,
            sides,
            typical: 1.0,
            log_prior: 0.0,
        }
    }

    /// For one free direction, the evidence is χ² of one degree of freedom minus its price.
    #[test]
    fn maxima_of_one_direction_are_chi_squared() {
        let maxima = null_maxima(&[tangent(3, 1.0, 0.0, (true, true))], 20_000, 5);
        assert!(
            (quantile(&maxima, 0.95) - 3.84).abs() < 0.2,
            "{}",
            quantile(&maxima, 0.95)
        );
        let priced = null_maxima(&[tangent(3, 10.0, 0.0, (true, true))], 20_000, 5);
        assert!(
            (quantile(&maxima, 0.99) - quantile(&priced, 0.99) - 2.0 * 10.0f64.ln()).abs() < 1e-9
        );
    }

    #[test]
    fn more_candidates_need_more_and_floors_and_sides_less() {
        let free: Vec<Tangent> = (0..10)
            .map(|i| tangent(i, 1.0, 0.0, (true, true)))
            .collect();
        let ten = quantile(&null_maxima(&free, 20_000, 1), 0.95);
        // P(max of ten χ² ≤ x) = 0.95 gives x = 7.87.
        assert!((ten - 7.87).abs() < 0.4, "{ten}");
        let half: Vec<Tangent> = (0..10)
            .map(|i| tangent(i, 1.0, 0.0, (false, true)))
            .collect();
        assert!(quantile(&null_maxima(&half, 20_000, 1), 0.95) < ten - 0.5);
        let floored: Vec<Tangent> = (0..10)
            .map(|i| tangent(i, 1.0, 6.0, (true, true)))
            .collect();
        assert_eq!(quantile(&null_maxima(&floored, 20_000, 1), 0.99), 0.0);
    }

    #[test]
    fn rare_effects_need_no_less_because_of_frequent_ones() {
        let rare = |axis: usize| Tangent {
            log_prior: -4.0,
            ..tangent(axis, 1.0, 0.0, (true, true))
        };
        let alone = quantile(&null_maxima(&[rare(1)], 20_000, 5), 0.95);
        assert_eq!(alone, 0.0);
        let frequent = tangent(2, 1.0, 0.0, (true, true));
        let both = quantile(&null_maxima(&[rare(1), frequent], 20_000, 5), 0.95);
        assert!((both - 3.9).abs() < 0.3, "{both}");
    }

    #[test]
    fn p_values_are_never_zero() {
        let sorted = [0.0, 1.0, 2.0, 3.0];
        assert_eq!(p_value(&sorted, 2.5), 0.4);
        assert_eq!(p_value(&sorted, 9.0), 0.2);
    }
}
