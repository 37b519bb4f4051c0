//! Contents of an attempt's directory: outcome, claim, revocation, and the end of the worker's log.

use std::fs;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use cardiotwin_protocol::claim::{self, ClaimFile};
use cardiotwin_protocol::closing::{self, Closing, Winner};
use cardiotwin_protocol::{names, seal};
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::hash::sha256_of_file;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::{Revocation, TaskOutcome};
use cardiotwin_slurm::judgement;
use cardiotwin_store::clock;

use super::{AttemptFindings, DispatchError};

/// Larger artefacts are hashed where a later task reads them: hashing them here would hold up a
/// coordinator that has hundreds of results to adopt.
const LARGEST_HASHED_BYTES: u64 = 64 << 20;

fn file(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DispatchError {
    let path = path.to_owned();
    move |source| DispatchError::File { what, path, source }
}

/// The outcome, if one was published. An outcome that cannot be read, or whose files are missing,
/// counts as evidence, too. A revoked attempt has no outcome.
///
/// # Errors
/// [`DispatchError::File`] if the directory cannot be read.
pub fn outcome(directory: &Path) -> Result<Option<AttemptFindings>, DispatchError> {
    let path = directory.join(names::OUTCOME);
    match closing::read(directory).map_err(file("read", &path))? {
        Closing::Published(text) => Ok(Some(evidence_of(directory, text))),
        Closing::Open | Closing::Revoked(_) => Ok(None),
    }
}

fn evidence_of(directory: &Path, text: String) -> AttemptFindings {
    let path = directory.join(names::OUTCOME);
    let read = formats::OUTCOME.read(&path.display(), text.as_bytes());
    let outcome: TaskOutcome = match read {
        Ok(outcome) => outcome,
        // Outcomes appear complete or not at all, so that half an outcome is a defect of the
        // program.
        Err(error) => {
            return AttemptFindings::Nothing {
                class: FailureClass::Bug,
                reason: error.in_full(),
            };
        }
    };
    if let Some(reason) = damage(directory, &outcome, &text) {
        return AttemptFindings::Nothing {
            class: FailureClass::Site,
            reason,
        };
    }
    AttemptFindings::Outcome {
        outcome: Box::new(outcome),
        text,
    }
}

/// Why an outcome is refused: it or one of its files is not as its worker left it; `None` if all are.
fn damage(directory: &Path, outcome: &TaskOutcome, text: &str) -> Option<String> {
    if let Some(found) = seal::broken(outcome, text) {
        return Some(format!(
            "{} was changed after its worker wrote it: found SHA-256 {found}, expected {}; it is \
             refused and the task is repeated (files of attempts must not be edited; change settings \
             or input instead)",
            directory.join(names::OUTCOME).display(),
            outcome.sha256.as_deref().unwrap_or_default()
        ));
    }
    outcome.artefacts.iter().find_map(|artefact| {
        let file = directory.join(&artefact.file);
        let found = fs::metadata(&file).map(|m| m.len()).ok();
        if found != Some(artefact.bytes) {
            let found = found.map_or("does not exist".to_owned(), |n| format!("has {n} bytes"));
            return Some(format!(
                "{} {found}, but its outcome says {} bytes",
                file.display(),
                artefact.bytes
            ));
        }
        if artefact.bytes > LARGEST_HASHED_BYTES {
            return None;
        }
        let found = sha256_of_file(&file).unwrap_or_else(|error| error.to_string());
        (found != artefact.sha256).then(|| {
            format!(
                "{} was changed after its worker wrote it: found SHA-256 {found}, expected {}; its \
                 outcome is refused and the task is repeated",
                file.display(),
                artefact.sha256
            )
        })
    })
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
) -> Result<Option<AttemptFindings>, DispatchError> {
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

/// Bytes at the end of a worker's log that are searched for a reason. After a killed step each rank
/// and the launcher have their say.
const LAST_BYTES: u64 = 16 << 10;

const FOREIGN_LAUNCHER: &str = "the launcher does not suit the MPI of cardiotwin-worker-mpi: set \
     executor.launcher to [\"srun\", \"--mpi=pmix\"] for Open MPI or [\"srun\", \"--mpi=pmi2\"] for MPICH";

/// A line of the worker's log for error messages, at most 300 characters: the last one that tells why
/// a process was killed, otherwise the last one. For a launcher of another MPI: what to do.
pub fn last_words(directory: &Path) -> Option<String> {
    let mut file = fs::File::open(directory.join(names::LOG)).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(LAST_BYTES)))
        .ok()?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    if judgement::names_foreign_launcher(&text) {
        return Some(FOREIGN_LAUNCHER.to_owned());
    }
    let mut lines = text.lines().rev().map(str::trim);
    let short = |line: &str| -> String { line.chars().take(300).collect() };
    if let Some(line) = lines
        .clone()
        .find(|line| judgement::cause_in_log(line).is_some())
    {
        return Some(format!("its log says: {}", short(line)));
    }
    let last = lines.find(|line| !line.is_empty())?;
    Some(format!("last line of its log: {}", short(last)))
}

#[cfg(test)]
mod tests {
    use cardiotwin_protocol::closing::PreparedOutcome;
    use cardiotwin_schemas::hash::sha256_hex;
    use cardiotwin_schemas::ids::TaskKey;
    use cardiotwin_schemas::outcome::{Artefact, Ending};
    use cardiotwin_schemas::provenance::Provenance;

    use super::*;

    #[test]
    fn last_words_tell_a_launcher_of_another_mpi() {
        let folder = tempfile::tempdir().unwrap();
        let log = "but OMPI was not built with SLURM's PMI support and therefore cannot\nexecute.\n\
                   srun: launch/slurm: _step_signal: Terminating StepId=5.0\n";
        fs::write(folder.path().join(names::LOG), log).unwrap();
        assert_eq!(last_words(folder.path()).unwrap(), FOREIGN_LAUNCHER);
    }

    #[test]
    fn last_words_tell_why_a_process_was_killed() {
        let folder = tempfile::tempdir().unwrap();
        let said = |log: &str| {
            fs::write(folder.path().join(names::LOG), log).unwrap();
            last_words(folder.path())
        };
        assert_eq!(said("one\ntwo\n\n").unwrap(), "last line of its log: two");
        let killed = "slurmstepd-n1: error: Step 3.0 exceeded memory limit (7 > 6), being killed\n\
                      srun: error: n1: tasks 0-1: Killed\nsrun: launch/slurm: _step_signal: Terminating StepId=3.0\n";
        assert!(
            said(killed)
                .unwrap()
                .starts_with("its log says: slurmstepd-n1: error: Step 3.0 exceeded"),
        );
        assert_eq!(said("\n"), None);
    }

    /// The reason why the outcome is refused; `None` for an outcome that is adopted.
    fn refused(directory: &Path) -> Option<String> {
        match outcome(directory).unwrap().expect("it was published") {
            AttemptFindings::Outcome { .. } => None,
            AttemptFindings::Nothing { class, reason } => {
                assert_eq!(class, FailureClass::Site, "{reason}");
                Some(reason)
            }
        }
    }

    #[test]
    fn an_edited_outcome_and_an_edited_artefact_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (traces, file) = (
            folder.path().join("traces.csv"),
            folder.path().join(names::OUTCOME),
        );
        fs::write(&traces, "abc").unwrap();
        let published = TaskOutcome {
            schema_version: formats::OUTCOME.version,
            attempt: AttemptId {
                task: TaskKey("0".repeat(64)),
                generation: 1,
            },
            ending: Ending::Cancelled,
            artefacts: vec![Artefact {
                name: "traces".into(),
                file: "traces.csv".into(),
                sha256: sha256_hex(b"abc"),
                bytes: 3,
            }],
            provenance: Provenance::default(),
            sha256: None,
        };
        let prepared = PreparedOutcome::new(folder.path(), &published).unwrap();
        assert_eq!(prepared.publish().unwrap(), Winner::Worker);
        assert_eq!(refused(folder.path()), None);

        fs::write(&traces, "abd").unwrap();
        let said = refused(folder.path()).expect("it was edited");
        assert!(
            said.contains("traces.csv was changed") && said.contains("repeated"),
            "{said}"
        );
        fs::write(&traces, "abc").unwrap();

        let sound = fs::read_to_string(&file).unwrap();
        fs::write(&file, sound.replacen("cancelled", "succeeded", 1)).unwrap();
        assert!(
            outcome(folder.path())
                .unwrap()
                .is_some_and(|evidence| matches!(evidence, AttemptFindings::Nothing { .. }))
        );
        fs::write(&file, sound.replace("\"bytes\": 3", "\"bytes\":  3")).unwrap();
        let said = refused(folder.path()).expect("it was edited");
        assert!(
            said.contains("outcome.json was changed") && said.contains("must not be edited"),
            "{said}"
        );
        fs::write(&file, &sound).unwrap();
        assert_eq!(refused(folder.path()), None);
    }
}
