//! Reads a task's input files and checks that their content is the one that the task was planned
//! with.

use std::fs::File;
use std::io::{self, BufReader, Read};

use cardiotwin_input_files::MaxBytes;
use cardiotwin_schemas::hash::{hex, sha256_hex};
use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::{Quantity, Trace, parse_trace};
use sha2::{Digest as _, Sha256};

use crate::error::TaskError;

/// Reads an input file in one piece and checks its hash.
///
/// # Errors
/// [`TaskError::InputMissing`] when the file cannot be read, [`TaskError::InputChanged`] when its
/// hash differs.
pub fn read_verified(input: &InputFile) -> Result<Vec<u8>, TaskError> {
    let bytes = cardiotwin_input_files::read(&input.path, MaxBytes::MESH)
        .map_err(|source| missing(input, source))?;
    compare(input, sha256_hex(&bytes))?;
    Ok(bytes)
}

/// An input file that is too large for memory. Content read from it is trustworthy only after
/// [`Self::verify`] succeeds.
#[derive(Debug)]
pub struct Verifying<'a> {
    input: &'a InputFile,
    file: File,
    hash: Sha256,
}

impl<'a> Verifying<'a> {
    /// Opens the file.
    ///
    /// # Errors
    /// [`TaskError::InputMissing`] when the file cannot be opened.
    pub fn open(input: &'a InputFile) -> Result<BufReader<Self>, TaskError> {
        let missing = |source| missing(input, source);
        cardiotwin_input_files::check(&input.path, MaxBytes::MESH).map_err(missing)?;
        let file = File::open(&input.path).map_err(missing)?;
        Ok(BufReader::with_capacity(
            1 << 20,
            Self {
                input,
                file,
                hash: Sha256::new(),
            },
        ))
    }

    /// Reads the rest of the file and checks its hash.
    ///
    /// # Errors
    /// [`TaskError::InputMissing`] when the file cannot be read, [`TaskError::InputChanged`] when
    /// its hash differs.
    pub fn verify(mut self) -> Result<(), TaskError> {
        let input = self.input;
        io::copy(&mut self, &mut io::sink()).map_err(|source| missing(input, source))?;
        compare(input, hex(&self.hash.finalize()))
    }
}

impl Read for Verifying<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(buffer)?;
        self.hash.update(&buffer[..n]);
        Ok(n)
    }
}

/// The error for an input file that cannot be read.
pub fn missing(input: &InputFile, source: io::Error) -> TaskError {
    TaskError::InputMissing {
        role: input.name.clone(),
        file: input.path.clone(),
        source,
    }
}

fn compare(input: &InputFile, found: String) -> Result<(), TaskError> {
    if found == input.sha256 {
        return Ok(());
    }
    let (role, file, expected) = (input.name.clone(), input.path.clone(), input.sha256.clone());
    Err(TaskError::InputChanged {
        role,
        file,
        found,
        expected,
    })
}

/// Reads a measured trace and checks it.
///
/// # Errors
/// As [`read_verified`], and [`TaskError::Measured`] with the first problem that makes the trace
/// unusable.
pub fn read_trace(input: &InputFile, quantity: Quantity) -> Result<Trace, TaskError> {
    let bytes = read_verified(input)?;
    let reading = parse_trace(&bytes, &input.path, quantity);
    let problem = reading
        .problems
        .iter()
        .find(|problem| problem.is_error())
        .or(reading.problems.first());
    let message = problem.map_or_else(|| "no trace".to_owned(), ToString::to_string);
    reading.trace.ok_or(TaskError::Measured {
        role: input.name.clone(),
        message,
    })
}

/// Removes samples after the end of the cycle, which belong to the next beat or repeat the first
/// sample.
pub fn within_cycle(trace: Trace, cycle_ms: f64) -> Result<Trace, TaskError> {
    let n = trace.time_ms().partition_point(|t| *t < cycle_ms - 1e-6);
    let (quantity, times, values) = (
        trace.quantity(),
        &trace.time_ms()[..n],
        &trace.values()[..n],
    );
    Trace::new(quantity, times.to_vec(), values.to_vec()).map_err(|error| TaskError::Measured {
        role: quantity.column().to_owned(),
        message: error.to_string(),
    })
}
