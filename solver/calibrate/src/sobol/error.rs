//! What is wrong with what a sensitivity analysis was given.

use crate::IntervalError;

/// What is wrong with a design or with the outputs to analyse.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SobolError {
    /// The box makes no sense.
    #[error(transparent)]
    Interval(#[from] IntervalError),
    /// More dimensions than there are direction numbers for, or none.
    #[error(
        "a Sobol sequence of {n_dimensions} dimensions was asked for, but must have 1 to {largest}"
    )]
    Dimensions {
        /// Dimensions asked for.
        n_dimensions: usize,
        /// Most that there are.
        largest: usize,
    },
    /// More points than the sequence has.
    #[error(
        "{n_points} points were asked for, but the sequence ends after {largest}; skip or sample fewer"
    )]
    Points {
        /// Points asked for, those skipped included.
        n_points: u64,
        /// Most that there are.
        largest: u64,
    },
    /// Values that do not fill complete rows, or rows that do not fill complete blocks.
    #[error(
        "{n_values} values of {n_outputs} outputs do not fill blocks of {rows_per_block} rows: give complete blocks \
         only, from the first on"
    )]
    Incomplete {
        /// Number of values.
        n_values: usize,
        /// Outputs of a row.
        n_outputs: usize,
        /// Rows of a block.
        rows_per_block: usize,
    },
    /// Too few blocks for a variance.
    #[error("{n_blocks} complete blocks were given, but an analysis needs at least 2")]
    TooFewBlocks {
        /// Complete blocks.
        n_blocks: usize,
    },
    /// A confidence level that is none.
    #[error("the confidence level is {level}, but must be above 0 and below 1")]
    Confidence {
        /// The level.
        level: f64,
    },
    /// A mark for each row is needed.
    #[error("{n_marks} samples are marked, but there are {n_rows} rows")]
    Marks {
        /// Marks given.
        n_marks: usize,
        /// Rows of values.
        n_rows: usize,
    },
    /// Nothing is left to take the means of.
    #[error(
        "none of {n_rows} samples is physiological, so that nothing can replace those excluded"
    )]
    NonePhysiological {
        /// Rows of values.
        n_rows: usize,
    },
}
