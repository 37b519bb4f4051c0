//! Input files of a task: read once, and only with the content that the task was planned with.

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::{Quantity, Trace, parse_trace};

use crate::error::TaskError;

/// The content of an input file.
///
/// # Errors
/// [`TaskError::InputMissing`] when it cannot be read, [`TaskError::InputChanged`] when its hash is another.
pub fn read_verified(input: &InputFile) -> Result<Vec<u8>, TaskError> {
    let bytes = std::fs::read(&input.path).map_err(|source| TaskError::InputMissing {
        role: input.name.clone(),
        file: input.path.clone(),
        source,
    })?;
    let found = sha256_hex(&bytes);
    if found != input.sha256 {
        return Err(TaskError::InputChanged {
            role: input.name.clone(),
            file: input.path.clone(),
            found,
            expected: input.sha256.clone(),
        });
    }
    Ok(bytes)
}

/// A measured trace, if its file is sound.
///
/// # Errors
/// As [`read_verified`], and [`TaskError::Measured`] with the first problem that stands in the way.
pub fn read_trace(input: &InputFile, quantity: Quantity) -> Result<Trace, TaskError> {
    let bytes = read_verified(input)?;
    let reading = parse_trace(&bytes, &input.path, quantity);
    let problem = reading.problems.iter().find(|problem| problem.is_error()).or(reading.problems.first());
    let message = problem.map_or_else(|| "no trace".to_owned(), ToString::to_string);
    reading.trace.ok_or(TaskError::Measured { role: input.name.clone(), message })
}
