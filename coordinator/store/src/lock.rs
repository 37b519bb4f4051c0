//! Exclusion of a second coordinator by an operating system's lock on `coordinator.lock`. The
//! file's text names the holder. The lock ends with the process, however that ends; the text may be
//! stale.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use cardiotwin_schemas::formats::LOCK;
use rustix::fs::OFlags;
use rustix::io::Errno;
use serde::{Deserialize, Serialize};

use crate::clock;

/// Name of the lock file in the run directory.
pub const LOCK_FILE: &str = "coordinator.lock";

/// Present or last holder of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LockHolder {
    /// Name of the host.
    pub host: String,
    /// Id of the process on this host.
    pub pid: u32,
    /// Time of acquisition, UTC, RFC 3339.
    pub since: String,
    /// Until when a lease holds and how to end it; empty for a lock.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub more: String,
}

impl std::fmt::Display for LockHolder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "process {} on {} since {}{}",
            self.pid, self.host, self.since, self.more
        )
    }
}

/// Reason why the lock was not acquired.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another coordinator holds the run.
    #[error(
        "{dir} is in use by {holder}; watch it with `cardiotwin status`, or stop that process first"
    )]
    Held {
        /// Path of the run directory.
        dir: PathBuf,
        /// Process that holds it.
        holder: LockHolder,
    },
    /// Somebody has put a link in the place of the lock file.
    #[error(
        "{file} is a symbolic link, and what it points to would be overwritten: remove the link, \
         and repeat the command"
    )]
    Link {
        /// Path of the lock file.
        file: PathBuf,
    },
    /// The file system refused the operation.
    #[error(
        "cannot lock {file}; check that the directory is writable and that its file system \
             supports locks"
    )]
    Io {
        /// Path of the lock file or lease.
        file: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
}

/// A held lock, which is released when dropped or when the process ends.
#[derive(Debug)]
pub struct RunLock {
    _file: File,
}

impl RunLock {
    /// Takes the lock of a run directory.
    ///
    /// # Errors
    /// [`LockError::Held`] with the holder, or [`LockError::Io`] if the file cannot be opened,
    /// locked or written.
    pub fn acquire(dir: &Path) -> Result<Self, LockError> {
        let path = dir.join(LOCK_FILE);
        let io = |source| LockError::Io {
            file: path.clone(),
            source,
        };
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            // The holder's name is written into the file: never into one that a link names.
            .custom_flags(OFlags::NOFOLLOW.bits().cast_signed())
            .open(&path)
            .map_err(|source| match source.raw_os_error() {
                Some(code) if code == Errno::LOOP.raw_os_error() => {
                    LockError::Link { file: path.clone() }
                }
                _ => io(source),
            })?;
        for attempt in 0.. {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock)
                    if attempt < 20 || (attempt < 1000 && only_readers_hold(&file)) =>
                {
                    std::thread::sleep(Duration::from_millis(10));
                }
                Err(TryLockError::WouldBlock) => {
                    let holder = read_holder(&mut file).unwrap_or_else(unnamed);
                    return Err(LockError::Held {
                        dir: dir.to_owned(),
                        holder,
                    });
                }
                Err(TryLockError::Error(source)) => return Err(io(source)),
            }
        }
        let holder = LockHolder {
            host: host_name(),
            pid: std::process::id(),
            since: clock::now_utc(),
            more: String::new(),
        };
        let text = serde_json::to_string(&holder).expect("three plain fields are JSON");
        file.set_len(0).map_err(io)?;
        file.rewind().map_err(io)?;
        file.write_all(text.as_bytes()).map_err(io)?;
        Ok(Self { _file: file })
    }
}

/// Whether only readers hold the lock. A reader takes it shared for an instant to see whether a
/// coordinator runs, and on a busy machine that may last long. A coordinator's lock also excludes
/// shared ones.
fn only_readers_hold(file: &File) -> bool {
    file.try_lock_shared().is_ok() && file.unlock().is_ok()
}

/// Whether a coordinator holds the run now.
#[must_use]
pub fn is_held(dir: &Path) -> bool {
    // A shared lock through a read-only handle needs no permission to write.
    File::open(dir.join(LOCK_FILE))
        .is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

fn read_holder(file: &mut File) -> Option<LockHolder> {
    let mut text = String::new();
    file.rewind().ok()?;
    file.read_to_string(&mut text).ok()?;
    LOCK.read(&LOCK_FILE, text.as_bytes()).ok()
}

fn unnamed() -> LockHolder {
    LockHolder {
        host: "an unknown host".into(),
        pid: 0,
        since: "an unknown time".into(),
        more: String::new(),
    }
}

/// Name of this host.
#[must_use]
pub fn host_name() -> String {
    rustix::system::uname()
        .nodename()
        .to_string_lossy()
        .into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_coordinator_is_told_who_holds_the_run_and_gets_in_afterwards() {
        let dir = tempfile::tempdir().unwrap();
        let first = RunLock::acquire(dir.path()).unwrap();
        assert!(is_held(dir.path()));
        let error = RunLock::acquire(dir.path()).unwrap_err();
        assert!(
            error
                .to_string()
                .contains(&format!("process {}", std::process::id())),
            "{error}"
        );
        drop(first);
        assert!(!is_held(dir.path()));
        RunLock::acquire(dir.path()).unwrap();
    }

    #[test]
    fn what_a_link_points_to_is_never_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("letters");
        std::fs::write(&target, "dear mother").unwrap();
        let link = dir.path().join(LOCK_FILE);
        for points_to in [target.clone(), dir.path().join("nothing")] {
            std::os::unix::fs::symlink(&points_to, &link).unwrap();
            let error = RunLock::acquire(dir.path()).unwrap_err();
            assert!(matches!(error, LockError::Link { .. }), "{error:?}");
            assert!(error.to_string().contains("remove the link"), "{error}");
            std::fs::remove_file(&link).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&target).unwrap(), "dear mother");
        assert!(!dir.path().join("nothing").exists());
        RunLock::acquire(dir.path()).unwrap();
    }

    #[test]
    fn a_slow_reader_is_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        drop(RunLock::acquire(dir.path()).unwrap());
        let reader = File::open(dir.path().join(LOCK_FILE)).unwrap();
        reader.lock_shared().unwrap();
        let slow = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(400));
            drop(reader);
        });
        RunLock::acquire(dir.path()).unwrap();
        slow.join().unwrap();
    }
}
