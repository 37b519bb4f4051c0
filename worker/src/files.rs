//! Files that appear whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use cardiotwin_schemas::hash::hex;
use sha2::{Digest as _, Sha256};

/// Creates or replaces `path` with `content`; file and directory are on disk when this returns.
///
/// # Errors
/// Any error of the file system; `path` then holds what it held before.
pub fn write_atomic(path: &Path, content: &[u8]) -> io::Result<()> {
    let temporary = beside(path);
    write_synced(&temporary, content)
        .and_then(|()| fs::rename(&temporary, path))
        .inspect_err(|_| {
            let _ = fs::remove_file(&temporary);
        })?;
    sync_directory(parent(path))
}

/// Creates `path` with `content` if it does not exist; whoever reads it sees all of it. Nothing is synced: a claim
/// guards against processes that live now, and after a power failure none of them does.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] when it exists, or any error of the file system.
pub fn create_exclusive(path: &Path, content: &[u8]) -> io::Result<()> {
    let temporary = beside(path);
    // A link to a complete file, instead of an exclusive create followed by a write: a process killed in between would
    // leave an empty file that nobody can judge.
    let linked = fs::write(&temporary, content).and_then(|()| fs::hard_link(&temporary, path));
    let _ = fs::remove_file(&temporary);
    linked
}

/// Writes a new file and syncs it, its directory not.
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

/// A file that is written piece by piece and hashed on the way.
#[derive(Debug)]
pub struct Hashed {
    file: io::BufWriter<File>,
    hash: Sha256,
    bytes: u64,
}

impl Hashed {
    /// A new file, or one that is written anew.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn create(path: &Path) -> io::Result<Self> {
        Ok(Self {
            file: io::BufWriter::new(File::create(path)?),
            hash: Sha256::new(),
            bytes: 0,
        })
    }

    /// Brings it to disk; returns its SHA-256 in hexadecimal and its length.
    ///
    /// # Errors
    /// Any error of the file system.
    pub fn finish(self) -> io::Result<(String, u64)> {
        self.file
            .into_inner()
            .map_err(io::IntoInnerError::into_error)?
            .sync_all()?;
        Ok((hex(&self.hash.finalize()), self.bytes))
    }
}

impl Write for Hashed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.file.write(bytes)?;
        self.hash.update(&bytes[..n]);
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

fn sync_directory(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

fn parent(path: &Path) -> &Path {
    path.parent()
        .filter(|parent| !parent.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// A name beside `path` that no other process uses.
fn beside(path: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", std::process::id()));
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exclusive_creation_succeeds_once_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("started.json");
        create_exclusive(&path, b"first").unwrap();
        let error = create_exclusive(&path, b"second").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_file_written_in_pieces_has_the_hash_of_the_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("long.csv");
        let mut file = Hashed::create(&path).unwrap();
        (0..5000).for_each(|k| write!(file, "{k},").unwrap());
        let (hash, bytes) = file.finish().unwrap();
        let content = fs::read(&path).unwrap();
        assert_eq!(
            (hash, bytes),
            (
                cardiotwin_schemas::hash::sha256_hex(&content),
                content.len() as u64
            )
        );
        assert!(content.ends_with(b"4998,4999,"));
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
}
