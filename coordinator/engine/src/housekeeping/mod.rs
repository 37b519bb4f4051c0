//! Disk usage of a run, removal of files that nothing needs, and a copy of the rest elsewhere.

pub mod classes;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_protocol::names;
use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::hash::sha256_of_file;
use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_store::clock;
use cardiotwin_store::{DATABASE_FILE, Writer, back_up};
use serde::Serialize;

use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;
pub use classes::Class;
use classes::Retention;

use super::books::{ATTEMPTS, Books, attempt_directory};
use super::{EngineError, enter_with_lease};

/// Number and size of files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Usage {
    /// Number of files, without folders.
    pub files: u64,
    /// Sum of their sizes, in bytes.
    pub bytes: u64,
}

impl Usage {
    fn add(&mut self, bytes: u64) {
        self.files += 1;
        self.bytes += bytes;
    }
}

/// Disk usage of a run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct DiskUsage {
    /// Usage by class of file.
    pub classes: BTreeMap<Class, Usage>,
    /// Files that `clean` would remove.
    pub removable: Usage,
    /// Files that `clean --series` would remove.
    pub removable_with_series: Usage,
}

/// Files that were removed, or would be in a dry run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// Usage by class of file.
    pub classes: BTreeMap<Class, Usage>,
    /// Paths relative to the run's folder.
    pub files: Vec<PathBuf>,
}

/// Files that were copied to an archive.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Archived {
    /// Files of the copy, the database included.
    pub copied: Usage,
    /// Scratch files that were not copied.
    pub left: Usage,
}

/// File that names every file of an archive with its SHA-256, in the format of `sha256sum --check`.
pub const MANIFEST: &str = "SHA256SUMS";

/// A file of a run.
struct Entry {
    /// Path relative to the run's folder.
    file: PathBuf,
    bytes: u64,
    class: Class,
    /// Standing of the file's attempt; [`Retention::Foreign`] for a file outside of attempts.
    standing: Retention,
}

/// Digits of a task's key in the names of its attempts' directories.
fn digits(task: &TaskKey) -> &str {
    &task.as_str()[..16]
}

/// Standing of tasks and attempts, by the names of their directories.
struct Retentions {
    /// Whether the task has a result, by the first 16 digits of its key.
    settled: HashMap<String, bool>,
    /// Tasks of patients that are not done, by the first digits of their keys.
    needed: HashSet<String>,
    /// Directories of attempts that are not over.
    in_use: HashSet<PathBuf>,
    /// Result files by the directories of the published attempts. These come from the database
    /// because the attempts' own records may have been purged.
    results: HashMap<PathBuf, HashSet<String>>,
}

impl Retentions {
    async fn read(run_dir: &Path) -> Result<Self, EngineError> {
        let books = Books::new(run_dir, Writer::look(run_dir).await?, clock::now_ms())?;
        let settled = books.tasks().iter().map(|(key, task)| {
            (
                digits(key).to_owned(),
                matches!(task.state, Task::Published { .. }),
            )
        });
        let unfinished = books
            .patients()
            .iter()
            .filter(|patient| patient.row.state != Patient::Done);
        let needed = unfinished.flat_map(|patient| patient.steps.values().map(digits));
        let results = books.tasks().iter().filter_map(|(key, task)| {
            let Task::Published { generation } = task.state else {
                return None;
            };
            let attempt = AttemptId {
                task: key.clone(),
                generation,
            };
            let files = task
                .outcome()?
                .artefacts
                .iter()
                .map(|artefact| artefact.file.clone());
            Some((PathBuf::from(attempt_directory(&attempt)), files.collect()))
        });
        let in_use = books
            .attempts()
            .values()
            .filter(|attempt| !attempt.state.is_final());
        Ok(Self {
            results: results.collect(),
            needed: needed.map(str::to_owned).collect(),
            settled: settled.collect(),
            in_use: in_use
                .map(|attempt| PathBuf::from(&attempt.directory))
                .collect(),
        })
    }

    /// - `attempt`: path relative to the run's folder
    fn standing(&self, attempt: &Path) -> Retention {
        let name = attempt.file_name().unwrap_or_default().to_string_lossy();
        let task = name.split("-g").next().unwrap_or_default();
        match self.settled.get(task) {
            None => Retention::Foreign,
            Some(_) if self.in_use.contains(attempt) => Retention::InUse,
            Some(true) => Retention::Settled,
            Some(false) if self.needed.contains(task) => Retention::Unsettled,
            Some(false) => Retention::Aborted,
        }
    }
}

fn file_error<'a>(
    what: &'static str,
    path: &'a Path,
) -> impl FnOnce(io::Error) -> EngineError + 'a {
    move |source| EngineError::File {
        what,
        path: path.to_owned(),
        source,
    }
}

/// Collects all files below `folder`, relative to `root`. Links are not followed, except the one to
/// the attempts.
fn walk(root: &Path, folder: &Path, found: &mut Vec<(PathBuf, u64)>) -> Result<(), EngineError> {
    for entry in fs::read_dir(folder).map_err(file_error("read", folder))? {
        let entry = entry.map_err(file_error("read", folder))?;
        let path = entry.path();
        // A worker may remove one of its files at the same time.
        let Ok(mut metadata) = entry.metadata() else {
            continue;
        };
        // With `executor.scratch` the attempts lie elsewhere, but still belong to the run.
        if metadata.is_symlink() && path == root.join(ATTEMPTS) {
            let Ok(elsewhere) = fs::metadata(&path) else {
                continue;
            };
            metadata = elsewhere;
        }
        if metadata.is_dir() {
            walk(root, &path, found)?;
        } else {
            found.push((
                path.strip_prefix(root).unwrap_or(&path).to_owned(),
                metadata.len(),
            ));
        }
    }
    Ok(())
}

fn entries(run_dir: &Path, standings: &Retentions) -> Result<Vec<Entry>, EngineError> {
    let mut files = vec![];
    walk(run_dir, run_dir, &mut files)?;
    files.sort();
    let mut artefacts: HashMap<PathBuf, HashSet<String>> = HashMap::new();
    let mut entries = Vec::with_capacity(files.len());
    for (file, bytes) in files {
        // attempts/3f/3f9c…-g1/FILE
        let attempt: PathBuf = file.components().take(3).collect();
        let inside = file
            .strip_prefix(&attempt)
            .unwrap_or(Path::new(""))
            .to_owned();
        let is_of_attempt = file.starts_with(ATTEMPTS) && !inside.as_os_str().is_empty();
        let (class, standing) = if is_of_attempt {
            let named = artefacts.entry(attempt.clone()).or_insert_with(|| {
                let mut named = artefacts_of(&run_dir.join(&attempt));
                named.extend(
                    standings
                        .results
                        .get(&attempt)
                        .into_iter()
                        .flatten()
                        .cloned(),
                );
                named
            });
            (
                classes::of_attempt(&inside, named),
                standings.standing(&attempt),
            )
        } else {
            (classes::of_run(&file), Retention::Foreign)
        };
        entries.push(Entry {
            file,
            bytes,
            class,
            standing,
        });
    }
    Ok(entries)
}

/// Files that an attempt's outcome names; empty if the attempt has no outcome.
fn artefacts_of(attempt: &Path) -> HashSet<String> {
    let path = attempt.join(names::OUTCOME);
    let outcome = fs::read(&path).ok();
    let outcome =
        outcome.and_then(|bytes| OUTCOME.read::<TaskOutcome>(&path.display(), &bytes).ok());
    outcome
        .into_iter()
        .flat_map(|outcome| outcome.artefacts)
        .map(|artefact| artefact.file)
        .collect()
}

/// Measures the disk usage of a run by class of file.
///
/// # Errors
/// [`EngineError`] if the store or a folder cannot be read.
pub async fn disk_usage(run_dir: &Path) -> Result<DiskUsage, EngineError> {
    let standings = Retentions::read(run_dir).await?;
    let mut usage = DiskUsage::default();
    for entry in entries(run_dir, &standings)? {
        usage
            .classes
            .entry(entry.class)
            .or_default()
            .add(entry.bytes);
        if classes::is_removable(entry.class, entry.standing, false) {
            usage.removable.add(entry.bytes);
        }
        if classes::is_removable(entry.class, entry.standing, true) {
            usage.removable_with_series.add(entry.bytes);
        }
    }
    Ok(usage)
}

/// Removes files that nothing needs; with `is_dry` only lists them. Refused while a coordinator
/// works on the run.
///
/// # Errors
/// [`EngineError::Lock`] if another coordinator holds the run; further errors if the store cannot
/// be read or a file cannot be removed.
pub async fn clean(
    run_dir: &Path,
    with_series: bool,
    is_dry: bool,
) -> Result<Cleaned, EngineError> {
    let _held = if is_dry {
        None
    } else {
        Some(enter_with_lease(run_dir)?)
    };
    let standings = Retentions::read(run_dir).await?;
    let mut cleaned = Cleaned::default();
    for entry in entries(run_dir, &standings)? {
        if !classes::is_removable(entry.class, entry.standing, with_series) {
            continue;
        }
        if !is_dry {
            let path = run_dir.join(&entry.file);
            fs::remove_file(&path).map_err(file_error("remove", &path))?;
            // Remove folders that became empty, too. Removing a folder that is not empty fails
            // without effect.
            let inside = entry.file.components().count().saturating_sub(4);
            path.ancestors()
                .skip(1)
                .take(inside)
                .for_each(|folder| drop(fs::remove_dir(folder)));
        }
        cleaned
            .classes
            .entry(entry.class)
            .or_default()
            .add(entry.bytes);
        cleaned.files.push(entry.file);
    }
    Ok(cleaned)
}

/// Copies a run without its scratch to a new folder, checks every copy, and writes `SHA256SUMS`.
/// The copy is a run like any other. It appears whole, because it is made next to the target and
/// then renamed.
///
/// # Errors
/// [`EngineError::Request`] if the folder exists already; further errors if the store or a file
/// cannot be read or written.
pub async fn archive(
    run_dir: &Path,
    target: &Path,
    with_series: bool,
) -> Result<Archived, EngineError> {
    if target.exists() {
        let message = format!("{} already exists: name another folder", target.display());
        return Err(EngineError::Request { message });
    }
    let _held = enter_with_lease(run_dir)?;
    let standings = Retentions::read(run_dir).await?;
    let draft = target.with_file_name(format!(
        "{}.part",
        target.file_name().unwrap_or_default().to_string_lossy()
    ));
    if draft.exists() {
        fs::remove_dir_all(&draft).map_err(file_error("remove", &draft))?;
    }
    fs::create_dir_all(&draft).map_err(file_error("create", &draft))?;
    let mut done = Archived::default();
    let mut manifest = String::new();
    let database = draft.join(DATABASE_FILE);
    done.copied.add(back_up(run_dir, &database).await?);
    manifest.push_str(&format!(
        "{}  {DATABASE_FILE}\n",
        sha256_of_file(&database).map_err(file_error("read", &database))?
    ));
    for entry in entries(run_dir, &standings)? {
        let is_lock =
            entry.file == Path::new("coordinator.lock") || entry.file.starts_with("lease");
        if entry.class == Class::Database || is_lock {
            continue;
        }
        // Files that a next attempt would need are copied; files that `clean` could remove are not.
        if classes::is_removable(entry.class, entry.standing, !with_series) {
            done.left.add(entry.bytes);
            continue;
        }
        let (from, to) = (run_dir.join(&entry.file), draft.join(&entry.file));
        let folder = to.parent().unwrap_or(&draft);
        fs::create_dir_all(folder).map_err(file_error("create", folder))?;
        fs::copy(&from, &to).map_err(file_error("copy", &from))?;
        fs::File::open(&to)
            .and_then(|copy| copy.sync_all())
            .map_err(file_error("write", &to))?;
        let hash = sha256_of_file(&from).map_err(file_error("read", &from))?;
        let copied = sha256_of_file(&to).map_err(file_error("read", &to))?;
        if hash != copied {
            let message = format!(
                "{} changed while it was copied: check that nobody works on the run",
                from.display()
            );
            return Err(EngineError::Request { message });
        }
        manifest.push_str(&format!("{hash}  {}\n", entry.file.display()));
        done.copied.add(entry.bytes);
    }
    let file = draft.join(MANIFEST);
    fs::write(&file, manifest).map_err(file_error("write", &file))?;
    fs::rename(&draft, target).map_err(file_error("create", target))?;
    Ok(done)
}
