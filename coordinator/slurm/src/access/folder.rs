//! A job's folder, `slurm/<name>/` of the run: the order and the script that the coordinator
//! writes, the claim and the final report of each driver, and the fences.
//!
//! | file | written by |
//! |---|---|
//! | `order-E.json`, `job.sh` | coordinator, before it submits the job |
//! | `submitting` | coordinator, right before `sbatch`: from now on Slurm may know the name |
//! | `started-E-N.json` | driver on node N of element E, created exclusively |
//! | `taken-E-P` | the driver that took patient P of element E's list, created exclusively |
//! | `asked-to-end-E-N` | driver, as soon as it gets a signal to stop, other than the warning before its walltime |
//! | `ended-E-N.json` | driver, as its final report |
//! | `fence-E` | coordinator: element E neither begins nor publishes anything more |

use std::fs;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use cardiotwin_protocol::{files, names};
use cardiotwin_schemas::allocation::{AttemptAllocation, DriverClaim, DriverEnd, JobOrder};
use cardiotwin_schemas::formats::{self, Format, JOB_ORDER};
use cardiotwin_schemas::task::AttemptSpec;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::FolderError;

const SCRIPT: &str = "job.sh";
const SUBMITTING: &str = "submitting";

fn file(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> FolderError {
    let path = path.to_owned();
    move |source| FolderError { what, path, source }
}

/// The folder of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobFolder {
    path: PathBuf,
}

impl JobFolder {
    /// The folder of the job with this name.
    #[must_use]
    pub fn of(run_dir: &Path, name: &str) -> Self {
        Self {
            path: run_dir.join("slurm").join(name),
        }
    }

    /// The folder at this path, which a driver gets as its argument.
    #[must_use]
    pub fn at(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
        }
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the batch script.
    #[must_use]
    pub fn script(&self) -> PathBuf {
        self.path.join(SCRIPT)
    }

    /// Writes orders and script. A second call writes the same content.
    ///
    /// # Errors
    /// [`FolderError`] if a file cannot be written.
    pub fn write(&self, orders: &[JobOrder], script: &str) -> Result<(), FolderError> {
        fs::create_dir_all(&self.path).map_err(file("create", &self.path))?;
        for (element, order) in orders.iter().enumerate() {
            write_whole(
                &self.path.join(format!("order-{element}.json")),
                &json(order),
            )?;
        }
        write_whole(&self.script(), script.as_bytes())
    }

    /// Whether an `sbatch` for the job may have been started before.
    #[must_use]
    pub fn was_submitting(&self) -> bool {
        self.path.join(SUBMITTING).exists()
    }

    /// Marks that `sbatch` is about to be called.
    ///
    /// # Errors
    /// [`FolderError`] if the mark cannot be written.
    pub fn mark_submitting(&self) -> Result<(), FolderError> {
        let path = self.path.join(SUBMITTING);
        // The mark must be durable before sbatch. If a power failure lost it, the job could be
        // submitted twice.
        files::write_synced(&path, b"").map_err(file("write", &path))?;
        // The names of the mark and of the folder, which may be just as new, must be durable, too.
        for folder in self.path.ancestors().take(2) {
            files::sync_directory(folder).map_err(file("write", folder))?;
        }
        Ok(())
    }

    /// Removes the mark after a definite refusal by Slurm.
    ///
    /// # Errors
    /// [`FolderError`] if the mark cannot be removed.
    pub fn unmark_submitting(&self) -> Result<(), FolderError> {
        let path = self.path.join(SUBMITTING);
        fs::remove_file(&path).map_err(file("remove", &path))
    }

    /// The order of an element.
    ///
    /// # Errors
    /// [`FolderError`] if the file cannot be read or is not an order.
    pub fn order(&self, element: u32) -> Result<JobOrder, FolderError> {
        let path = self.path.join(format!("order-{element}.json"));
        let bytes = fs::read(&path).map_err(file("read", &path))?;
        JOB_ORDER
            .read_order(&path.display(), &bytes)
            .map_err(|error| file("read", &path)(io::Error::other(error.in_full())))
    }

    /// Claims a node of an element for a driver; false if another driver holds the claim.
    ///
    /// # Errors
    /// [`FolderError`] if the claim cannot be written.
    pub fn claim(&self, element: u32, node: u32, claim: &DriverClaim) -> Result<bool, FolderError> {
        create_exclusively(
            &self.path.join(format!("started-{element}-{node}.json")),
            &json(claim),
        )
    }

    /// Takes a patient of an element's list for one of its nodes; false if another node has taken
    /// it.
    ///
    /// # Errors
    /// [`FolderError`] if the file cannot be written.
    pub fn take(&self, element: u32, patient: usize) -> Result<bool, FolderError> {
        create_exclusively(&self.path.join(format!("taken-{element}-{patient}")), b"")
    }

    /// Whether an element was revoked.
    #[must_use]
    pub fn is_fenced(&self, element: u32) -> bool {
        self.path.join(format!("fence-{element}")).exists()
    }

    /// Revokes an element. Does nothing if the folder does not exist.
    ///
    /// # Errors
    /// [`FolderError`] if the fence cannot be written.
    pub fn fence(&self, element: usize) -> Result<(), FolderError> {
        let path = self.path.join(format!("fence-{element}"));
        match fs::write(&path, b"revoked by the coordinator\n") {
            Err(error) if error.kind() == io::ErrorKind::NotFound && !self.path.exists() => Ok(()),
            result => result.map_err(file("write", &path)),
        }
    }

    /// A driver's claim; `None` if it is absent or incomplete.
    #[must_use]
    pub fn started(&self, element: usize, node: u32) -> Option<DriverClaim> {
        let path = self.path.join(format!("started-{element}-{node}.json"));
        read(&formats::DRIVER_CLAIM, &path)
    }

    /// Notes that a driver got a signal to stop, because it may be killed before its final report.
    /// If the note cannot be written, the driver stops nevertheless.
    pub fn note_asked_to_end(&self, element: u32, node: u32) {
        let _ = fs::write(
            self.path.join(format!("asked-to-end-{element}-{node}")),
            b"",
        );
    }

    /// Whether a driver got a signal to stop.
    #[must_use]
    pub fn was_asked_to_end(&self, element: usize, node: u32) -> bool {
        self.path
            .join(format!("asked-to-end-{element}-{node}"))
            .exists()
    }

    /// A driver's final report; `None` if it is absent or incomplete.
    #[must_use]
    pub fn ended(&self, element: usize, node: u32) -> Option<DriverEnd> {
        let path = self.path.join(format!("ended-{element}-{node}.json"));
        read(&formats::DRIVER_END, &path)
    }

    /// Writes a driver's final report.
    ///
    /// # Errors
    /// [`FolderError`] if it cannot be written.
    pub fn leave(&self, element: u32, node: u32, end: &DriverEnd) -> Result<(), FolderError> {
        write_whole(
            &self.path.join(format!("ended-{element}-{node}.json")),
            &json(end),
        )
    }

    /// End of the logs of an element's script and drivers, or of a job without elements.
    #[must_use]
    pub fn log_tail(&self, element: Option<usize>) -> String {
        let suffix = element.map_or_else(|| ".log".to_owned(), |element| format!("_{element}.log"));
        let entries = fs::read_dir(&self.path)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path());
        let is_log = |path: &PathBuf| {
            path.file_name()
                .and_then(|name| name.to_str())
                .is_some_and(|n| n.starts_with("slurm-") && n.ends_with(&suffix))
        };
        entries.filter(is_log).map(|path| tail(&path)).collect()
    }
}

/// Makes an attempt's directory with its spec and its allocation in one step. If two jobs try, one
/// succeeds and the other gets false.
///
/// # Errors
/// [`FolderError`] if the directory cannot be made.
pub fn make_attempt(
    directory: &Path,
    spec: &AttemptSpec,
    allocation: &AttemptAllocation,
) -> Result<bool, FolderError> {
    let parent = directory.parent().unwrap_or(directory);
    fs::create_dir_all(parent).map_err(file("create", parent))?;
    if directory.exists() {
        return Ok(false);
    }
    let name = directory.file_name().unwrap_or_default().to_string_lossy();
    let draft = parent.join(format!(".{name}.{}.{}", allocation.job, allocation.element));
    let _ = fs::remove_dir_all(&draft); // left by a driver that was killed here
    fs::create_dir(&draft).map_err(file("create", &draft))?;
    write_whole(&draft.join(names::SPEC), &json(spec))?;
    write_whole(&draft.join(names::ALLOCATION), &json(allocation))?;
    match fs::rename(&draft, directory) {
        Ok(()) => Ok(true),
        // A rename never replaces a directory that is not empty.
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::DirectoryNotEmpty | io::ErrorKind::AlreadyExists
            ) =>
        {
            let _ = fs::remove_dir_all(&draft);
            Ok(false)
        }
        Err(error) => Err(file("create", directory)(error)),
    }
}

/// The job that made an attempt's directory; `None` for an attempt outside a job.
#[must_use]
pub fn allocation_of(directory: &Path) -> Option<AttemptAllocation> {
    read(&formats::ALLOCATION, &directory.join(names::ALLOCATION))
}

/// Whether an attempt was begun. Its directory appears together with its spec.
#[must_use]
pub fn is_begun(directory: &Path) -> bool {
    directory.join(names::SPEC).exists()
}

/// Whether an attempt left a checkpoint from which a later one can continue.
#[must_use]
pub fn has_checkpoint(directory: &Path) -> bool {
    fs::read_dir(directory.join(names::CHECKPOINT))
        .is_ok_and(|mut entries| entries.next().is_some())
}

fn json<T: Serialize>(value: &T) -> Vec<u8> {
    serde_json::to_vec(value).expect("plain structs are JSON")
}

/// Content of a complete file. Files appear by rename, or exclusively and small, so that an
/// incomplete one counts as absent.
fn read<T: DeserializeOwned>(format: &Format, path: &Path) -> Option<T> {
    format.read(&path.display(), &fs::read(path).ok()?).ok()
}

fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), FolderError> {
    files::replace(path, bytes).map_err(file("write", path))
}

fn create_exclusively(path: &Path, bytes: &[u8]) -> Result<bool, FolderError> {
    files::create_exclusive(path, bytes).map_err(file("write", path))
}

fn tail(path: &Path) -> String {
    let mut bytes = Vec::new();
    if let Ok(mut file) = fs::File::open(path) {
        let length = file.metadata().map_or(0, |m| m.len());
        let _ = file.seek(SeekFrom::Start(length.saturating_sub(4000)));
        let _ = file.read_to_end(&mut bytes);
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::ids::AttemptId;
    use cardiotwin_schemas::task::{NoopSpec, TaskSpec};

    use super::*;

    #[test]
    fn of_two_that_begin_an_attempt_one_succeeds() {
        let dir = tempfile::tempdir().unwrap();
        let task = TaskSpec::Noop(NoopSpec {
            label: "a".into(),
            sleep_ms: 0,
        });
        let attempt = AttemptId {
            task: task.key(),
            generation: 1,
        };
        let spec = AttemptSpec {
            schema_version: formats::SPEC.version,
            attempt,
            threads: 1,
            instruction_set: Default::default(),
            vtu_every_ms: 0.0,
            task,
        };
        let directory = dir.path().join("attempts/ab/abcd-g1");
        let of = |job: &str| AttemptAllocation {
            job: job.into(),
            element: 0,
            id: None,
        };
        assert!(make_attempt(&directory, &spec, &of("one")).unwrap());
        assert!(!make_attempt(&directory, &spec, &of("two")).unwrap());
        assert_eq!(allocation_of(&directory), Some(of("one")));
        assert_eq!(
            fs::read_dir(directory.parent().unwrap()).unwrap().count(),
            1,
            "no draft is left"
        );
    }

    #[test]
    fn claims_are_given_once_and_fences_hold() {
        let dir = tempfile::tempdir().unwrap();
        let folder = JobFolder::of(dir.path(), "ct-1");
        folder.fence(0).unwrap();
        assert!(
            !folder.is_fenced(0),
            "what was never written has nobody to revoke"
        );
        folder.write(&[], "#!/bin/bash\n").unwrap();
        assert!(!folder.was_submitting());
        folder.mark_submitting().unwrap();
        assert!(folder.was_submitting());
        assert!(
            folder.take(0, 3).unwrap() && !folder.take(0, 3).unwrap() && folder.take(1, 3).unwrap()
        );
        folder.fence(1).unwrap();
        assert!(folder.is_fenced(1) && !folder.is_fenced(0));
        fs::write(folder.path().join("slurm-12_1.log"), "one").unwrap();
        fs::write(folder.path().join("slurm-13.log"), "two").unwrap();
        assert_eq!(
            (
                folder.log_tail(Some(1)).as_str(),
                folder.log_tail(None).contains("two")
            ),
            ("one", true)
        );
    }
}
