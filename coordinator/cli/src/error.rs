//! Errors that end a command, and their exit codes.

use std::path::PathBuf;

use cardiotwin_mesh::MeshFileError;

use cardiotwin_engine::{EngineError, LockError, StoreError};
use cardiotwin_report::results::WriteError;
use cardiotwin_sweep::SweepError;
use cardiotwin_sweep::discovery::overlay::OverlayError;

use super::exit::Exit;
use super::mesh_error::{MeshFileCommandError, MmgError};

/// Error that ends a command.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The engine's loop or a request to it failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A run's database cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The report cannot be written.
    #[error("cannot write the report")]
    Report(#[source] WriteError),
    /// Tables or the folder of a patient cannot be written.
    #[error("cannot export")]
    Export(#[source] WriteError),
    /// A sweep cannot be made, continued or analysed.
    #[error(transparent)]
    Sweep(#[from] SweepError),
    /// An acceptance of findings cannot be made or undone.
    #[error(transparent)]
    Overlay(#[from] OverlayError),
    /// The input has errors, which were printed one by one.
    #[error("{errors} in the input; nothing was run (`cardiotwin check` looks again)")]
    Input {
        /// Number of errors in words, such as `2 errors`.
        errors: String,
    },
    /// A trace has errors, which were printed one by one.
    #[error("nothing was fitted; errors in the traces: {n_errors}")]
    Trace {
        /// Number of errors.
        n_errors: usize,
    },
    /// Recordings have errors, which were printed one by one.
    #[error("{errors} in the recordings; nothing was written")]
    Recordings {
        /// Number of errors in words.
        errors: String,
    },
    /// No beat can be made from the recordings.
    #[error("{0}")]
    NoBeats(String),
    /// A mesh cannot be read, repaired or written.
    #[error(transparent)]
    Mesh(Box<MeshFileCommandError>),
    /// mmg3d cannot be run or failed.
    #[error(transparent)]
    Mmg(MmgError),
    /// The dashboard cannot be served.
    #[error(transparent)]
    Dashboard(#[from] cardiotwin_dashboard::ServerError),
    /// Arguments contradict each other or name something that does not exist.
    #[error("{0}")]
    Usage(String),
    /// An operation on a file or directory failed.
    #[error("cannot {what} {path}")]
    File {
        /// Verb of the operation, as in "cannot read".
        what: &'static str,
        /// Path of the file or directory.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The worker failed or gave an unusable answer.
    #[error("{worker}: {message}")]
    Worker {
        /// Path of the worker's executable.
        worker: PathBuf,
        /// Description of the failure, or the worker's own words.
        message: String,
    },
    /// A simulation did not succeed.
    #[error("{message}")]
    Simulation {
        /// Description of how the simulation ended.
        message: String,
    },
    /// The terminal, a pipe, a signal handler or a serialisation failed.
    #[error("{what}")]
    Io {
        /// Operation that failed, as a sentence.
        what: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

impl CliError {
    /// Closure for `map_err` that turns an I/O error into [`CliError::File`]; `what` is the verb.
    pub fn file(
        what: &'static str,
        path: impl Into<PathBuf>,
    ) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { what, path, source }
    }

    /// Exit code for this error.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::Engine(EngineError::Lock(LockError::Held { .. })) => Exit::Locked,
            Self::Engine(EngineError::Store(error)) | Self::Store(error) => store_exit(error),
            Self::Engine(EngineError::NoSpace { .. } | EngineError::Plan { .. }) => Exit::Store,
            Self::Engine(EngineError::Transition(_)) => Exit::Bug,
            Self::Engine(EngineError::Request { .. } | EngineError::OnCluster { .. })
            | Self::Usage(_) => Exit::Usage,
            Self::Engine(
                EngineError::Site { .. }
                | EngineError::NoAccount { .. }
                | EngineError::OtherWorker { .. },
            ) => Exit::Input,
            Self::Sweep(error) => sweep_exit(error),
            Self::Input { .. }
            | Self::Trace { .. }
            | Self::Recordings { .. }
            | Self::NoBeats(_) => Exit::Input,
            Self::Overlay(OverlayError::NothingAccepted { .. }) => Exit::Usage,
            Self::Overlay(OverlayError::Format { .. }) => Exit::Input,
            Self::Simulation { .. } => Exit::Problems,
            Self::Mesh(error) => match error.as_ref() {
                MeshFileCommandError::Exists { .. } => Exit::Usage,
                MeshFileCommandError::Repair { .. } => Exit::Input,
                MeshFileCommandError::File(
                    MeshFileError::Write { .. } | MeshFileError::Read { .. },
                ) => Exit::System,
                MeshFileCommandError::File(_) => Exit::Input,
            },
            Self::Mmg(MmgError::Failed { .. }) => Exit::Problems,
            Self::Engine(_)
            | Self::Mmg(_)
            | Self::Overlay(_)
            | Self::Dashboard(_)
            | Self::Report(_)
            | Self::Export(_)
            | Self::File { .. }
            | Self::Worker { .. }
            | Self::Io { .. } => Exit::System,
        }
    }
}

fn sweep_exit(error: &SweepError) -> Exit {
    match error {
        SweepError::Occupied { .. }
        | SweepError::NoSweep { .. }
        | SweepError::Changed { .. }
        | SweepError::OtherKind { .. }
        | SweepError::Setting { .. } => Exit::Usage,
        SweepError::Design(_) => Exit::Input,
        SweepError::Format(_) | SweepError::Samples { .. } => Exit::Store,
        SweepError::Sobol(_) | SweepError::TooEarly { .. } | SweepError::Empty { .. } => {
            Exit::Problems
        }
        SweepError::File { .. } => Exit::System,
    }
}

fn store_exit(error: &StoreError) -> Exit {
    match error {
        StoreError::NoPatient { .. } => Exit::Usage,
        StoreError::LeaseLost { .. } => Exit::Locked,
        _ => Exit::Store,
    }
}
