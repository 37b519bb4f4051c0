//! Checks of the run's file system: free room, and the operations that durability rests on.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_engine as engine;

use super::finding::{Finding, Level};

/// Room that a small cohort takes, bytes. With less, a run may end half-way.
const LITTLE_BYTES: u64 = 1_000_000_000;
/// Number of files that a thousand attempts make.
const FEW_INODES: u64 = 20_000;
/// Seconds per synced write above which every commit is noticeably slow.
const SLOW_SYNC_S: f64 = 0.05;

/// Checks the folder in which the run lies or would lie.
pub async fn look(run: &Path) -> Vec<Finding> {
    let folder = existing(run);
    let mut found = vec![kind(&folder), room(&folder)];
    match tempfile::Builder::new()
        .prefix(".cardiotwin-doctor-")
        .tempdir_in(&folder)
    {
        Err(error) => {
            let words = format!("{}: {error}", folder.display());
            found.push(Finding::bad(
                "writing",
                Level::Error,
                words,
                "choose another folder with --run-dir, or correct its permissions",
            ));
        }
        Ok(trial) => {
            found.push(operations(trial.path()));
            found.push(locks(trial.path()).await);
        }
    }
    found
}

/// The folder itself, or its nearest ancestor that exists.
fn existing(folder: &Path) -> PathBuf {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    folder
        .ancestors()
        .find(|folder| folder.is_dir())
        .unwrap_or(Path::new("/"))
        .to_owned()
}

fn kind(folder: &Path) -> Finding {
    let at = folder.display();
    match engine::shared_file_system(folder) {
        None => Finding::ok("file system", format!("{at}: local, write-ahead log")),
        Some(name) => Finding::ok(
            "file system",
            format!("{at}: {name}, shared: rollback journal, and readers read a snapshot"),
        ),
    }
}

fn room(folder: &Path) -> Finding {
    match rustix::fs::statvfs(folder) {
        Err(error) => Finding::bad(
            "room",
            Level::Note,
            format!("the file system does not report its free space: {error}"),
            "",
        ),
        Ok(told) => {
            let (bytes, inodes) = (told.f_bavail * told.f_frsize, told.f_favail);
            // Some file systems make inodes as they need them and report none.
            let counts_inodes = told.f_files > 0;
            let mut found = format!("{:.1} GB free", 1e-9 * bytes as f64);
            if counts_inodes {
                found.push_str(&format!(", {inodes} inodes free"));
            }
            if bytes < LITTLE_BYTES || (counts_inodes && inodes < FEW_INODES) {
                let remedy = "`cardiotwin du` shows the usage, and `cardiotwin clean` removes files \
                              that can be recomputed";
                return Finding::bad("room", Level::Warning, found, remedy);
            }
            Finding::ok("room", found)
        }
    }
}

/// Tries the operations on which claims and results rest: a link that fails if the name is taken, a
/// rename that replaces, an exclusive creation, a sync.
fn operations(folder: &Path) -> Finding {
    let trial = || -> io::Result<f64> {
        let (draft, name) = (folder.join("draft"), folder.join("name"));
        fs::write(&draft, "1")?;
        fs::hard_link(&draft, &name)?;
        if fs::hard_link(&draft, &name).is_ok() {
            return Err(io::Error::other("a second link replaced an existing name"));
        }
        fs::write(&draft, "2")?;
        fs::rename(&draft, &name)?;
        if fs::read(&name)? != b"2" {
            return Err(io::Error::other(
                "a rename did not replace the existing file",
            ));
        }
        let exclusive = || {
            OpenOptions::new()
                .write(true)
                .create_new(true)
                .open(folder.join("once"))
        };
        exclusive()?;
        if exclusive().is_ok() {
            return Err(io::Error::other(
                "a file could be created exclusively twice",
            ));
        }
        let began = Instant::now();
        for k in 0..5 {
            let mut file = File::create(folder.join(format!("synced-{k}")))?;
            file.write_all(b"3")?;
            file.sync_all()?;
        }
        Ok(began.elapsed().as_secs_f64() / 5.0)
    };
    let check = "claims and renames";
    match trial() {
        Err(error) => Finding::bad(
            check,
            Level::Error,
            error.to_string(),
            "choose another file system for the run (--run-dir): results would not be safe on this \
             one",
        ),
        Ok(each) if each > SLOW_SYNC_S => {
            let found = format!("work; a synced write takes {:.0} ms", 1e3 * each);
            Finding::bad(
                check,
                Level::Warning,
                found,
                "every commit waits for the disk: use a local disk for the run",
            )
        }
        Ok(each) => Finding::ok(
            check,
            format!("work; a synced write takes {:.1} ms", 1e3 * each),
        ),
    }
}

async fn locks(folder: &Path) -> Finding {
    match engine::try_locks(folder).await {
        Ok(()) => Finding::ok("SQLite's locks", "a second writer is excluded"),
        Err(error) => Finding::bad(
            "SQLite's locks",
            Level::Error,
            error.to_string(),
            "put the run on a file system with locks (--run-dir), such as a local disk",
        ),
    }
}
