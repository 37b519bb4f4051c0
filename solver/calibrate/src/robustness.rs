//! Robustness of a personalisation: designs over uncertain data and initial guesses, and the spread
//! of the results.
//!
//! Source: Jung et al. 2022, section 2.5 and Tables 3 to 10: Latin hypercubes of ten samples within
//! ±10 % of the measured biomarkers and of five within ±50 % of the default guesses. The tables
//! list mean, standard deviation, minimum and maximum of the values and of their absolute
//! differences from the original result, relative to it.

use crate::statistics::{mean, standard_deviation};
use crate::{Interval, IntervalError, latin_hypercube};
use cardiotwin_vocabulary::statistics::Moments;
use serde::{Deserialize, Serialize};

/// The paper's range of the measured biomarkers, as a fraction.
pub const DATA_RANGE: f64 = 0.1;
/// The paper's range of the initial guesses, as a fraction.
pub const GUESS_RANGE: f64 = 0.5;

/// Invalid input to a design.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RobustnessError {
    /// A centre is not finite or the range is negative, so that there is no valid box around the
    /// values.
    #[error("cannot make a box around the values")]
    Interval(#[from] IntervalError),
    /// The number of bounds differs from the number of guesses.
    #[error("{n_bounds} bounds were given for {n_guesses} guesses")]
    Bounds {
        /// Number of bounds given.
        n_bounds: usize,
        /// Number of guesses given.
        n_guesses: usize,
    },
    /// A guess lies outside its bounds.
    #[error("guess {idx} of {guess} lies outside its bounds {} to {}", .bounds.lower, .bounds.upper)]
    OutsideBounds {
        /// Index of the guess.
        idx: usize,
        /// Value of the guess.
        guess: f64,
        /// Bounds of the guess.
        bounds: Interval,
    },
}

/// Samples around measured values, shape (samples, values), in their units, spread evenly within a
/// fraction of each value.
///
/// # Errors
/// [`RobustnessError`] if a value or the range is invalid.
pub fn perturbed_data(
    measured: &[f64],
    range: f64,
    n_samples: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, RobustnessError> {
    Ok(latin_hypercube::sample(
        &around(measured, range),
        n_samples,
        seed,
    )?)
}

/// Samples around initial guesses, shape (samples, guesses), in their units, clamped to their
/// bounds.
///
/// As in the paper, the samples fill the whole range evenly and are clamped afterwards. Samples
/// beyond a bound within the range therefore accumulate on it.
///
/// # Errors
/// [`RobustnessError`] if a guess, its bounds or the range are invalid.
pub fn perturbed_guesses(
    guesses: &[f64],
    bounds: &[Option<Interval>],
    range: f64,
    n_samples: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, RobustnessError> {
    if bounds.len() != guesses.len() {
        return Err(RobustnessError::Bounds {
            n_bounds: bounds.len(),
            n_guesses: guesses.len(),
        });
    }
    for (idx, (guess, bounds)) in guesses.iter().zip(bounds).enumerate() {
        if let Some(bounds) = bounds.filter(|b| !b.contains(*guess)) {
            return Err(RobustnessError::OutsideBounds {
                idx,
                guess: *guess,
                bounds,
            });
        }
    }
    let mut samples = latin_hypercube::sample(&around(guesses, range), n_samples, seed)?;
    for sample in &mut samples {
        for (value, bounds) in sample.iter_mut().zip(bounds) {
            *value = bounds.map_or(*value, |b| b.clamp(*value));
        }
    }
    Ok(samples)
}

/// Intervals of a fraction around values of either sign.
fn around(values: &[f64], range: f64) -> Vec<Interval> {
    values
        .iter()
        .map(|v| Interval::new(v - range * v.abs(), v + range * v.abs()))
        .collect()
}

/// Moments of some values, in their unit; none for an empty slice or values that are not finite.
#[must_use]
pub fn moments(values: &[f64]) -> Option<Moments> {
    if values.is_empty() || values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    Some(Moments {
        mean: mean(values),
        standard_deviation: (values.len() > 1).then(|| standard_deviation(values)),
        minimum: values.iter().copied().fold(f64::INFINITY, f64::min),
        maximum: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    })
}

/// One column of Tables 3 to 10: the spread of a parameter or biomarker over the samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Result with the measured data and the default guesses, in the quantity's unit.
    pub original: f64,
    /// Number of samples with a result.
    pub n_samples: usize,
    /// Number of samples without a result.
    pub n_missing: usize,
    /// Moments of the values, in the quantity's unit.
    pub values: Moments,
    /// Moments of |value − original| / |original|, as fractions; `None` for an original of zero.
    pub relative_differences: Option<Moments>,
    /// Standard deviation of the values over the magnitude of the original, a fraction; `None` for
    /// an original of zero or a single sample.
    pub relative_spread: Option<f64>,
}

impl Spread {
    /// Spread of one quantity. Values that are not finite count as samples without a result. `None`
    /// if there is no result at all.
    #[must_use]
    pub fn of(original: f64, values: &[f64]) -> Option<Self> {
        let results: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        let of_results = moments(&results)?;
        let relative: Vec<f64> = results
            .iter()
            .map(|v| relative_error(*v, original))
            .collect();
        Some(Self {
            original,
            n_samples: results.len(),
            n_missing: values.len() - results.len(),
            values: of_results,
            relative_differences: moments(&relative),
            relative_spread: of_results
                .standard_deviation
                .map(|sd| sd / original.abs())
                .filter(|spread| spread.is_finite()),
        })
    }

    /// Relative spread of this quantity over that of an input; the spread is damped if it is below
    /// one. `None` if either has no relative spread.
    #[must_use]
    pub fn amplification(&self, input: &Self) -> Option<f64> {
        let ratio = self.relative_spread? / input.relative_spread?;
        ratio.is_finite().then_some(ratio)
    }
}

/// |value − target| / |target|, a fraction; not finite for a target of zero.
#[must_use]
pub fn relative_error(value: f64, target: f64) -> f64 {
    (value - target).abs() / target.abs()
}

/// Moments of the relative errors of each sample's fit against its own perturbed target, as
/// fractions.
///
/// - `values`, `targets`: one biomarker, one value per sample; pairs that are not finite are
///   ignored
#[must_use]
pub fn errors_to_targets(values: &[f64], targets: &[f64]) -> Option<Moments> {
    let errors: Vec<f64> = values
        .iter()
        .zip(targets)
        .map(|(v, t)| relative_error(*v, *t))
        .filter(|e| e.is_finite())
        .collect();
    moments(&errors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn data_fill_ten_strata_around_values_of_either_sign() {
        let measured = [138.0, -2041.0, 0.0112];
        let samples = perturbed_data(&measured, DATA_RANGE, 10, 3).unwrap();
        for (d, m) in measured.iter().enumerate() {
            let mut strata: Vec<usize> = samples
                .iter()
                .map(|s| ((s[d] / m - 0.9) / 0.2 * 10.0) as usize)
                .collect();
            strata.sort_unstable();
            assert_eq!(strata, (0..10).collect::<Vec<_>>());
        }
        assert!(perturbed_data(&[f64::NAN], 0.1, 10, 3).is_err());
        assert!(perturbed_data(&[1.0], -0.1, 10, 3).is_err());
    }

    proptest! {
        #[test]
        fn guesses_stay_within_range_and_bounds(guess in 0.1..10.0f64, below in 0.0..1.0f64, above in 0.0..1.0f64, seed: u64) {
            let bounds = Interval::new(guess * (1.0 - below), guess * (1.0 + above));
            let samples = perturbed_guesses(&[guess, guess], &[Some(bounds), None], GUESS_RANGE, 5, seed).unwrap();
            for sample in &samples {
                prop_assert!(bounds.contains(sample[0]));
                prop_assert!(sample.iter().all(|v| (v / guess - 1.0).abs() <= 0.5 + 1e-12));
            }
            // Without bounds within the range, all strata are filled.
            let mut strata: Vec<usize> = samples.iter().map(|s| ((s[1] / guess - 0.5) * 5.0) as usize).collect();
            strata.sort_unstable();
            prop_assert_eq!(strata, vec![0, 1, 2, 3, 4]);
        }
    }

    #[test]
    fn guesses_outside_their_bounds_are_refused() {
        let refused =
            perturbed_guesses(&[5.0], &[Some(Interval::new(0.0, 4.0))], 0.5, 5, 0).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "guess 0 of 5 lies outside its bounds 0 to 4"
        );
        assert!(perturbed_guesses(&[5.0], &[], 0.5, 5, 0).is_err());
    }

    /// Values with simple moments and differences on both sides of the original.
    #[test]
    fn a_column_of_the_tables() {
        let spread = Spread::of(-100.0, &[-90.0, -120.0, f64::NAN, -100.0, -110.0]).unwrap();
        assert_eq!((spread.n_samples, spread.n_missing), (4, 1));
        assert_eq!(
            (
                spread.values.mean,
                spread.values.minimum,
                spread.values.maximum
            ),
            (-105.0, -120.0, -90.0)
        );
        assert!(
            (spread.values.standard_deviation.unwrap() - (500.0f64 / 3.0).sqrt()).abs() < 1e-12
        );
        let relative = spread.relative_differences.unwrap();
        assert!((relative.mean - 0.1).abs() < 1e-15 && (relative.maximum - 0.2).abs() < 1e-15);
        assert_eq!(relative.minimum, 0.0);
        assert!((relative.standard_deviation.unwrap() - (0.02f64 / 3.0).sqrt()).abs() < 1e-15);

        assert_eq!(Spread::of(1.0, &[f64::NAN]), None);
        let zero = Spread::of(0.0, &[1.0, 2.0]).unwrap();
        assert_eq!(
            (zero.relative_differences, zero.relative_spread),
            (None, None)
        );
        let single = Spread::of(2.0, &[3.0]).unwrap();
        assert_eq!(
            (single.values.standard_deviation, single.relative_spread),
            (None, None)
        );
    }

    #[test]
    fn what_is_damped_has_an_amplification_below_one() {
        let input = Spread::of(100.0, &[90.0, 100.0, 110.0]).unwrap();
        let output = Spread::of(-2.0, &[-1.9, -2.0, -2.1]).unwrap();
        assert!((output.amplification(&input).unwrap() - 0.5).abs() < 1e-12);
        let constant = Spread::of(1.0, &[1.0, 1.0]).unwrap();
        assert_eq!(
            (
                constant.amplification(&input),
                input.amplification(&constant)
            ),
            (Some(0.0), None)
        );
    }

    #[test]
    fn errors_are_to_each_sample_s_own_target() {
        let errors = errors_to_targets(&[99.0, 121.0, f64::NAN], &[90.0, 110.0, 100.0]).unwrap();
        assert!((errors.mean - 0.1).abs() < 1e-15 && errors.standard_deviation.unwrap() < 1e-15);
        assert_eq!(errors_to_targets(&[], &[]), None);
    }
}
