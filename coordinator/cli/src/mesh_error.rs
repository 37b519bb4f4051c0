//! Errors of the `mesh` commands, from files and from mmg3d.

use std::path::PathBuf;

use cardiotwin_mesh::files::MeshFileError;
use cardiotwin_mesh::repair::RepairError;

/// Errors of a mesh command in reading, repairing or writing a mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileCommandError {
    /// A mesh file could not be read or written.
    #[error(transparent)]
    File(#[from] MeshFileError),
    /// The output file exists and `--force` was not given.
    #[error("{path} already exists; name another file with --out, or replace it with --force")]
    Exists {
        /// Path of the existing file.
        path: String,
    },
    /// The mesh could not be repaired.
    #[error("{path} cannot be repaired: {source}")]
    Repair {
        /// Path of the mesh's file.
        path: String,
        /// Reason given by the repair.
        source: RepairError,
    },
}

/// Errors of a call of mmg3d.
#[derive(Debug, thiserror::Error)]
pub enum MmgError {
    /// mmg3d is not installed.
    #[error(
        "mmg3d is not in PATH; install it with `pip install mmgpy` or from https://www.mmgtools.org, or name it with --mmg3d"
    )]
    Missing,
    /// The program cannot be started.
    #[error("cannot start {program}")]
    Start {
        /// Path of the program.
        program: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The program ended with an error or wrote no mesh.
    #[error("{program} wrote no mesh; its output was:\n{said}")]
    Failed {
        /// Path of the program.
        program: PathBuf,
        /// Last lines of its output.
        said: String,
    },
    /// A mesh could not be written for mmg3d, or its answer could not be read.
    #[error("cannot exchange files with mmg3d")]
    File(#[from] MeshFileError),
    /// The temporary folder could not be made.
    #[error("cannot create a temporary folder for mmg3d")]
    Folder(#[source] std::io::Error),
}
