//! The paper's rule for non-physiological samples: means over the physiological samples replace
//! their biomarkers.
//!
//! Source: Jung et al. 2022, section 2.4. A sample that was computed but violates a constraint
//! carries no information about the variation of the biomarkers, but the design must not have gaps.
//! A sample that could not be computed is left to [`analyse`](super::analyse), which drops it
//! pairwise.

use super::error::SobolError;
use serde::{Deserialize, Serialize};

/// Status of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sample {
    /// The sample was computed and satisfies all constraints.
    Physiological,
    /// The sample was computed but violates a constraint.
    Excluded,
    /// The sample could not be computed.
    Failed,
}

/// Result of the replacement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Exclusion {
    /// Number of rows that were replaced.
    pub n_excluded: usize,
    /// Number of rows that failed.
    pub n_failed: usize,
    /// Number of rows given.
    pub n_rows: usize,
    /// Mean of each output over the physiological samples, in its unit.
    pub means: Vec<f64>,
    /// Standard deviation of each output over the physiological samples (divisor n), in its unit.
    pub standard_deviations: Vec<f64>,
}

impl Exclusion {
    /// Share of the rows that were replaced, dimensionless.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.n_excluded as f64 / self.n_rows as f64
    }
}

/// Replaces the outputs of excluded samples by the means over the physiological ones, and those of
/// failed samples by NaN.
///
/// - `values`: shape (rows, outputs), row by row
/// - `samples`: status of each row
///
/// # Errors
/// [`SobolError`] if values and samples do not match, or no sample is physiological.
pub fn replace_excluded(
    values: &[f64],
    n_outputs: usize,
    samples: &[Sample],
) -> Result<(Vec<f64>, Exclusion), SobolError> {
    if n_outputs == 0 || values.len() != n_outputs * samples.len() {
        let n_rows = values.len() / n_outputs.max(1);
        return Err(SobolError::Marks {
            n_marks: samples.len(),
            n_rows,
        });
    }
    let count = |wanted| samples.iter().filter(|s| **s == wanted).count();
    let n_physiological = count(Sample::Physiological);
    if n_physiological == 0 {
        return Err(SobolError::NonePhysiological {
            n_rows: samples.len(),
        });
    }
    let mean_over = |output: usize, f: &dyn Fn(f64) -> f64| {
        let rows = values
            .chunks_exact(n_outputs)
            .zip(samples)
            .filter(|(_, s)| **s == Sample::Physiological);
        // A biomarker that a physiological sample lacks (a level it never reaches) does not enter
        // the mean.
        let (sum, n) = rows
            .map(|(row, _)| row[output])
            .filter(|v| v.is_finite())
            .fold((0.0, 0usize), |(sum, n), v| (sum + f(v), n + 1));
        sum / n as f64
    };
    let means: Vec<f64> = (0..n_outputs).map(|o| mean_over(o, &|v| v)).collect();
    let standard_deviations = means
        .iter()
        .enumerate()
        .map(|(o, mean)| mean_over(o, &|v| (v - mean).powi(2)).sqrt())
        .collect();
    let replaced = values
        .chunks_exact(n_outputs)
        .zip(samples)
        .flat_map(|(row, sample)| {
            row.iter()
                .zip(&means)
                .map(move |(value, mean)| match sample {
                    Sample::Physiological => *value,
                    Sample::Excluded => *mean,
                    Sample::Failed => f64::NAN,
                })
        })
        .collect();
    let exclusion = Exclusion {
        n_excluded: count(Sample::Excluded),
        n_failed: count(Sample::Failed),
        n_rows: samples.len(),
        means,
        standard_deviations,
    };
    Ok((replaced, exclusion))
}

#[cfg(test)]
mod tests {
    use super::*;
    use Sample::{Excluded, Failed, Physiological};

    #[test]
    fn means_take_the_place_of_what_is_excluded() {
        let values = [
            1.0,
            10.0,
            99.0,
            f64::NAN,
            3.0,
            30.0,
            5.0,
            7.0,
            5.0,
            f64::NAN,
        ];
        let samples = [
            Physiological,
            Excluded,
            Physiological,
            Failed,
            Physiological,
        ];
        let (replaced, exclusion) = replace_excluded(&values, 2, &samples).unwrap();
        assert_eq!(replaced[..6], [1.0, 10.0, 3.0, 20.0, 3.0, 30.0]);
        assert!(replaced[6].is_nan() && replaced[7].is_nan() && replaced[9].is_nan());
        assert_eq!(
            (exclusion.n_excluded, exclusion.n_failed, exclusion.n_rows),
            (1, 1, 5)
        );
        assert_eq!(exclusion.means, [3.0, 20.0]);
        assert_eq!(
            (exclusion.standard_deviations[1], exclusion.share()),
            (10.0, 0.2)
        );
    }

    #[test]
    fn nothing_to_replace_by_is_an_error() {
        assert_eq!(
            replace_excluded(&[1.0, 2.0], 1, &[Excluded, Failed]),
            Err(SobolError::NonePhysiological { n_rows: 2 })
        );
        assert!(replace_excluded(&[1.0, 2.0], 1, &[Physiological]).is_err());
        assert!(replace_excluded(&[], 0, &[]).is_err());
    }
}
