//! What ends a command, and with which exit code.

use std::path::PathBuf;

use cardiotwin_mesh::MeshFileError;

use crate::discovery::overlay::OverlayError;
use crate::engine::{EngineError, LockError, StoreError};
use crate::results::WriteError;
use crate::sweep::SweepError;

use super::commands::mesh::{MeshFileCommandError, MmgError};
use super::exit::Exit;

/// A command could not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The loop or a request.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// Reading a run.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Drawing the report.
    #[error("cannot write the report")]
    Report(#[source] WriteError),
    /// Writing tables, or the folder of a patient.
    #[error("cannot export")]
    Export(#[source] WriteError),
    /// Making, going on with or analysing a sweep.
    #[error(transparent)]
    Sweep(#[from] SweepError),
    /// Accepting what was found, or undoing it.
    #[error(transparent)]
    Overlay(#[from] OverlayError),
    /// Problems that were printed one by one before.
    #[error("{errors} in the input; nothing was run (`cardiotwin check` looks again)")]
    Input {
        /// How many, in words.
        errors: String,
    },
    /// Problems of a trace that were printed one by one before.
    #[error("{errors} in the trace; nothing was fitted")]
    Trace {
        /// How many, in words.
        errors: String,
    },
    /// Problems of recordings that were printed one by one before.
    #[error("{errors} in the recordings; nothing was written")]
    Recordings {
        /// How many, in words.
        errors: String,
    },
    /// A mesh that cannot be read, mended or written.
    #[error(transparent)]
    Mesh(Box<MeshFileCommandError>),
    /// Meshing anew.
    #[error(transparent)]
    Mmg(MmgError),
    /// Arguments that contradict each other or name nothing.
    #[error("{0}")]
    Usage(String),
    /// A file or directory.
    #[error("cannot {what} {path}")]
    File {
        /// Verb.
        what: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The worker's answer.
    #[error("{worker}: {message}")]
    Worker {
        /// Which executable.
        worker: PathBuf,
        /// What it said.
        message: String,
    },
    /// A simulation that did not succeed.
    #[error("{message}")]
    Simulation {
        /// How it ended.
        message: String,
    },
    /// The terminal, a pipe or a signal handler.
    #[error("{what}")]
    Io {
        /// What was tried.
        what: &'static str,
        /// Why.
        source: std::io::Error,
    },
}

impl CliError {
    /// A failed operation on a file.
    pub fn file(
        what: &'static str,
        path: impl Into<PathBuf>,
    ) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { what, path, source }
    }

    /// The exit code that belongs to it.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::Engine(EngineError::Lock(LockError::Held { .. })) => Exit::Locked,
            Self::Engine(EngineError::Store(error)) | Self::Store(error) => store_exit(error),
            Self::Engine(EngineError::NoSpace { .. } | EngineError::Plan { .. }) => Exit::Store,
            Self::Engine(EngineError::Transition(_)) => Exit::Bug,
            Self::Engine(EngineError::Request { .. } | EngineError::OnCluster { .. })
            | Self::Usage(_) => Exit::Usage,
            Self::Engine(EngineError::Site { .. } | EngineError::OtherWorker { .. }) => Exit::Input,
            Self::Sweep(error) => sweep_exit(error),
            Self::Input { .. } | Self::Trace { .. } | Self::Recordings { .. } => Exit::Input,
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
