//! Claim on an attempt: only one of the processes that start in its directory may work.

use std::fs;
use std::io;
use std::path::Path;
use std::time::Duration;

use cardiotwin_schemas::formats::CLAIM;
use cardiotwin_schemas::progress::Claim;

use crate::{files, names};

/// Content of a claim's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ClaimFile {
    /// No process has claimed the attempt.
    Absent,
    /// The claim is empty, cut or of a later version: a worker of an earlier version is writing it, or was killed in between.
    Unreadable,
    /// The process that claimed the attempt.
    By(Claim),
}

/// Claims an attempt. Returns `false` if another process has claimed it first.
///
/// # Errors
/// Any error of the file system.
pub fn take(directory: &Path, claim: &Claim) -> io::Result<bool> {
    let text = serde_json::to_vec_pretty(claim)?;
    files::create_exclusive(&directory.join(names::CLAIM), &text)
}

/// Reads the claim on an attempt.
///
/// # Errors
/// Any error of the file system except a missing file.
pub fn read(directory: &Path) -> io::Result<ClaimFile> {
    let path = directory.join(names::CLAIM);
    match fs::read(&path) {
        Ok(bytes) => {
            let claim = CLAIM.read(&path.display(), &bytes);
            Ok(claim.map_or(ClaimFile::Unreadable, ClaimFile::By))
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(ClaimFile::Absent),
        Err(error) => Err(error),
    }
}

/// Time since the claim was last written; `None` if it is unknown.
#[must_use]
pub fn age(directory: &Path) -> Option<Duration> {
    let written = fs::metadata(directory.join(names::CLAIM)).and_then(|claim| claim.modified());
    written.ok()?.elapsed().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::claim_of_this_process;

    #[test]
    fn a_claim_is_given_once_and_names_who_has_it() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read(dir.path()).unwrap(), ClaimFile::Absent);
        let claim = claim_of_this_process("t".into());
        assert!(take(dir.path(), &claim).unwrap());
        assert!(!take(dir.path(), &claim).unwrap());
        assert_eq!(read(dir.path()).unwrap(), ClaimFile::By(claim));
        fs::write(dir.path().join(names::CLAIM), "{\"host\":").unwrap();
        assert_eq!(read(dir.path()).unwrap(), ClaimFile::Unreadable);
    }
}
