//! Contents of an attempt's directory: outcome, claim, revocation, and the end of the worker's log.

use std::fs;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use cardiotwin_protocol::claim::{self, ClaimFile};
use cardiotwin_protocol::closing::{self, Closing, Winner};
use cardiotwin_protocol::names;
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::{Revocation, TaskOutcome};

use super::{DispatchError, Evidence};
use crate::clock;

fn file(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DispatchError {
    let path = path.to_owned();
    move |source| DispatchError::File { what, path, source }
}

/// The outcome, if one was published. An outcome that cannot be read, or whose files are missing,
/// counts as evidence, too. A revoked attempt has no outcome.
///
/// # Errors
/// [`DispatchError::File`] if the directory cannot be read.
pub fn outcome(directory: &Path) -> Result<Option<Evidence>, DispatchError> {
    let path = directory.join(names::OUTCOME);
    match closing::read(directory).map_err(file("read", &path))? {
        Closing::Published(text) => Ok(Some(evidence_of(directory, text))),
        Closing::Open | Closing::Revoked(_) => Ok(None),
    }
}

fn evidence_of(directory: &Path, text: String) -> Evidence {
    let path = directory.join(names::OUTCOME);
    let read = formats::OUTCOME.read(&path.display(), text.as_bytes());
    let outcome: TaskOutcome = match read {
        Ok(outcome) => outcome,
        // Outcomes appear complete or not at all, so that half an outcome is a defect of the
        // program.
        Err(error) => {
            return Evidence::Nothing {
                class: FailureClass::Bug,
                reason: error.in_full(),
            };
        }
    };
    for artefact in &outcome.artefacts {
        let file = directory.join(&artefact.file);
        let found = fs::metadata(&file).map(|m| m.len()).ok();
        if found != Some(artefact.bytes) {
            let found = found.map_or("does not exist".to_owned(), |n| format!("has {n} bytes"));
            let reason = format!(
                "{} {found}, but its outcome says {} bytes",
                file.display(),
                artefact.bytes
            );
            return Evidence::Nothing {
                class: FailureClass::Site,
                reason,
            };
        }
    }
    Evidence::Outcome {
        outcome: Box::new(outcome),
        text,
    }
}

/// Reads the claim on an attempt.
///
/// # Errors
/// [`DispatchError::File`] if the claim cannot be read.
pub fn claim_on(directory: &Path) -> Result<ClaimFile, DispatchError> {
    claim::read(directory).map_err(file("read", &directory.join(names::CLAIM)))
}

/// Revokes an attempt, so that its worker publishes nothing from now on. An outcome that was
/// published before stays valid and is returned.
///
/// - `reason`: explanation for people who read the attempt's directory
///
/// # Errors
/// [`DispatchError::File`] if the revocation cannot be written or the outcome cannot be read.
pub fn revoke(
    directory: &Path,
    attempt: &AttemptId,
    reason: &str,
) -> Result<Option<Evidence>, DispatchError> {
    let revocation = Revocation {
        schema_version: formats::REVOCATION.version,
        attempt: attempt.clone(),
        reason: reason.to_owned(),
        at: clock::now_utc(),
    };
    let path = directory.join(names::OUTCOME);
    match closing::revoke(directory, &revocation).map_err(file("write", &path))? {
        Winner::Worker => outcome(directory),
        Winner::Coordinator => Ok(None),
    }
}

/// Last line of the worker's log, at most 300 characters, for error messages.
pub fn last_words(directory: &Path) -> Option<String> {
    let mut file = fs::File::open(directory.join(names::LOG)).ok()?;
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
