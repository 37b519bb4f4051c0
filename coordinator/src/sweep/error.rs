//! Why a sweep cannot be made, gone on with or analysed.

use std::io;
use std::path::PathBuf;

use cardiotwin_calibrate::sobol::SobolError;

use super::robustness::DesignError;

/// What is wrong with a sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A file of the sweep.
    #[error("cannot {what} {path}")]
    File {
        /// Verb.
        what: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// `sweep.json` is not one of ours, or of a later version.
    #[error(transparent)]
    Format(#[from] cardiotwin_schemas::formats::FormatError),
    /// A folder that holds something else.
    #[error("{path} {holds}: a sweep needs a folder of its own, see --out")]
    Occupied {
        /// Which folder.
        path: PathBuf,
        /// What it is.
        holds: &'static str,
    },
    /// No sweep where one was named.
    #[error("{path} holds no sweep: `cardiotwin sweep gsa --out {path}` makes one there")]
    NoSweep {
        /// Which folder.
        path: PathBuf,
    },
    /// A sweep without a member yet.
    #[error("the sweep in {path} has no member yet: the command that made the folder goes on")]
    Empty {
        /// Which folder.
        path: PathBuf,
    },
    /// Other settings than those the folder was made with.
    #[error(
        "the sweep in {path} was made with other settings: {changes}; its samples cannot be mixed: leave these options \
         out, or give a new folder with --out"
    )]
    Changed {
        /// Which folder.
        path: PathBuf,
        /// Each setting with both values.
        changes: String,
    },
    /// A setting that makes no sense.
    #[error("{name} is {found}, expected {expected}")]
    Setting {
        /// Which option.
        name: String,
        /// What was given.
        found: String,
        /// What would do.
        expected: String,
    },
    /// A sweep of another kind than the command is about.
    #[error(
        "the folder holds a sweep of kind {found}: `cardiotwin sweep {found} COHORT --results-only` tells its results"
    )]
    OtherKind {
        /// Which.
        found: &'static str,
    },
    /// Members of a robustness sweep.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// The design or its outputs.
    #[error(transparent)]
    Sobol(#[from] SobolError),
    /// A chunk's artefact is not what was published.
    #[error(
        "{path}: {problem}; the chunk has to be computed again: remove the sweep's folder, or restore the file from a copy"
    )]
    Samples {
        /// Which file.
        path: PathBuf,
        /// What was found and expected.
        problem: String,
    },
    /// Too little is there.
    #[error("{n_blocks} of {of} blocks are complete, but indices need at least 2")]
    TooEarly {
        /// Complete first blocks.
        n_blocks: u32,
        /// Blocks of the sweep.
        of: u32,
    },
}
