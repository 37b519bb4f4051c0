//! Errors of mesh files.

use std::io;
use std::path::{Path, PathBuf};

/// A mesh file that could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file cannot be read.
    #[error("cannot read {}", file.display())]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}", file.display())]
    Write {
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// A line is invalid.
    #[error("{}:{line}: found {found}, expected {expected}", file.display())]
    Line {
        /// Path of the file.
        file: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Content of the line, shortened.
        found: String,
        /// Description of a valid line.
        expected: String,
    },
    /// An element or triangle refers to a node that does not exist.
    #[error("{}:{line}: element names node {node}, but the mesh has {n_nodes} nodes, numbered from 0", file.display())]
    NodeOutOfRange {
        /// Path of the file.
        file: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Number of the node.
        node: i64,
        /// Number of nodes in the mesh.
        n_nodes: usize,
    },
    /// The file as a whole is invalid.
    #[error("{}: found {found}, expected {expected}", file.display())]
    Content {
        /// Path of the file.
        file: PathBuf,
        /// Description of the file's content.
        found: String,
        /// Description of valid content.
        expected: String,
    },
}

impl MeshFileError {
    pub(crate) fn line(
        file: &Path,
        line: usize,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Line {
            file: file.to_owned(),
            line,
            found: found.into(),
            expected: expected.into(),
        }
    }

    pub(crate) fn content(
        file: &Path,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Content {
            file: file.to_owned(),
            found: found.into(),
            expected: expected.into(),
        }
    }
}

pub(crate) fn read_bytes(file: &Path) -> Result<Vec<u8>, MeshFileError> {
    cardiotwin_input_files::read(file, cardiotwin_input_files::MaxBytes::MESH).map_err(|source| {
        MeshFileError::Read {
            file: file.to_owned(),
            source,
        }
    })
}

pub(crate) fn read_text(file: &Path) -> Result<String, MeshFileError> {
    String::from_utf8(read_bytes(file)?).map_err(|_| {
        MeshFileError::content(
            file,
            "bytes that are not text",
            "a text file (save or convert it as ASCII)",
        )
    })
}

pub(crate) fn write_bytes(file: &Path, bytes: &[u8]) -> Result<(), MeshFileError> {
    std::fs::write(file, bytes).map_err(|source| MeshFileError::Write {
        file: file.to_owned(),
        source,
    })
}
