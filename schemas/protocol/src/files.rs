//! Files that appear either complete or not at all.
//!
//! Every function writes a draft under a random name next to the target and moves it into place in
//! one step of the file system. The random name keeps two hosts whose processes have the same
//! number from sharing a draft.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::Path;

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;
use tempfile::{Builder, NamedTempFile};

/// Creates or replaces `path` with `content`; file and directory are on disk when the function
/// returns.
///
/// # Errors
/// Any error of the file system; `path` then keeps its previous content.
pub fn write_atomic(path: &Path, content: &[u8]) -> io::Result<()> {
    let draft = draft(path, content)?;
    draft.as_file().sync_all()?;
    draft.persist(path).map_err(|error| error.error)?;
    sync_directory(parent(path))
}

/// As [`write_atomic`] with the content that `fill` writes.
///
/// # Errors
/// Any error of the file system or of `fill`; `path` then holds its former content.
pub fn write_with(
    path: &Path,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
) -> io::Result<()> {
    let draft = draft_with(path, fill)?;
    draft.as_file().sync_all()?;
    draft.persist(path).map_err(|error| error.error)?;
    sync_directory(parent(path))
}

/// Creates or replaces `path` with `content` without waiting for the disk. It is meant for content
/// that can be written again.
///
/// # Errors
/// As [`write_atomic`].
pub fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let draft = draft(path, content)?;
    draft.persist(path).map(drop).map_err(|error| error.error)
}

/// As [`replace`] with the content that `fill` writes.
///
/// # Errors
/// As [`write_with`].
pub fn replace_with(
    path: &Path,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
) -> io::Result<()> {
    let draft = draft_with(path, fill)?;
    draft.persist(path).map(drop).map_err(|error| error.error)
}

/// Writes a file and syncs it, but not its directory.
///
/// # Errors
/// Any error of the file system.
pub fn write_synced(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .open(path)?;
    file.write_all(content)?;
    file.sync_all()
}

/// Creates `path` with `content` unless the name exists, and returns whether it was created.
///
/// A reader sees either the complete content or no file. Nothing is synced: a claim guards only
/// against processes that are alive now, and no claim survives a power failure.
///
/// # Errors
/// Any error of the file system.
pub fn create_exclusive(path: &Path, content: &[u8]) -> io::Result<bool> {
    place(&draft(path, content)?, path)
}

/// A file on disk under a draft's name, to be moved to its final name.
#[derive(Debug)]
pub struct SyncedDraft {
    file: NamedTempFile,
}

impl SyncedDraft {
    /// Writes and syncs `content` next to `path`.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn beside(path: &Path, content: &[u8]) -> io::Result<Self> {
        let file = draft(path, content)?;
        file.as_file().sync_all()?;
        Ok(Self { file })
    }

    /// Renames the draft to `path` unless that name exists, syncs the directory, and returns
    /// whether the draft got the name.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn place_exclusively(self, path: &Path) -> io::Result<bool> {
        let placed = place(&self.file, path)?;
        drop(self.file); // Removed before the sync, so that one sync covers both names.
        sync_directory(parent(path))?;
        Ok(placed)
    }
}

/// Gives a draft the name `path`, in one step and only if the name does not exist.
///
/// `link(2)` does this on every file system with hard links, including NFS and Lustre. An exclusive
/// creation followed by a write would not suffice: a process killed in between would leave an empty
/// file under the contended name, and neither side could know which one had won. If hard links are
/// missing (FAT, some network mounts), `renameat2(RENAME_NOREPLACE)` is equally exclusive. A file
/// system with neither is rejected.
fn place(draft: &NamedTempFile, path: &Path) -> io::Result<bool> {
    match fs::hard_link(draft.path(), path) {
        Ok(()) => Ok(true),
        // An NFS client repeats a request whose answer was lost. It then reports that the name
        // exists although its own first request created it (open(2), under O_EXCL).
        Err(_) if is_same_file(draft.path(), path) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        Err(error) if lacks_hard_links(&error) => {
            match renameat_with(CWD, draft.path(), CWD, path, RenameFlags::NOREPLACE) {
                Ok(()) => Ok(true),
                Err(Errno::EXIST) => Ok(false),
                Err(rename) => Err(io::Error::new(
                    error.kind(),
                    format!(
                        "this file system has neither hard links ({error}) nor an exclusive rename ({rename}); choose \
                         another one for the run"
                    ),
                )),
            }
        }
        Err(error) => Err(error),
    }
}

fn lacks_hard_links(error: &io::Error) -> bool {
    error
        .raw_os_error()
        .map(Errno::from_raw_os_error)
        .is_some_and(|errno| {
            matches!(
                errno,
                Errno::PERM | Errno::NOSYS | Errno::OPNOTSUPP | Errno::MLINK
            )
        })
}

fn is_same_file(a: &Path, b: &Path) -> bool {
    let identity = |path: &Path| fs::metadata(path).map(|m| (m.dev(), m.ino())).ok();
    identity(a).is_some_and(|a| identity(b) == Some(a))
}

fn draft(path: &Path, content: &[u8]) -> io::Result<NamedTempFile> {
    let mut draft = empty_draft(path)?;
    draft.write_all(content)?;
    Ok(draft)
}

fn draft_with(
    path: &Path,
    fill: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
) -> io::Result<NamedTempFile> {
    let mut draft = empty_draft(path)?;
    let mut buffered = BufWriter::new(draft.as_file_mut());
    fill(&mut buffered)?;
    buffered.flush()?;
    drop(buffered);
    Ok(draft)
}

fn empty_draft(path: &Path) -> io::Result<NamedTempFile> {
    let mut prefix = OsString::from(".");
    prefix.push(path.file_name().unwrap_or_default());
    prefix.push(".");
    Builder::new()
        .prefix(&prefix)
        .suffix(".tmp")
        // The umask narrows the mode as for any other file, so that a group sharing the run can
        // read it.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(parent(path))
}

/// Syncs the names in a directory to disk.
///
/// # Errors
/// Any error of the file system.
pub fn sync_directory(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

fn parent(path: &Path) -> &Path {
    path.parent()
        .filter(|parent| !parent.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exclusive_creation_succeeds_once_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("started.json");
        assert!(create_exclusive(&path, b"first").unwrap());
        assert!(!create_exclusive(&path, b"second").unwrap());
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_link_that_exists_although_its_creation_was_reported_to_fail_is_ours() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("outcome.json");
        let draft = draft(&path, b"ours").unwrap();
        // An NFS server that answered twice leaves this state.
        fs::hard_link(draft.path(), &path).unwrap();
        assert!(place(&draft, &path).unwrap());
    }

    #[test]
    fn atomic_writing_replaces_the_whole_and_a_failed_one_leaves_the_old() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("outcome.json");
        write_atomic(&path, b"a long old content").unwrap();
        write_atomic(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        fs::create_dir(dir.path().join("taken")).unwrap();
        assert!(write_atomic(&dir.path().join("taken"), b"x").is_err());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_writer_that_fails_leaves_the_old_file_and_no_draft() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csv");
        let half = |out: &mut (dyn Write + Send)| {
            out.write_all(b"half")?;
            Err(io::Error::other("no space"))
        };
        write_with(&path, |out| out.write_all(b"old")).unwrap();
        assert!(write_with(&path, half).is_err());
        assert!(replace_with(&path, half).is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn others_may_read_what_the_umask_lets_them() {
        let dir = tempfile::tempdir().unwrap();
        let (plain, placed) = (dir.path().join("plain"), dir.path().join("placed"));
        fs::write(&plain, b"").unwrap();
        assert!(create_exclusive(&placed, b"").unwrap());
        let mode = |path: &Path| fs::metadata(path).unwrap().mode();
        assert_eq!(mode(&placed), mode(&plain));
    }
}
