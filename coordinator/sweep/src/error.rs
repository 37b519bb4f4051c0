//! Errors in making, continuing or analysing a sweep.

use std::io;
use std::path::PathBuf;

use cardiotwin_calibrate::sobol::SobolError;

use super::robustness::DesignError;

/// Error of a sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A file of the sweep cannot be read or written.
    #[error("cannot {what} {path}")]
    File {
        /// Verb of the operation, as in "cannot read".
        what: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// `sweep.json` is not the file of a sweep, or of a later version.
    #[error(transparent)]
    Format(#[from] cardiotwin_schemas::formats::FormatError),
    /// The folder holds a cohort or a run.
    #[error("{path} {holds}: name a separate folder for the sweep with --out")]
    Occupied {
        /// Path of the folder.
        path: PathBuf,
        /// Content of the folder, as a predicate.
        holds: &'static str,
    },
    /// The named folder holds no sweep.
    #[error("{path} holds no sweep: create one with `cardiotwin sweep gsa --out {path}`")]
    NoSweep {
        /// Path of the folder.
        path: PathBuf,
    },
    /// The sweep has no member yet.
    #[error("the sweep in {path} has no member yet: run the command that created the folder again")]
    Empty {
        /// Path of the folder.
        path: PathBuf,
    },
    /// The settings differ from those with which the sweep was made.
    #[error(
        "the sweep in {path} has other settings ({changes}), and its samples cannot be mixed: omit \
         these options, or name a new folder with --out"
    )]
    Changed {
        /// Path of the folder.
        path: PathBuf,
        /// Each changed setting with both values.
        changes: String,
    },
    /// A setting is invalid.
    #[error("{name} is {found}, expected {expected}")]
    Setting {
        /// Name of the option.
        name: String,
        /// Value that was given.
        found: String,
        /// Description of valid values.
        expected: String,
    },
    /// The sweep is of another kind than the command expects.
    #[error(
        "the folder holds a sweep of kind {found}: `cardiotwin sweep {found} COHORT --results-only` \
         shows its results"
    )]
    OtherKind {
        /// Kind of the sweep in the folder.
        found: &'static str,
    },
    /// Members of a robustness sweep cannot be made or compared.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// The Saltelli design or its outputs are invalid.
    #[error(transparent)]
    Sobol(#[from] SobolError),
    /// A chunk's artefact differs from the published one.
    #[error(
        "{path}: {problem}; restore the file from a copy, or remove the sweep's folder to recompute \
         it"
    )]
    Samples {
        /// Path of the artefact.
        path: PathBuf,
        /// Description of the difference.
        problem: String,
    },
    /// Too few blocks are complete for an analysis.
    #[error("{n_blocks} of {of} blocks are complete, but indices need at least 2")]
    TooEarly {
        /// Number of complete blocks before the first gap.
        n_blocks: u32,
        /// Number of blocks in the sweep.
        of: u32,
    },
}
