//! First-order, total and second-order Sobol indices of several outputs, with bootstrap intervals.
//!
//! Source: Saltelli et al. 2010, Comput. Phys. Commun. 181:259 (first order, total) and Saltelli
//! 2002, Comput. Phys. Commun. 145:280 (second order), on outputs standardised by their mean and
//! standard deviation over all rows, as in `SALib.analyze.sobol`. The resamples equal `SALib`'s for
//! the same seed, so that the half-widths agree too.
//!
//! The bootstrap draws whole blocks. All indices are ratios of sums over blocks. Each block's
//! products are therefore computed once, and all resamples of all indices are one matrix product:
//! the counts of blocks per resample times these products.
//!
//! A value that is not finite is a failed sample. It removes its block only from the indices that
//! need it. Each index, including its variance, is computed from the blocks that have all of its
//! rows.

use super::error::SobolError;
use super::numpy_random::NumpyRandom;
use super::saltelli::rows_per_block;
use super::terms::{Terms, pairs};
use crate::normal;
use cardiotwin_vocabulary::statistics::SobolIndex;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Settings of an analysis; defaults are `SALib`'s, with a fixed seed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AnalysisSettings {
    /// Number of bootstrap resamples; fewer than two give no intervals.
    pub n_resamples: usize,
    /// Probability that an interval covers the truth, dimensionless.
    pub confidence_level: f64,
    /// Seed of the resamples. `SALib` treats 0 as no seed and then draws other resamples.
    pub seed: u64,
}

impl Default for AnalysisSettings {
    fn default() -> Self {
        Self {
            n_resamples: 100,
            confidence_level: 0.95,
            seed: 1,
        }
    }
}

/// The second-order index of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PairIndex {
    /// Indices of the two parameters, the smaller one first.
    pub parameters: [usize; 2],
    /// Their index; `None` under the conditions of [`OutputIndices::first`].
    pub index: Option<SobolIndex>,
}

/// The indices of one output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputIndices {
    /// Number of rows whose value is not finite.
    pub n_failed_rows: usize,
    /// Mean of the finite values, in the output's unit; `None` if there are none.
    pub mean: Option<f64>,
    /// Standard deviation of the finite values (divisor n). An output that does not vary has no
    /// indices.
    pub standard_deviation: Option<f64>,
    /// First-order index of each parameter; `None` if fewer than two blocks have the rows, or the
    /// output does not vary.
    pub first: Vec<Option<SobolIndex>>,
    /// Total index of each parameter; `None` under the conditions of [`Self::first`].
    pub total: Vec<Option<SobolIndex>>,
    /// Second-order index of each pair, in the order (0, 1), (0, 2) to (D - 2, D - 1).
    pub second: Vec<PairIndex>,
    /// Total index per resample and parameter, shape (resamples, D); NaN where there is none.
    #[serde(skip)]
    pub(super) total_resamples: Vec<f64>,
}

/// The indices of all outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Analysis {
    /// Number of parameters, D.
    pub n_parameters: usize,
    /// Number of complete blocks given.
    pub n_blocks: usize,
    /// Settings of the analysis.
    pub settings: AnalysisSettings,
    /// Indices of each output, in the order of the values.
    pub outputs: Vec<OutputIndices>,
}

/// Computes Sobol indices of outputs at the rows of a Saltelli design or of its first blocks.
///
/// - `values`: shape (blocks × (2D + 2), outputs), row by row; not finite if a sample failed
///
/// # Errors
/// [`SobolError`] if the values do not fill complete blocks, there are fewer than two blocks, or
/// the confidence level is not between 0 and 1.
pub fn analyse(
    n_parameters: usize,
    n_outputs: usize,
    values: &[f64],
    settings: AnalysisSettings,
) -> Result<Analysis, SobolError> {
    let rows_per_block = rows_per_block(n_parameters);
    let values_per_block = rows_per_block * n_outputs;
    if n_parameters == 0 || n_outputs == 0 || !values.len().is_multiple_of(values_per_block) {
        return Err(SobolError::Incomplete {
            n_values: values.len(),
            n_outputs,
            rows_per_block,
        });
    }
    let n_blocks = values.len() / values_per_block;
    if n_blocks < 2 {
        return Err(SobolError::TooFewBlocks { n_blocks });
    }
    let level = settings.confidence_level;
    if !(level > 0.0 && level < 1.0) {
        return Err(SobolError::Confidence { level });
    }
    let weights = weights(n_blocks, settings);
    let outputs = (0..n_outputs)
        .map(|o| {
            let output: Vec<f64> = values.iter().skip(o).step_by(n_outputs).copied().collect();
            analyse_output(n_parameters, output, &weights, settings)
        })
        .collect();
    Ok(Analysis {
        n_parameters,
        n_blocks,
        settings,
        outputs,
    })
}

/// Count of each block, shape (1 + resamples, blocks); the first row is for the estimate itself.
fn weights(n_blocks: usize, settings: AnalysisSettings) -> DMatrix<f64> {
    let mut weights = DMatrix::zeros(1 + settings.n_resamples, n_blocks);
    weights.row_mut(0).fill(1.0);
    let mut random = NumpyRandom::new(settings.seed);
    for _ in 0..n_blocks {
        for resample in 0..settings.n_resamples {
            weights[(1 + resample, random.below(n_blocks as u32) as usize)] += 1.0;
        }
    }
    weights
}

fn analyse_output(
    n_parameters: usize,
    mut output: Vec<f64>,
    weights: &DMatrix<f64>,
    settings: AnalysisSettings,
) -> OutputIndices {
    let n_finite = output.iter().filter(|v| v.is_finite()).count();
    let finite = |values: &[f64], f: &dyn Fn(f64) -> f64| -> f64 {
        values
            .iter()
            .filter(|v| v.is_finite())
            .map(|v| f(*v))
            .sum::<f64>()
            / n_finite as f64
    };
    let mean = finite(&output, &|v| v);
    let standard_deviation = finite(&output, &|v| (v - mean).powi(2)).sqrt();
    let mut result = OutputIndices {
        n_failed_rows: output.len() - n_finite,
        mean: mean.is_finite().then_some(mean),
        standard_deviation: standard_deviation.is_finite().then_some(standard_deviation),
        first: vec![None; n_parameters],
        total: vec![None; n_parameters],
        second: Vec::new(),
        total_resamples: vec![f64::NAN; settings.n_resamples * n_parameters],
    };
    let (least, largest) = output
        .iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, largest), v| {
            (v.min(least), v.max(largest))
        });
    // Variation of a constant output due to rounding does not count.
    let indices = if largest - least > 4.0 * f64::EPSILON * least.abs().max(largest.abs()) {
        output
            .iter_mut()
            .for_each(|v| *v = (*v - mean) / standard_deviation);
        let terms = Terms::new(n_parameters, &output);
        let resampled = terms.indices(weights);
        for parameter in 0..n_parameters {
            for resample in 0..settings.n_resamples {
                result.total_resamples[resample * n_parameters + parameter] =
                    resampled[(1 + resample, n_parameters + parameter)];
            }
        }
        let z = normal::quantile(0.5 + 0.5 * settings.confidence_level);
        (0..resampled.ncols())
            .map(|i| index(resampled.column(i).as_slice(), terms.n_blocks(i), z))
            .collect()
    } else {
        vec![None; 2 * n_parameters + n_parameters * (n_parameters - 1) / 2]
    };
    result.first.copy_from_slice(&indices[..n_parameters]);
    result
        .total
        .copy_from_slice(&indices[n_parameters..2 * n_parameters]);
    result.second = pairs(n_parameters)
        .zip(&indices[2 * n_parameters..])
        .map(|(parameters, index)| PairIndex {
            parameters,
            index: *index,
        })
        .collect();
    result
}

/// An index from its estimate and its resamples. Resamples without a block that has its rows do not
/// count.
fn index(estimate_and_resamples: &[f64], n_blocks: usize, z: f64) -> Option<SobolIndex> {
    let (value, resamples) = (estimate_and_resamples[0], &estimate_and_resamples[1..]);
    if n_blocks < 2 || !value.is_finite() {
        return None;
    }
    let (mut n, mut mean, mut squares) = (0.0, 0.0, 0.0);
    for v in resamples.iter().filter(|v| v.is_finite()) {
        n += 1.0;
        let difference = v - mean;
        mean += difference / n;
        squares += difference * (v - mean);
    }
    let half_width = (n > 1.0).then(|| z * (squares / (n - 1.0)).sqrt());
    Some(SobolIndex {
        value,
        half_width,
        n_blocks: n_blocks as u64,
    })
}

impl OutputIndices {
    /// Sum of the available first-order indices. One minus this sum is the share due to
    /// interactions.
    #[must_use]
    pub fn sum_of_first(&self) -> f64 {
        self.first.iter().flatten().map(|i| i.value).sum()
    }

    /// Second-order index of a pair in either order; `None` for a parameter with itself.
    #[must_use]
    pub fn second_of(&self, j: usize, k: usize) -> Option<SobolIndex> {
        let wanted = [j.min(k), j.max(k)];
        self.second
            .iter()
            .find(|p| p.parameters == wanted)
            .and_then(|p| p.index)
    }
}
