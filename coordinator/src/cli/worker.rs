//! The worker's executable, where a command calls it itself.

use std::path::{Path, PathBuf};

use super::error::CliError;
use crate::engine::EngineError;

/// The one that was named, else `cardiotwin-worker` beside this program.
///
/// # Errors
/// Where it is not there.
pub fn find(given: Option<&Path>) -> Result<PathBuf, CliError> {
    let path = match given {
        Some(path) => path.to_owned(),
        None => std::env::current_exe()
            .map_err(|source| CliError::Io { what: "cannot find this program's folder", source })?
            .with_file_name("cardiotwin-worker"),
    };
    if path.is_file() { Ok(path) } else { Err(EngineError::NoWorker { path }.into()) }
}
