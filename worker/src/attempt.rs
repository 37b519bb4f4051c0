//! Life of an attempt in its worker: the process claims the directory, works and publishes one
//! outcome, unless the coordinator revokes the attempt first.
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
use cardiotwin_schemas::progress::Claim;
use cardiotwin_schemas::task::AttemptSpec;

use crate::clock;

/// Reasons why an attempt cannot be started or closed.
#[derive(Debug, thiserror::Error)]
pub enum AttemptError {
    /// The specification cannot be read.
    #[error("cannot read {file}")]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The file is not the specification of an attempt, is of a later version, or asks for more than this worker knows.
    #[error(transparent)]
    Spec(#[from] FormatError),
    /// Another process has claimed the attempt.
    #[error(
        "{directory} has already been claimed by {holder}; another attempt needs its own directory"
    )]
    Claimed {
        /// Path of the attempt's directory.
        directory: PathBuf,
        /// Description of the claiming process, as far as its claim can be read.
        holder: String,
    },
    /// The coordinator revoked the attempt.
    #[error("the attempt in {directory} was revoked; nothing is published")]
    Revoked {
        /// Path of the attempt's directory.
        directory: PathBuf,
    },
    /// A claim or an outcome cannot be written.
    #[error("cannot write {file}")]
    Write {
        /// Path of the file.
        file: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
}

/// A claimed attempt. Only the owner of this value may publish an outcome.
#[derive(Debug)]
pub struct Attempt {
    directory: PathBuf,
    /// Specification of the task.
    pub spec: AttemptSpec,
}

impl Attempt {
    /// Reads `spec.json` and claims the directory for this process.
    ///
    /// - `nodes`: names of the nodes whose MPI ranks work on it; empty for a process alone
    ///
    /// # Errors
    /// [`AttemptError::Claimed`] when any process, living or dead, claimed it before;
    /// [`AttemptError::Revoked`] when it was revoked already; otherwise when files cannot be read
    /// or written.
    pub fn claim(directory: &Path, nodes: &[String]) -> Result<Self, AttemptError> {
        let spec = read_spec(&directory.join(names::SPEC))?;
        let attempt = Self {
            directory: directory.to_owned(),
            spec,
        };
        if closing::is_revoked(directory) {
            return Err(attempt.revoked());
        }
        let by = Claim {
            nodes: nodes.to_vec(),
            ..process::claim_of_this_process(clock::now())
        };
        match claim::take(directory, &by) {
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

    /// Path of the attempt's directory, in which the worker writes all files.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    fn revoked(&self) -> AttemptError {
        AttemptError::Revoked {
            directory: self.directory.clone(),
        }
    }

    /// Publishes the outcome and ends the attempt. Artefacts must be on disk before the call.
    ///
    /// # Errors
    /// [`AttemptError::Revoked`] when the attempt was revoked meanwhile; otherwise when the file
    /// cannot be written.
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

fn read_spec(file: &Path) -> Result<AttemptSpec, AttemptError> {
    let text = fs::read(file).map_err(|source| AttemptError::Read {
        file: file.to_owned(),
        source,
    })?;
    Ok(SPEC.read_order(&file.display(), &text)?)
}

/// Describes the process that holds the claim.
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
        let attempt = Attempt::claim(directory.path(), &[]).unwrap();
        assert_eq!(attempt.spec.task.kind(), "noop");
        let claim: Claim =
            serde_json::from_slice(&fs::read(directory.path().join("started.json")).unwrap())
                .unwrap();
        assert_eq!(process::start_ticks(claim.pid), Some(claim.pid_start_ticks));
        let error = Attempt::claim(directory.path(), &[]).unwrap_err();
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
            nodes: Vec::new(),
        };
        fs::write(
            directory.path().join("started.json"),
            serde_json::to_string(&claim).unwrap(),
        )
        .unwrap();
        let error = Attempt::claim(directory.path(), &[])
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("process 1 on h since t, which is gone"),
            "{error}"
        );
    }

    #[test]
    fn a_spec_of_another_format_is_refused_with_both_versions() {
        let directory = directory_with_spec(SPEC.version + 1);
        let error = Attempt::claim(directory.path(), &[])
            .unwrap_err()
            .to_string();
        assert!(error.contains("version 2, expected version 1"), "{error}");
        assert!(!directory.path().join("started.json").exists());
    }
}
