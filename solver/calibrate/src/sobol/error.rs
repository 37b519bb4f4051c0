//! Errors of a sensitivity analysis.

use crate::IntervalError;

/// Invalid design or outputs of a sensitivity analysis.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SobolError {
    /// The box is empty, or an interval is not finite and in order.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// No dimensions, or more than the table of direction numbers has.
    #[error("a Sobol sequence of {n_dimensions} dimensions was requested, expected 1 to {largest}")]
    Dimensions {
        /// Number of dimensions requested.
        n_dimensions: usize,
        /// Largest number of dimensions.
        largest: usize,
    },
    /// More points than the sequence has.
    #[error(
        "{n_points} points were requested, but the sequence ends after {largest}; skip or sample fewer points"
    )]
    Points {
        /// Number of points requested, including those skipped.
        n_points: u64,
        /// Number of points of the sequence.
        largest: u64,
    },
    /// Values that do not fill complete rows, or rows that do not fill complete blocks.
    #[error(
        "{n_values} values of {n_outputs} outputs do not fill blocks of {rows_per_block} rows: give complete blocks, \
         starting with the first"
    )]
    Incomplete {
        /// Number of values that were given.
        n_values: usize,
        /// Number of outputs per row.
        n_outputs: usize,
        /// Number of rows per block.
        rows_per_block: usize,
    },
    /// Too few blocks for a variance.
    #[error("{n_blocks} complete blocks were given, but an analysis needs at least 2")]
    TooFewBlocks {
        /// Number of complete blocks.
        n_blocks: usize,
    },
    /// The confidence level is not between 0 and 1.
    #[error("the confidence level is {level}, but must be above 0 and below 1")]
    Confidence {
        /// Confidence level that was given.
        level: f64,
    },
    /// The number of marked samples differs from the number of rows.
    #[error("{n_marks} samples are marked, but there are {n_rows} rows")]
    Marks {
        /// Number of marked samples.
        n_marks: usize,
        /// Number of rows of values.
        n_rows: usize,
    },
    /// No sample is physiological, so that there are no means to replace the excluded ones.
    #[error(
        "none of the {n_rows} samples is physiological, so the excluded samples have no replacement"
    )]
    NonePhysiological {
        /// Number of rows of values.
        n_rows: usize,
    },
}
