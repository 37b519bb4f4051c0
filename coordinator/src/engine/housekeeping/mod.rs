//! What a run's files take, what of them can go, and a copy of the rest elsewhere.

pub mod classes;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use cardiotwin_protocol::names;
use cardiotwin_schemas::formats::OUTCOME;
use cardiotwin_schemas::hash::hex;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::TaskOutcome;
use serde::Serialize;
use sha2::{Digest as _, Sha256};

use cardiotwin_workflow::task::Task;
pub use classes::Class;
use classes::Standing;

use super::world::{ATTEMPTS, World, attempt_directory};
use super::{EngineError, enter_with_lease};
use crate::clock;
use crate::store::{DATABASE_FILE, Writer, back_up};

/// Files and bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Usage {
    /// How many.
    pub files: u64,
    /// Their sizes.
    pub bytes: u64,
}

impl Usage {
    fn add(&mut self, bytes: u64) {
        self.files += 1;
        self.bytes += bytes;
    }
}

/// What a run takes.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct DiskUsage {
    /// By what files are for.
    pub classes: BTreeMap<Class, Usage>,
    /// What `clean` would remove, and with `--series`.
    pub removable: Usage,
    /// The same.
    pub removable_with_series: Usage,
}

/// What was removed, or would be.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// By what files were for.
    pub classes: BTreeMap<Class, Usage>,
    /// Relative to the run's folder.
    pub files: Vec<PathBuf>,
}

/// What was copied.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Archived {
    /// Files and bytes, the database's copy included.
    pub copied: Usage,
    /// Scratch that stayed behind.
    pub left: Usage,
}

/// File that names every file of an archive with its SHA-256, as `sha256sum --check` reads it.
pub const MANIFEST: &str = "SHA256SUMS";

/// A file of a run.
struct Entry {
    /// Relative to the run's folder.
    file: PathBuf,
    bytes: u64,
    class: Class,
    /// Of its attempt, where it is of one.
    standing: Standing,
}

/// How tasks and attempts stand, by the names of their directories.
struct Books {
    /// First 16 digits of each task's key, and whether it has a result.
    settled: HashMap<String, bool>,
    /// Directories of attempts that are not over.
    in_use: HashSet<PathBuf>,
    /// Files of results, by the directories of the attempts that published: their own records may have been purged.
    results: HashMap<PathBuf, HashSet<String>>,
}

impl Books {
    async fn read(run_dir: &Path) -> Result<Self, EngineError> {
        let world = World::new(run_dir, Writer::look(run_dir).await?, clock::now_ms())?;
        let settled = world.tasks.iter().map(|(key, task)| {
            (
                key.as_str()[..16].to_owned(),
                matches!(task.state, Task::Published { .. }),
            )
        });
        let results = world.tasks.iter().filter_map(|(key, task)| {
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
        let in_use = world
            .attempts
            .values()
            .filter(|attempt| !attempt.state.is_final());
        Ok(Self {
            results: results.collect(),
            settled: settled.collect(),
            in_use: in_use
                .map(|attempt| PathBuf::from(&attempt.directory))
                .collect(),
        })
    }

    /// - `attempt`: relative to the run's folder
    fn standing(&self, attempt: &Path) -> Standing {
        let name = attempt.file_name().unwrap_or_default().to_string_lossy();
        match self
            .settled
            .get(name.split("-g").next().unwrap_or_default())
        {
            None => Standing::Foreign,
            Some(_) if self.in_use.contains(attempt) => Standing::InUse,
            Some(true) => Standing::Settled,
            Some(false) => Standing::Unsettled,
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

/// All files below `folder`, relative to `root`; links are not followed, but that to the attempts.
fn walk(root: &Path, folder: &Path, found: &mut Vec<(PathBuf, u64)>) -> Result<(), EngineError> {
    for entry in fs::read_dir(folder).map_err(file_error("read", folder))? {
        let entry = entry.map_err(file_error("read", folder))?;
        let path = entry.path();
        // A worker at work may remove one of its files meanwhile.
        let Ok(mut metadata) = entry.metadata() else {
            continue;
        };
        // `executor.scratch`: the attempts lie elsewhere, and are the run's all the same.
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

fn entries(run_dir: &Path, books: &Books) -> Result<Vec<Entry>, EngineError> {
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
                named.extend(books.results.get(&attempt).into_iter().flatten().cloned());
                named
            });
            (
                classes::of_attempt(&inside, named),
                books.standing(&attempt),
            )
        } else {
            (classes::of_run(&file), Standing::Foreign)
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

/// Files that an outcome names; none where the attempt has no outcome.
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

/// What a run takes, by what it is for.
///
/// # Errors
/// The store's; folders that cannot be read.
pub async fn disk_usage(run_dir: &Path) -> Result<DiskUsage, EngineError> {
    let books = Books::read(run_dir).await?;
    let mut usage = DiskUsage::default();
    for entry in entries(run_dir, &books)? {
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

/// Removes what nobody needs; nothing is removed with `is_dry`. Refused while a coordinator is at work on the run.
///
/// # Errors
/// [`EngineError::Lock`]; the store's; files that cannot be removed.
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
    let books = Books::read(run_dir).await?;
    let mut cleaned = Cleaned::default();
    for entry in entries(run_dir, &books)? {
        if !classes::is_removable(entry.class, entry.standing, with_series) {
            continue;
        }
        if !is_dry {
            let path = run_dir.join(&entry.file);
            fs::remove_file(&path).map_err(file_error("remove", &path))?;
            // Folders that are empty now go, too; others refuse.
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

/// Copies a run without its scratch to a folder that must not be there, checks every copy, and writes `SHA256SUMS`. The copy
/// is a run like any other. It appears whole: made beside and renamed.
///
/// # Errors
/// [`EngineError::Request`] where the folder is there; the store's; files that cannot be read or written.
pub async fn archive(
    run_dir: &Path,
    target: &Path,
    with_series: bool,
) -> Result<Archived, EngineError> {
    if target.exists() {
        let message = format!("{} is there already: name another folder", target.display());
        return Err(EngineError::Request { message });
    }
    let _held = enter_with_lease(run_dir)?;
    let books = Books::read(run_dir).await?;
    let draft = target.with_file_name(format!(
        "{}.part",
        target.file_name().unwrap_or_default().to_string_lossy()
    ));
    if draft.exists() {
        fs::remove_dir_all(&draft).map_err(file_error("remove", &draft))?;
    }
    fs::create_dir_all(&draft).map_err(file_error("make", &draft))?;
    let mut done = Archived::default();
    let mut manifest = String::new();
    let database = draft.join(DATABASE_FILE);
    done.copied.add(back_up(run_dir, &database).await?);
    manifest.push_str(&format!(
        "{}  {DATABASE_FILE}\n",
        hash_of(&database).map_err(file_error("read", &database))?
    ));
    for entry in entries(run_dir, &books)? {
        let is_lock =
            entry.file == Path::new("coordinator.lock") || entry.file.starts_with("lease");
        if entry.class == Class::Database || is_lock {
            continue;
        }
        // What a next try would need is copied; what could be cleaned stays behind.
        if classes::is_removable(entry.class, entry.standing, !with_series) {
            done.left.add(entry.bytes);
            continue;
        }
        let (from, to) = (run_dir.join(&entry.file), draft.join(&entry.file));
        let folder = to.parent().unwrap_or(&draft);
        fs::create_dir_all(folder).map_err(file_error("make", folder))?;
        fs::copy(&from, &to).map_err(file_error("copy", &from))?;
        fs::File::open(&to)
            .and_then(|copy| copy.sync_all())
            .map_err(file_error("write", &to))?;
        let hash = hash_of(&from).map_err(file_error("read", &from))?;
        let copied = hash_of(&to).map_err(file_error("read", &to))?;
        if hash != copied {
            let message = format!(
                "{} changed while it was copied: is somebody at work on the run?",
                from.display()
            );
            return Err(EngineError::Request { message });
        }
        manifest.push_str(&format!("{hash}  {}\n", entry.file.display()));
        done.copied.add(entry.bytes);
    }
    let file = draft.join(MANIFEST);
    fs::write(&file, manifest).map_err(file_error("write", &file))?;
    fs::rename(&draft, target).map_err(file_error("make", target))?;
    Ok(done)
}

fn hash_of(file: &Path) -> io::Result<String> {
    let (mut file, mut hash, mut piece) = (fs::File::open(file)?, Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut piece)? {
            0 => return Ok(hex(&hash.finalize())),
            n => hash.update(&piece[..n]),
        }
    }
}
