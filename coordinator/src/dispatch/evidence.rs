//! What an attempt's directory tells.

use std::fs;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::Path;
use std::time::Duration;

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::progress::Claim;

use super::{DispatchError, Evidence};

/// What is to be done.
pub const SPEC: &str = "spec.json";
pub const CLAIM: &str = "started.json";
pub const OUTCOME: &str = "outcome.json";
/// The coordinator's word that the attempt is revoked.
pub const FENCE: &str = "fence";
pub const LOG: &str = "stderr.log";

/// The outcome, if one was published. An outcome that cannot be read, or whose files are not there, is evidence too.
pub fn outcome(directory: &Path) -> Result<Option<Evidence>, DispatchError> {
    let path = directory.join(OUTCOME);
    let text = match fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => {
            return Err(DispatchError::File {
                what: "read",
                path,
                source,
            });
        }
    };
    let outcome: TaskOutcome = match serde_json::from_str(&text) {
        Ok(outcome) => outcome,
        // Outcomes appear by rename, so that half of one is never seen: this is a defect, no accident.
        Err(error) => {
            let reason = format!("{} cannot be read: {error}", path.display());
            return Ok(Some(Evidence::Nothing {
                class: FailureClass::Bug,
                reason,
            }));
        }
    };
    for artefact in &outcome.artefacts {
        let file = directory.join(&artefact.file);
        let found = fs::metadata(&file).map(|m| m.len()).ok();
        if found != Some(artefact.bytes) {
            let found = found.map_or("is not there".to_owned(), |n| format!("has {n} bytes"));
            let reason = format!(
                "{} {found}, but its outcome says {} bytes",
                file.display(),
                artefact.bytes
            );
            return Ok(Some(Evidence::Nothing {
                class: FailureClass::Site,
                reason,
            }));
        }
    }
    Ok(Some(Evidence::Outcome {
        outcome: Box::new(outcome),
        text,
    }))
}

/// Who claimed the attempt.
pub enum ClaimFile {
    /// Nobody.
    Absent,
    /// Somebody whose claim is empty or cut: it is being written, or its writer was killed in between.
    Unreadable,
    /// This process.
    By(Claim),
}

/// How long ago the claim was written last; nothing where that cannot be told.
pub fn claim_age(directory: &Path) -> Option<Duration> {
    let written = fs::metadata(directory.join(CLAIM)).and_then(|claim| claim.modified());
    written.ok()?.elapsed().ok()
}

pub fn claim(directory: &Path) -> Result<ClaimFile, DispatchError> {
    let path = directory.join(CLAIM);
    match fs::read(&path) {
        Ok(bytes) => {
            Ok(serde_json::from_slice(&bytes).map_or(ClaimFile::Unreadable, ClaimFile::By))
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(ClaimFile::Absent),
        Err(source) => Err(DispatchError::File {
            what: "read",
            path,
            source,
        }),
    }
}

/// Revokes an attempt: its worker publishes nothing once this is there.
pub fn fence(directory: &Path) -> Result<(), DispatchError> {
    let path = directory.join(FENCE);
    match fs::write(&path, b"revoked by the coordinator\n") {
        Ok(()) => Ok(()),
        // Never started: nobody to revoke.
        Err(error) if error.kind() == io::ErrorKind::NotFound && !directory.exists() => Ok(()),
        Err(source) => Err(DispatchError::File {
            what: "write",
            path,
            source,
        }),
    }
}

/// Last line of the worker's log, for messages.
pub fn last_words(directory: &Path) -> Option<String> {
    let mut file = fs::File::open(directory.join(LOG)).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(2000)))
        .ok()?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    text.lines()
        .rev()
        .map(str::trim)
        .find(|line| !line.is_empty())
        .map(|line| line.chars().take(300).collect())
}
