//! What a sweep asks of its model.

use rayon::ThreadPool;

use crate::error::TaskError;

/// Model whose parameters are swept.
pub(super) trait Model {
    /// First line of `samples.csv`.
    const HEADING: &'static str;
    /// Number of blocks per thread between two checks of the stop flag.
    const BLOCKS_AT_ONCE: usize;

    /// Instruction set of the arithmetic. Results of different sets agree up to rounding errors.
    fn arithmetic(&self) -> &'static str;

    /// Lines of the samples, from `status` on.
    fn lines(
        &mut self,
        rows: &[Vec<f64>],
        pool: Option<&ThreadPool>,
    ) -> Result<Vec<String>, TaskError>;
}
