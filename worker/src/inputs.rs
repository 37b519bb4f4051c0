//! Input files of a task: read once, and only with the content that the task was planned with.

use std::fs::File;
use std::io::{self, BufReader, Read};

use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::{Quantity, Trace, parse_trace};
use sha2::{Digest as _, Sha256};

use crate::error::TaskError;

/// The content of an input file.
///
/// # Errors
/// [`TaskError::InputMissing`] when it cannot be read, [`TaskError::InputChanged`] when its hash is another.
pub fn read_verified(input: &InputFile) -> Result<Vec<u8>, TaskError> {
    let bytes = std::fs::read(&input.path).map_err(|source| missing(input, source))?;
    compare(input, sha256_hex(&bytes))?;
    Ok(bytes)
}

/// An input file that is too large for memory: what was read of it counts once [`Self::verify`] has seen the rest.
#[derive(Debug)]
pub struct Verifying<'a> {
    input: &'a InputFile,
    file: File,
    hash: Sha256,
}

impl<'a> Verifying<'a> {
    /// Opens it.
    ///
    /// # Errors
    /// [`TaskError::InputMissing`] when it cannot be read.
    pub fn open(input: &'a InputFile) -> Result<BufReader<Self>, TaskError> {
        let missing = |source| missing(input, source);
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

    /// Reads on to the end, and compares.
    ///
    /// # Errors
    /// [`TaskError::InputMissing`] when it cannot be read, [`TaskError::InputChanged`] when its hash is another.
    pub fn verify(mut self) -> Result<(), TaskError> {
        let input = self.input;
        io::copy(&mut self, &mut io::sink()).map_err(|source| missing(input, source))?;
        compare(
            input,
            self.hash
                .finalize()
                .iter()
                .map(|byte| format!("{byte:02x}"))
                .collect(),
        )
    }
}

impl Read for Verifying<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(buffer)?;
        self.hash.update(&buffer[..n]);
        Ok(n)
    }
}

/// The error of a file that cannot be read.
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

/// A measured trace, if its file is sound.
///
/// # Errors
/// As [`read_verified`], and [`TaskError::Measured`] with the first problem that stands in the way.
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
