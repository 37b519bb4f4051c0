//! An attempt's directory: claimed by one process, fenced by the coordinator, closed by one outcome.
//!
//! ```text
//! spec.json ──► started.json (exclusive) ──► work ──► artefacts, synced ──► fence? ──► outcome.json (atomic)
//!                   │ exists: exit 3                                           └ exit 4
//! ```

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::SCHEMA_VERSION;
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::progress::Claim;
use cardiotwin_schemas::task::AttemptSpec;

use crate::{clock, files, process};

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
    /// The specification is not one of ours.
    #[error("{file}: not a specification of an attempt in format {SCHEMA_VERSION}")]
    Spec {
        /// Which file.
        file: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// A file of another version.
    #[error(
        "{file}: written in format {found}, but this worker reads format {SCHEMA_VERSION}; use the worker of the same version as the coordinator"
    )]
    Version {
        /// Which file.
        file: PathBuf,
        /// Its version.
        found: u32,
    },
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
    #[error("{directory} is fenced: the attempt was revoked, and nothing is published")]
    Fenced {
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
    /// [`AttemptError::Claimed`] when any process claimed it before, living or dead; [`AttemptError::Fenced`] when
    /// it was revoked already; otherwise when files cannot be read or written.
    pub fn claim(directory: &Path) -> Result<Self, AttemptError> {
        let attempt = Self {
            directory: directory.to_owned(),
            spec: read_spec(&directory.join("spec.json"))?,
        };
        attempt.check_fence()?;
        let file = directory.join("started.json");
        let claim = Claim {
            host: process::host(),
            boot_id: process::boot_id(),
            pid: std::process::id(),
            pid_start_ticks: process::start_ticks(std::process::id()).unwrap_or_default(),
            at: clock::now(),
        };
        match files::create_exclusive(&file, json(&claim).as_bytes()) {
            Ok(()) => Ok(attempt),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                Err(AttemptError::Claimed {
                    directory: directory.to_owned(),
                    holder: holder(&file),
                })
            }
            Err(source) => Err(AttemptError::Write { file, source }),
        }
    }

    /// Where the attempt lives.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Whether the coordinator revoked the attempt.
    #[must_use]
    pub fn is_fenced(&self) -> bool {
        self.directory.join("fence").exists()
    }

    fn check_fence(&self) -> Result<(), AttemptError> {
        if self.is_fenced() {
            return Err(AttemptError::Fenced {
                directory: self.directory.clone(),
            });
        }
        Ok(())
    }

    /// Publishes the outcome and ends the attempt. Artefacts must be on disk before.
    ///
    /// # Errors
    /// [`AttemptError::Fenced`] when the attempt was revoked meanwhile; otherwise when the file cannot be written.
    pub fn publish(self, outcome: &TaskOutcome) -> Result<(), AttemptError> {
        self.check_fence()?;
        let file = self.directory.join("outcome.json");
        files::write_atomic(&file, json(outcome).as_bytes())
            .map_err(|source| AttemptError::Write { file, source })
    }
}

/// Reads an attempt's specification.
fn read_spec(file: &Path) -> Result<AttemptSpec, AttemptError> {
    let text = fs::read_to_string(file).map_err(|source| AttemptError::Read {
        file: file.to_owned(),
        source,
    })?;
    let spec: AttemptSpec = serde_json::from_str(&text).map_err(|source| AttemptError::Spec {
        file: file.to_owned(),
        source,
    })?;
    if spec.schema_version != SCHEMA_VERSION {
        return Err(AttemptError::Version {
            file: file.to_owned(),
            found: spec.schema_version,
        });
    }
    Ok(spec)
}

/// Who holds a claim, in words.
fn holder(file: &Path) -> String {
    let claim: Option<Claim> = fs::read(file)
        .ok()
        .and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let Some(claim) = claim else {
        return "somebody whose claim cannot be read".to_owned();
    };
    let state = if claim.boot_id != process::boot_id() {
        "on another host or before a reboot"
    } else if process::start_ticks(claim.pid) == Some(claim.pid_start_ticks) {
        "which is running"
    } else {
        "which is gone"
    };
    format!(
        "process {} on {} since {}, {state}",
        claim.pid, claim.host, claim.at
    )
}

fn json<T: serde::Serialize>(value: &T) -> String {
    // Outcomes and claims are structs of plain fields: they always have a JSON form.
    serde_json::to_string_pretty(value).expect("a struct of plain fields is JSON")
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::AttemptId;
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
        fs::write(directory.path().join("spec.json"), json(&spec)).unwrap();
        directory
    }

    #[test]
    fn a_claim_names_a_living_process_and_is_given_once() {
        let directory = directory_with_spec(SCHEMA_VERSION);
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
        let directory = directory_with_spec(SCHEMA_VERSION);
        let claim = Claim {
            host: "h".into(),
            boot_id: process::boot_id(),
            pid: 1,
            pid_start_ticks: 1,
            at: "t".into(),
        };
        fs::write(directory.path().join("started.json"), json(&claim)).unwrap();
        let error = Attempt::claim(directory.path()).unwrap_err().to_string();
        assert!(
            error.contains("process 1 on h since t, which is gone"),
            "{error}"
        );
    }

    #[test]
    fn a_spec_of_another_format_is_refused_with_both_versions() {
        let directory = directory_with_spec(SCHEMA_VERSION + 1);
        let error = Attempt::claim(directory.path()).unwrap_err().to_string();
        assert!(
            error.contains("format 2") && error.contains("format 1"),
            "{error}"
        );
        assert!(!directory.path().join("started.json").exists());
    }
}
