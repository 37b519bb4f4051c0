//! Errors in writing a report or an export.

use std::io;
use std::path::{Path, PathBuf};

/// Error in writing a folder or a file.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A folder cannot be created.
    #[error("cannot create {folder}")]
    Folder {
        /// Path of the folder.
        folder: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error("cannot write {file}")]
    File {
        /// Path of the file.
        file: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
}

impl WriteError {
    /// Closure for `map_err` that makes an error of a folder.
    pub fn folder(folder: &Path) -> impl FnOnce(io::Error) -> Self {
        let folder = folder.to_owned();
        |source| Self::Folder { folder, source }
    }

    /// Closure for `map_err` that makes an error of a file.
    pub fn file(file: &Path) -> impl FnOnce(io::Error) -> Self {
        let file = file.to_owned();
        |source| Self::File { file, source }
    }
}
