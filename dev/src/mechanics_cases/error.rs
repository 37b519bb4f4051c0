//! Errors of a mechanics benchmark.

use std::path::{Path, PathBuf};

use cardiotwin_mesh::MeshFileError;

/// Reasons why a benchmark has no result, or only a part of one.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", file.display())]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The file is not a valid benchmark.
    #[error("{}: {source}correct the key that is named; docs/benchmark-runner.md lists all of them", file.display())]
    Format {
        /// Path of the file.
        file: PathBuf,
        /// Line and column of the error, and the expected content.
        source: Box<toml::de::Error>,
    },
    /// A key has a wrong value.
    #[error("{}: {key}: found {found}, expected {expected}", file.display())]
    Key {
        /// Path of the file.
        file: PathBuf,
        /// The key, with dots between its parts.
        key: String,
        /// Value of the key in the file.
        found: String,
        /// Values that the key accepts.
        expected: String,
    },
    /// The mesh cannot be read.
    #[error("{}: mesh.file: {source}", file.display())]
    Mesh {
        /// Path of the benchmark file that names the mesh.
        file: PathBuf,
        /// Error of the mesh reader, with the path of the mesh.
        source: MeshFileError,
    },
    /// The table cannot be written.
    #[error("cannot write {}: {source}", file.display())]
    Write {
        /// File of the table.
        file: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The computation ended early with an error of the solver.
    #[error(
        "{0}; the table holds what was reached. A smaller time or load step, or stiffer volume change, may help"
    )]
    Failed(String),
    /// The run was asked to stop.
    #[error("stopped at {t_ms} ms; the table holds what was reached")]
    Stopped {
        /// Time of the last row \[ms\].
        t_ms: f64,
    },
}

/// The error of a wrong value.
impl CaseError {
    /// The error of a wrong value.
    pub fn key(
        file: &Path,
        key: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Key {
            file: file.to_owned(),
            key: key.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }
}
