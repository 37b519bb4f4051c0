//! An attempt as its worker sees it: claimed by this process, revoked by the coordinator or closed by one outcome.
//!
//! ```text
//! spec.json ──► started.json (exclusive) ──► work ──► artefacts, synced ──► outcome.json (exclusive)
//!                   │ exists: exit 3                                           │ revoked: exit 4
//! ```

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_protocol::claim::{self, ClaimFile};
use cardiotwin_protocol::closing::{self, PreparedOutcome, Winner};
use cardiotwin_protocol::{names, process};
use cardiotwin_schemas::formats::{FormatError, SPEC};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::task::AttemptSpec;

use crate::clock;

/// Why an attempt cannot be started or closed.
#[derive(Debug, thiserror::Error)]
pub enum AttemptError {
    /// The specification cannot be read.
    #[error("cannot read {file}")]
    Read {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The specification is none, of a later version, or asks for more than this worker knows.
    #[error(transparent)]
    Spec(#[from] FormatError),
    /// Another process has the attempt.
    #[error(
        "{directory} was claimed before, by {holder}; a further try needs a directory of its own"
    )]
    Claimed {
        /// The attempt's directory.
        directory: PathBuf,
        /// Who, as far as it can be read.
        holder: String,
    },
    /// The coordinator revoked the attempt.
    #[error("{directory}: the attempt was revoked, and nothing is published")]
    Revoked {
        /// The attempt's directory.
        directory: PathBuf,
    },
    /// A file cannot be written.
    #[error("cannot write {file}")]
    Write {
        /// Which file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// A claimed attempt. Who holds this value is the only one who may publish.
#[derive(Debug)]
pub struct Attempt {
    directory: PathBuf,
    /// What is to be done.
    pub spec: AttemptSpec,
}

impl Attempt {
    /// Reads `spec.json` and claims the directory for this process.
    ///
    /// # Errors
    /// [`AttemptError::Claimed`] when any process claimed it before, living or dead; [`AttemptError::Revoked`] when
    /// it was revoked already; otherwise when files cannot be read or written.
    pub fn claim(directory: &Path) -> Result<Self, AttemptError> {
        let spec = read_spec(&directory.join(names::SPEC))?;
        let attempt = Self {
            directory: directory.to_owned(),
            spec,
        };
        if closing::is_revoked(directory) {
            return Err(attempt.revoked());
        }
        match claim::take(directory, &process::claim_of_this_process(clock::now())) {
            Ok(true) => Ok(attempt),
            Ok(false) => Err(AttemptError::Claimed {
                directory: directory.to_owned(),
                holder: holder(directory),
            }),
            Err(source) => Err(AttemptError::Write {
                file: directory.join(names::CLAIM),
                source,
            }),
        }
    }

    /// Where the attempt lives.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    fn revoked(&self) -> AttemptError {
        AttemptError::Revoked {
            directory: self.directory.clone(),
        }
    }

    /// Publishes the outcome and ends the attempt. Artefacts must be on disk before.
    ///
    /// # Errors
    /// [`AttemptError::Revoked`] when the attempt was revoked meanwhile; otherwise when the file cannot be written.
    pub fn publish(self, outcome: &TaskOutcome) -> Result<(), AttemptError> {
        let published =
            PreparedOutcome::new(&self.directory, outcome).and_then(PreparedOutcome::publish);
        match published {
            Ok(Winner::Worker) => Ok(()),
            Ok(Winner::Coordinator) => Err(self.revoked()),
            Err(source) => Err(AttemptError::Write {
                file: self.directory.join(names::OUTCOME),
                source,
            }),
        }
    }
}

/// Reads an attempt's specification.
fn read_spec(file: &Path) -> Result<AttemptSpec, AttemptError> {
    let text = fs::read(file).map_err(|source| AttemptError::Read {
        file: file.to_owned(),
        source,
    })?;
    Ok(SPEC.read_order(&file.display(), &text)?)
}

/// The holder of a claim, in words.
fn holder(directory: &Path) -> String {
    let Ok(ClaimFile::By(claim)) = claim::read(directory) else {
        return "somebody whose claim cannot be read".to_owned();
    };
    let state = if claim.boot_id != process::boot_id() {
        "on another host or before a reboot"
    } else if process::lives(&claim) {
        "which is running"
    } else {
        "which is gone"
    };
    format!(
        "process {} on {} since {}, {state}",
        claim.pid, claim.host, claim.at
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::AttemptId;
    use cardiotwin_schemas::progress::Claim;
    use cardiotwin_schemas::task::{NoopSpec, TaskSpec};

    fn directory_with_spec(schema_version: u32) -> tempfile::TempDir {
        let directory = tempfile::tempdir().unwrap();
        let task = TaskSpec::Noop(NoopSpec {
            label: "a".into(),
            sleep_ms: 0,
        });
        let attempt = AttemptId {
            task: task.key(),
            generation: 1,
        };
        let (threads, instruction_set, vtu_every_ms) = (1, Default::default(), 0.0);
        let spec = AttemptSpec {
            schema_version,
            attempt,
            threads,
            instruction_set,
            vtu_every_ms,
            task,
        };
        fs::write(
            directory.path().join("spec.json"),
            serde_json::to_string(&spec).unwrap(),
        )
        .unwrap();
        directory
    }

    #[test]
    fn a_claim_names_a_living_process_and_is_given_once() {
        let directory = directory_with_spec(SPEC.version);
        let attempt = Attempt::claim(directory.path()).unwrap();
        assert_eq!(attempt.spec.task.kind(), "noop");
        let claim: Claim =
            serde_json::from_slice(&fs::read(directory.path().join("started.json")).unwrap())
                .unwrap();
        assert_eq!(process::start_ticks(claim.pid), Some(claim.pid_start_ticks));
        let error = Attempt::claim(directory.path()).unwrap_err();
        assert!(
            matches!(&error, AttemptError::Claimed { holder, .. } if holder.ends_with("which is running")),
            "{error}"
        );
    }

    #[test]
    fn a_dead_claim_is_still_a_claim() {
        let directory = directory_with_spec(SPEC.version);
        let claim = Claim {
            host: "h".into(),
            boot_id: process::boot_id().into(),
            pid: 1,
            pid_start_ticks: 1,
            at: "t".into(),
        };
        fs::write(
            directory.path().join("started.json"),
            serde_json::to_string(&claim).unwrap(),
        )
        .unwrap();
        let error = Attempt::claim(directory.path()).unwrap_err().to_string();
        assert!(
            error.contains("process 1 on h since t, which is gone"),
            "{error}"
        );
    }

    #[test]
    fn a_spec_of_another_format_is_refused_with_both_versions() {
        let directory = directory_with_spec(SPEC.version + 1);
        let error = Attempt::claim(directory.path()).unwrap_err().to_string();
        assert!(error.contains("version 2, expected version 1"), "{error}");
        assert!(!directory.path().join("started.json").exists());
    }
}
