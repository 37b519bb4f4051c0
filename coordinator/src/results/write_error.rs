//! What went wrong when report or export wrote.

use std::io;
use std::path::{Path, PathBuf};

/// Something that could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A folder.
    #[error("cannot create {folder}")]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A file.
    #[error("cannot write {file}")]
    File {
        /// The file.
        file: PathBuf,
        /// The cause.
        source: io::Error,
    },
}

impl WriteError {
    /// Of a folder.
    pub fn folder(folder: &Path) -> impl FnOnce(io::Error) -> Self {
        let folder = folder.to_owned();
        |source| Self::Folder { folder, source }
    }

    /// Of a file.
    pub fn file(file: &Path) -> impl FnOnce(io::Error) -> Self {
        let file = file.to_owned();
        |source| Self::File { file, source }
    }
}
