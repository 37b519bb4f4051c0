//! Comparison of a run's files with the hashes that its database holds.

use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::hash::sha256_of_file;
use cardiotwin_store::{MovedCohort, Reader, StoreError, StoredFile};
use serde::Serialize;

/// Whether a file is as it was stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FileState {
    /// Its content has the stored hash.
    AsStored,
    /// Its content has another hash.
    Changed,
    /// It does not exist.
    Missing,
    /// It cannot be read.
    Unreadable,
}

impl FileState {
    /// Name in tables.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::AsStored => "as stored",
            Self::Changed => "changed",
            Self::Missing => "missing",
            Self::Unreadable => "unreadable",
        }
    }
}

/// A file that was compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct VerifiedFile {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Step that made the file; `input` for a file of the cohort.
    pub step: String,
    /// Absolute path.
    pub path: PathBuf,
    /// Result of the comparison.
    pub standing: FileState,
    /// The stored hash, SHA-256.
    pub expected_sha256: String,
    /// Hash of the present content; `None` if it could not be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found_sha256: Option<String>,
    /// Why the file could not be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// What was compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    /// Every file whose hash is stored.
    pub files: Vec<VerifiedFile>,
    /// Where the cohort's files were read, if not in the folder that the run read.
    pub moved: Option<MovedCohort>,
}

/// Compares every file whose hash is stored, next to a running coordinator, too.
///
/// # Errors
/// [`StoreError`] if the database cannot be read. A file that cannot be read is a result.
pub async fn verify(run_dir: &Path) -> Result<Verified, StoreError> {
    let reader = Reader::open(run_dir).await?;
    let files = reader.stored_files().await?;
    Ok(Verified {
        files: files.into_iter().map(compared).collect(),
        moved: reader.moved_cohort().await?,
    })
}

fn compared(file: StoredFile) -> VerifiedFile {
    let hashed = sha256_of_file(&file.path);
    let standing = match &hashed {
        Ok(found) if *found == file.sha256 => FileState::AsStored,
        Ok(_) => FileState::Changed,
        Err(error) if error.kind() == io::ErrorKind::NotFound => FileState::Missing,
        Err(_) => FileState::Unreadable,
    };
    let why = hashed.as_ref().err().map(ToString::to_string);
    VerifiedFile {
        patient: file.patient,
        step: file.step,
        path: file.path,
        standing,
        expected_sha256: file.sha256,
        found_sha256: hashed.ok(),
        why: why.filter(|_| standing == FileState::Unreadable),
    }
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::hash::sha256_hex;

    use super::*;

    #[test]
    fn a_file_is_as_stored_or_changed_or_missing_or_unreadable() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.csv"), "1,2\n").unwrap();
        let of = |name: &str, text: &str| {
            let found = compared(StoredFile {
                patient: "P1".into(),
                step: "step-1".into(),
                path: folder.path().join(name),
                sha256: sha256_hex(text.as_bytes()),
            });
            (found.standing, found.why.is_some())
        };
        assert_eq!(of("a.csv", "1,2\n"), (FileState::AsStored, false));
        assert_eq!(of("a.csv", "1,3\n"), (FileState::Changed, false));
        assert_eq!(of("b.csv", "1,2\n"), (FileState::Missing, false));
        assert_eq!(of("", "1,2\n"), (FileState::Unreadable, true));
    }
}
