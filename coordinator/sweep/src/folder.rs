//! `sweep.json`, which says which sweep a folder holds and keeps other runs out of it.

use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_report::results::atomic;
use cardiotwin_schemas::formats::SWEEP;
use cardiotwin_schemas::sweep::SweepFile;

use super::SweepError;

/// File by which a sweep's folder is recognised.
pub const FILE: &str = "sweep.json";
/// Folder of the result files, inside the sweep's folder.
pub const RESULTS: &str = "results";

/// The sweep in a folder; `None` if it holds none.
///
/// # Errors
/// [`SweepError`] if the file exists and cannot be read.
pub fn find(folder: &Path) -> Result<Option<SweepFile>, SweepError> {
    let path = folder.join(FILE);
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
            ) =>
        {
            return Ok(None);
        }
        Err(source) => {
            return Err(SweepError::File {
                what: "read",
                path,
                source,
            });
        }
    };
    Ok(Some(SWEEP.read(&path.display(), &text)?))
}

/// The sweep in a folder that must hold one.
///
/// # Errors
/// [`SweepError::NoSweep`] if it holds none, and the errors of [`find`].
pub fn read(folder: &Path) -> Result<SweepFile, SweepError> {
    find(folder)?.ok_or_else(|| SweepError::NoSweep {
        path: folder.to_owned(),
    })
}

/// Makes the folder if it does not exist, and writes its file.
///
/// # Errors
/// [`SweepError::Occupied`] for a cohort, or for a run that is not a sweep; [`SweepError::File`] if
/// the folder or its file cannot be written.
pub fn write(folder: &Path, file: &SweepFile) -> Result<(), SweepError> {
    let path = folder.join(FILE);
    let occupied = |name: &str, holds| {
        (folder.join(name).exists() && !path.exists())
            .then(|| SweepError::Occupied {
                path: folder.to_owned(),
                holds,
            })
            .map_or(Ok(()), Err)
    };
    occupied("cohort.toml", "is a cohort")?;
    occupied("cardiotwin.db", "is the run of a cohort")?;
    std::fs::create_dir_all(folder).map_err(|source| SweepError::File {
        what: "create",
        path: folder.to_owned(),
        source,
    })?;
    let text = serde_json::to_string_pretty(file).expect("a sweep's file is JSON") + "\n";
    atomic::write(&path, |out| out.write_all(text.as_bytes())).map_err(|source| SweepError::File {
        what: "write",
        path,
        source,
    })
}

/// Writes a file of results and returns its path.
///
/// # Errors
/// [`SweepError::File`] if the file cannot be written.
pub fn write_result(folder: &Path, name: &str, text: &str) -> Result<PathBuf, SweepError> {
    let results = folder.join(RESULTS);
    std::fs::create_dir_all(&results).map_err(|source| SweepError::File {
        what: "create",
        path: results.clone(),
        source,
    })?;
    let path = results.join(name);
    atomic::replace(&path, |out| out.write_all(text.as_bytes())).map_err(|source| {
        SweepError::File {
            what: "write",
            path: path.clone(),
            source,
        }
    })?;
    Ok(path)
}
