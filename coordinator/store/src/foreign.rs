//! The process that has locked a file, as Linux reports it.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// Locks that processes on this host hold.
const LOCKS: &str = "/proc/locks";

/// A lock of a file.
#[derive(Debug, PartialEq, Eq)]
struct Lock {
    pid: u32,
    inode: u64,
    writes: bool,
}

/// Locks in the text of `/proc/locks`. Locks that wait for another one, and those without a process,
/// are left out.
fn locks(text: &str) -> Vec<Lock> {
    let read = |line: &str| {
        // 1: POSIX  ADVISORY  WRITE 4711 fd:00:1234567 1073741826 1073742335
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[_, _, _, kind, pid, place, ..] = words.as_slice() else {
            return None;
        };
        Some(Lock {
            pid: pid.parse().ok()?,
            inode: place.rsplit(':').next()?.parse().ok()?,
            writes: kind == "WRITE",
        })
    };
    text.lines().filter_map(read).collect()
}

/// Description of the process that keeps others from writing this database.
pub(super) fn holder(database: &Path) -> String {
    let beside = |end: &str| {
        let mut name = database.as_os_str().to_owned();
        name.push(end);
        PathBuf::from(name)
    };
    // With a write-ahead log the index has the locks.
    let files = [database.to_owned(), beside("-shm")];
    let inodes: Vec<u64> = files
        .iter()
        .filter_map(|file| Some(file.metadata().ok()?.ino()))
        .collect();
    let text = fs::read_to_string(LOCKS).unwrap_or_default();
    let others: Vec<Lock> = locks(&text)
        .into_iter()
        .filter(|lock| inodes.contains(&lock.inode) && lock.pid != std::process::id())
        .filter(|lock| may_have_open(lock.pid, &files))
        .collect();
    // A reader keeps others from writing only where there is no write-ahead log.
    let writer = others.iter().find(|lock| lock.writes);
    match writer.or(others.first()) {
        Some(lock) => described(lock.pid),
        None => "another program".to_owned(),
    }
}

/// Whether the process has one of these files open, as far as this user may know: numbers of files
/// are unique on one file system only.
fn may_have_open(pid: u32, files: &[PathBuf]) -> bool {
    let Ok(open) = fs::read_dir(format!("/proc/{pid}/fd")) else {
        return true;
    };
    let found: Vec<PathBuf> = files.iter().filter_map(|f| f.canonicalize().ok()).collect();
    open.flatten()
        .filter_map(|entry| fs::read_link(entry.path()).ok())
        .any(|path| found.contains(&path))
}

fn described(pid: u32) -> String {
    match fs::read_to_string(format!("/proc/{pid}/comm")) {
        Ok(name) => format!("process {pid} ({})", name.trim()),
        Err(_) => format!("process {pid}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locks_of_processes_are_read_and_others_left_out() {
        let text = "1: POSIX  ADVISORY  WRITE 4711 fd:00:1234567 120 120\n\
                    2: FLOCK  ADVISORY  WRITE 12 00:2a:9 0 EOF\n\
                    2: -> FLOCK  ADVISORY  WRITE 13 00:2a:9 0 EOF\n\
                    3: OFDLCK ADVISORY  READ -1 00:05:7 0 EOF\n\
                    4: POSIX  ADVISORY  READ 5 fd:00:1234567 123 123\n";
        let found: Vec<(u32, u64, bool)> = locks(text)
            .iter()
            .map(|lock| (lock.pid, lock.inode, lock.writes))
            .collect();
        assert_eq!(
            found,
            [
                (4711, 1_234_567, true),
                (12, 9, true),
                (5, 1_234_567, false)
            ]
        );
    }

    #[test]
    fn a_file_that_nobody_locked_has_no_known_holder() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.db");
        fs::write(&file, "").unwrap();
        assert_eq!(holder(&file), "another program");
    }
}
