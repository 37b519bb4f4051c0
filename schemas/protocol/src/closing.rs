//! Closing of an attempt: either its worker publishes an outcome or its coordinator revokes it.
//!
//! Both create `outcome.json` exclusively, and the side that fails reads the winner's file. A
//! worker that comes second publishes nothing; a coordinator that comes second processes the
//! outcome.

use std::fs;
use std::io;
use std::path::Path;

use cardiotwin_schemas::formats;
use cardiotwin_schemas::outcome::{Revocation, RevokedAttempt, TaskOutcome};

use serde::Deserialize;

use crate::files::SyncedDraft;
use crate::{names, seal};

/// State of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum Closing {
    /// The attempt was neither published nor revoked.
    Open,
    /// The worker published this text.
    Published(String),
    /// The coordinator revoked the attempt; `None` where an earlier version left no reason, or a later one says it otherwise.
    Revoked(Option<Revocation>),
}

/// Side that closed an attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Winner {
    /// The worker, by an outcome.
    Worker,
    /// The coordinator, by a revocation.
    Coordinator,
}

/// The key that distinguishes a revocation from an outcome.
#[derive(Deserialize)]
struct MaybeRevoked {
    revoked: Option<serde_json::Value>,
}

/// Reads the state of an attempt.
///
/// # Errors
/// Any error of the file system except a missing file.
pub fn read(directory: &Path) -> io::Result<Closing> {
    match fs::read_to_string(directory.join(names::OUTCOME)) {
        // A revocation of any version revokes, whether or not its words can be read.
        Ok(text) => Ok(match serde_json::from_str(&text) {
            Ok(MaybeRevoked {
                revoked: Some(revocation),
            }) => {
                let path = directory.join(names::OUTCOME);
                let words =
                    formats::REVOCATION.read(&path.display(), &revocation.to_string().into_bytes());
                Closing::Revoked(words.ok())
            }
            _ => Closing::Published(text),
        }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Ok(if directory.join(names::FORMER_FENCE).exists() {
                Closing::Revoked(None)
            } else {
                Closing::Open
            })
        }
        Err(error) => Err(error),
    }
}

/// Whether an attempt was revoked; `false` if its directory cannot be read.
#[must_use]
pub fn is_revoked(directory: &Path) -> bool {
    matches!(read(directory), Ok(Closing::Revoked(_)))
}

/// An outcome on disk that has not been published yet.
#[derive(Debug)]
pub struct PreparedOutcome<'a> {
    directory: &'a Path,
    draft: SyncedDraft,
}

impl<'a> PreparedOutcome<'a> {
    /// Writes and syncs an outcome next to its final place.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn new(directory: &'a Path, outcome: &TaskOutcome) -> io::Result<Self> {
        let text = seal::sealed(outcome)?;
        let draft = SyncedDraft::beside(&directory.join(names::OUTCOME), &text)?;
        Ok(Self { directory, draft })
    }

    /// Publishes the outcome unless the attempt is closed, and returns the side that closed it.
    /// Artefacts must be on disk before the call.
    ///
    /// # Errors
    /// Any error of the file system; [`io::ErrorKind::AlreadyExists`] if the attempt has another
    /// outcome, which the claim on each attempt excludes.
    pub fn publish(self) -> io::Result<Winner> {
        if is_revoked(self.directory) {
            return Ok(Winner::Coordinator);
        }
        let path = self.directory.join(names::OUTCOME);
        if self.draft.place_exclusively(&path)? {
            return Ok(Winner::Worker);
        }
        match read(self.directory)? {
            Closing::Revoked(_) => Ok(Winner::Coordinator),
            Closing::Open | Closing::Published(_) => Err(io::Error::new(
                io::ErrorKind::AlreadyExists,
                "another outcome is there already",
            )),
        }
    }
}

/// Revokes an attempt unless its worker has published, and returns the side that closed it. A
/// directory that does not exist has no worker, so that its attempt counts as revoked.
///
/// # Errors
/// Any error of the file system.
pub fn revoke(directory: &Path, revocation: &Revocation) -> io::Result<Winner> {
    let path = directory.join(names::OUTCOME);
    let text = serde_json::to_vec_pretty(&RevokedAttempt {
        revoked: revocation.clone(),
    })?;
    let placed = match read(directory)? {
        Closing::Published(_) => return Ok(Winner::Worker),
        Closing::Revoked(Some(_)) => return Ok(Winner::Coordinator),
        Closing::Open | Closing::Revoked(None) => {
            SyncedDraft::beside(&path, &text).and_then(|draft| draft.place_exclusively(&path))
        }
    };
    match placed {
        Ok(true) => Ok(Winner::Coordinator),
        Ok(false) => Ok(match read(directory)? {
            Closing::Published(_) => Winner::Worker,
            Closing::Open | Closing::Revoked(_) => Winner::Coordinator,
        }),
        Err(error) if error.kind() == io::ErrorKind::NotFound && !directory.exists() => {
            Ok(Winner::Coordinator)
        }
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::ids::{AttemptId, TaskKey};
    use cardiotwin_schemas::outcome::Ending;
    use cardiotwin_schemas::provenance::Provenance;

    fn attempt() -> AttemptId {
        AttemptId {
            task: TaskKey("0".repeat(64)),
            generation: 2,
        }
    }

    fn outcome() -> TaskOutcome {
        TaskOutcome {
            schema_version: formats::OUTCOME.version,
            attempt: attempt(),
            ending: Ending::Cancelled,
            artefacts: vec![],
            provenance: Provenance::default(),
            sha256: None,
        }
    }

    fn revocation(reason: &str) -> Revocation {
        Revocation {
            schema_version: formats::REVOCATION.version,
            attempt: attempt(),
            reason: reason.into(),
            at: "t".into(),
        }
    }

    fn names_in(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn a_revocation_just_before_the_publication_wins() {
        let dir = tempfile::tempdir().unwrap();
        // The worker has completed everything except its last step.
        let prepared = PreparedOutcome::new(dir.path(), &outcome()).unwrap();
        let winner = revoke(dir.path(), &revocation("its job ended")).unwrap();
        assert_eq!(winner, Winner::Coordinator);
        assert_eq!(prepared.publish().unwrap(), Winner::Coordinator);
        let expected = Closing::Revoked(Some(revocation("its job ended")));
        assert_eq!(read(dir.path()).unwrap(), expected);
        assert_eq!(names_in(dir.path()), [names::OUTCOME]);
    }

    #[test]
    fn a_revocation_after_the_publication_finds_the_outcome() {
        let dir = tempfile::tempdir().unwrap();
        let prepared = PreparedOutcome::new(dir.path(), &outcome()).unwrap();
        assert_eq!(prepared.publish().unwrap(), Winner::Worker);
        let winner = revoke(dir.path(), &revocation("too late")).unwrap();
        assert_eq!(winner, Winner::Worker);
        let Closing::Published(text) = read(dir.path()).unwrap() else {
            panic!("{:?}", read(dir.path()))
        };
        let found: TaskOutcome = serde_json::from_str(&text).unwrap();
        let sealed = TaskOutcome {
            sha256: found.sha256.clone(),
            ..outcome()
        };
        assert_eq!(found, sealed);
        assert_eq!(names_in(dir.path()), [names::OUTCOME]);
    }

    /// With both at once, repeated many times, one side wins and both sides learn the same result.
    #[test]
    fn outcome_and_revocation_agree_on_the_winner() {
        for _ in 0..200 {
            let dir = tempfile::tempdir().unwrap();
            let prepared = PreparedOutcome::new(dir.path(), &outcome()).unwrap();
            let start = std::sync::Barrier::new(2);
            let (worker, coordinator) = std::thread::scope(|threads| {
                let worker = threads.spawn(|| {
                    start.wait();
                    prepared.publish().unwrap()
                });
                start.wait();
                let coordinator = revoke(dir.path(), &revocation("now")).unwrap();
                (worker.join().unwrap(), coordinator)
            });
            assert_eq!(worker, coordinator);
            let is_published = matches!(read(dir.path()).unwrap(), Closing::Published(_));
            assert_eq!(is_published, worker == Winner::Worker);
        }
    }

    #[test]
    fn the_first_revocation_stays_and_a_missing_directory_has_nobody_to_revoke() {
        let dir = tempfile::tempdir().unwrap();
        revoke(dir.path(), &revocation("first")).unwrap();
        revoke(dir.path(), &revocation("second")).unwrap();
        let first = Closing::Revoked(Some(revocation("first")));
        assert_eq!(read(dir.path()).unwrap(), first);
        let missing = dir.path().join("never-begun");
        assert_eq!(
            revoke(&missing, &revocation("r")).unwrap(),
            Winner::Coordinator
        );
        assert!(!missing.exists());
    }

    #[test]
    fn a_revocation_of_a_later_version_revokes() {
        let dir = tempfile::tempdir().unwrap();
        let later = r#"{"revoked":{"schema_version":9,"because":["a reason"]}}"#;
        fs::write(dir.path().join(names::OUTCOME), later).unwrap();
        assert_eq!(read(dir.path()).unwrap(), Closing::Revoked(None));
        let prepared = PreparedOutcome::new(dir.path(), &outcome()).unwrap();
        assert_eq!(prepared.publish().unwrap(), Winner::Coordinator);
    }

    #[test]
    fn a_fence_of_an_earlier_version_is_heeded() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(names::FORMER_FENCE), "").unwrap();
        assert!(is_revoked(dir.path()));
        let prepared = PreparedOutcome::new(dir.path(), &outcome()).unwrap();
        assert_eq!(prepared.publish().unwrap(), Winner::Coordinator);
        // An outcome published by an earlier worker before the fence existed counts as it did then.
        fs::write(
            dir.path().join(names::OUTCOME),
            serde_json::to_string(&outcome()).unwrap(),
        )
        .unwrap();
        assert_eq!(
            revoke(dir.path(), &revocation("r")).unwrap(),
            Winner::Worker
        );
    }
}
