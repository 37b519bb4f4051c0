//! Errors of measured data.

/// Reasons why measured data cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeasuredError {
    /// Times and values of a trace differ in number.
    #[error("the {trace} has {n_times} times, but {n_values} values")]
    Length {
        /// Name of the trace.
        trace: &'static str,
        /// Number of times of the trace.
        n_times: usize,
        /// Number of values of the trace.
        n_values: usize,
    },
    /// A trace has too few samples.
    #[error("the {trace} has {found} samples over the cycle, expected at least {expected}")]
    TooFew {
        /// Name of the trace.
        trace: &'static str,
        /// Number of samples of the trace.
        found: usize,
        /// Smallest number of samples that the search needs.
        expected: usize,
    },
    /// The times of a trace do not increase within the cycle.
    #[error(
        "time {time_ms} ms at sample {sample} of the {trace} does not increase within the cycle of {cycle_ms} ms"
    )]
    Time {
        /// Name of the trace.
        trace: &'static str,
        /// Number of the sample, from one.
        sample: usize,
        /// Time of the sample \[ms\].
        time_ms: f64,
        /// Length of the cardiac cycle \[ms\].
        cycle_ms: f64,
    },
    /// A number is outside its valid range.
    #[error("{name} is {value}, expected {expected}")]
    Value {
        /// Description of the number.
        name: &'static str,
        /// Value that was given.
        value: f64,
        /// Range of admissible values, in words.
        expected: &'static str,
    },
}

/// Checks that a value is positive.
///
/// # Errors
/// [`MeasuredError::Value`] with the name otherwise.
pub(crate) fn positive(name: &'static str, value: f64) -> Result<(), MeasuredError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(MeasuredError::Value {
        name,
        value,
        expected: "positive, with a positive standard deviation where it has one",
    })
}
