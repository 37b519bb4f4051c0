//! What can be wrong with a mesh file.

use std::io;
use std::path::{Path, PathBuf};

/// A mesh file that could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The operating system refused to read.
    #[error("cannot read {}", file.display())]
    Read {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The operating system refused to write.
    #[error("cannot write {}", file.display())]
    Write {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A line that is not what it should be.
    #[error("{}:{line}: found {found}, expected {expected}", file.display())]
    Line {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
    },
    /// An element or triangle that names a node that is not there.
    #[error("{}:{line}: element names node {node}, but the mesh has {n_nodes} nodes, numbered from 0", file.display())]
    NodeOutOfRange {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// The node's number.
        node: i64,
        /// How many nodes there are.
        n_nodes: usize,
    },
    /// A file that is not what it should be as a whole.
    #[error("{}: found {found}, expected {expected}", file.display())]
    Content {
        /// Which file.
        file: PathBuf,
        /// What it holds.
        found: String,
        /// What it should.
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
    std::fs::read(file).map_err(|source| MeshFileError::Read {
        file: file.to_owned(),
        source,
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
