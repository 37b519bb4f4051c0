//! What can be wrong with a benchmark.

use std::path::{Path, PathBuf};

use cardiotwin_mesh::MeshFileError;

/// Why a benchmark has no, or no whole, result.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no benchmark.
    #[error("{}: {source}correct the key that is named; docs/benchmark-runner.md lists all of them", file.display())]
    Format {
        /// The file.
        file: PathBuf,
        /// Line, column and what was expected.
        source: Box<toml::de::Error>,
    },
    /// A value is wrong.
    #[error("{}: {key}: found {found}, expected {expected}", file.display())]
    Key {
        /// The file.
        file: PathBuf,
        /// Dotted key.
        key: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// The mesh cannot be read.
    #[error("{}: mesh.file: {source}", file.display())]
    Mesh {
        /// The benchmark file.
        file: PathBuf,
        /// Why.
        source: MeshFileError,
    },
    /// The table cannot be written.
    #[error("cannot write {}: {source}", file.display())]
    Write {
        /// The table.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The computation failed.
    #[error(
        "{0}; the table holds what was reached. A smaller time or load step, or stiffer volume change, may help"
    )]
    Failed(String),
    /// Asked to stop.
    #[error("stopped at {t_ms} ms; the table holds what was reached")]
    Stopped {
        /// Last row.
        t_ms: f64,
    },
}

impl CaseError {
    /// A wrong value at a key.
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

/// An error with its sources in one line.
pub(super) fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(inner) = source {
        text += &format!(": {inner}");
        source = inner.source();
    }
    text
}
