//! `sweep.json`: a folder knows what it is about, and is never filled with anything else.

use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::formats::SWEEP;
use cardiotwin_schemas::sweep::SweepFile;

use super::SweepError;
use crate::results::atomic;

/// File that tells a sweep's folder.
pub const FILE: &str = "sweep.json";
/// Where results are written.
pub const RESULTS: &str = "results";

/// What the folder is about; none where it holds no sweep.
///
/// # Errors
/// [`SweepError`] when the file is there and cannot be read.
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

/// As [`find`], where there must be one.
///
/// # Errors
/// [`SweepError::NoSweep`] and those of [`find`].
pub fn read(folder: &Path) -> Result<SweepFile, SweepError> {
    find(folder)?.ok_or_else(|| SweepError::NoSweep {
        path: folder.to_owned(),
    })
}

/// Makes the folder if need be, and writes its file.
///
/// # Errors
/// [`SweepError::Occupied`] for a cohort, or a run that is no sweep; whatever the file system says.
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
        what: "make",
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

/// Writes a file of results, and tells where.
///
/// # Errors
/// Whatever the file system says.
pub fn write_result(folder: &Path, name: &str, text: &str) -> Result<PathBuf, SweepError> {
    let results = folder.join(RESULTS);
    std::fs::create_dir_all(&results).map_err(|source| SweepError::File {
        what: "make",
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
