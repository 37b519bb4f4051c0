//! The lease of a coordinator's tick, for hosts that share a file system on which a lock of the
//! operating system may not reach the other hosts.
//!
//! Files `lease/<generation>.json` are created exclusively, and the highest generation counts. A
//! process that finds it released, expired or its holder dead creates the next one: of several
//! processes, one succeeds. Before each commit the holder checks for a higher generation, so that a
//! tick that slept through its lease commits nothing.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_protocol::files::{self, SyncedDraft};
use cardiotwin_schemas::formats::LEASE;
use cardiotwin_schemas::progress::Claim;
use serde::{Deserialize, Serialize};

use super::StoreError;
use super::lock::{LockError, LockHolder};
use crate::clock;

const FOLDER: &str = "lease";
/// Time for which a lease holds without renewal, ms. A tick takes seconds, and its commits renew
/// the lease.
pub const HOLDS_MS: i64 = 10 * 60 * 1000;

/// Content of a lease's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Text {
    holder: Claim,
    generation: u64,
    expires_ms: i64,
    released: bool,
}

/// Time by which a lease may seem to hold longer than any lease before its host's clock counts as being
/// ahead, ms. Clocks of a cluster agree to seconds.
const AHEAD_MS: i64 = 60 * 1000;

impl Text {
    /// The holder, with the time until which the lease holds. A lease cannot hold for longer than
    /// [`HOLDS_MS`]: if it seems to, the clock of its host is ahead of this one.
    fn into_holder(self, file: &Path, now_ms: i64) -> LockHolder {
        let ahead_ms = self.expires_ms - now_ms - HOLDS_MS;
        let until = clock::utc_text(self.expires_ms);
        let more = if ahead_ms > AHEAD_MS {
            format!(
                "; its lease holds until {until} by this host's clock, because the clock of {} is ahead by \
                 {} min or more: set it right. If no coordinator runs there any more, remove {}",
                self.holder.host,
                ahead_ms / 60_000,
                file.display()
            )
        } else {
            format!("; its lease holds until {until} unless it is renewed")
        };
        LockHolder {
            host: self.holder.host,
            pid: self.holder.pid,
            since: self.holder.at,
            more,
        }
    }
}

/// A held lease, which is released when dropped.
#[derive(Debug)]
pub struct Lease {
    folder: PathBuf,
    text: Text,
}

fn file(folder: &Path, generation: u64) -> PathBuf {
    folder.join(format!("{generation:010}.json"))
}

impl Lease {
    /// Takes the lease of a run directory for `holder`. `lives` returns whether the process of a
    /// claim is alive; `None` means that this host cannot know.
    ///
    /// # Errors
    /// [`LockError::Held`] with the holder, or [`LockError::Io`] if a file cannot be read or
    /// written.
    pub fn acquire(
        run_dir: &Path,
        holder: &Claim,
        lives: impl Fn(&Claim) -> Option<bool>,
        now_ms: i64,
    ) -> Result<Self, LockError> {
        let folder = run_dir.join(FOLDER);
        let io = |path: &Path| {
            let file = path.to_owned();
            move |source| LockError::Io { file, source }
        };
        fs::create_dir_all(&folder).map_err(io(&folder))?;
        loop {
            let highest = highest(&folder).map_err(io(&folder))?;
            if highest > 0 {
                // A half-written lease counts as held until the age of its file exceeds the time of
                // a lease.
                let found = read(&file(&folder, highest));
                let held = match &found {
                    Some(text) => {
                        !text.released
                            && now_ms < text.expires_ms
                            && lives(&text.holder) != Some(false)
                    }
                    None => is_young(&file(&folder, highest), now_ms),
                };
                if held {
                    let holder = found.map_or_else(
                        || LockHolder {
                            host: "an unknown host".into(),
                            pid: 0,
                            since: "a moment ago".into(),
                            more: String::new(),
                        },
                        |text| text.into_holder(&file(&folder, highest), now_ms),
                    );
                    return Err(LockError::Held {
                        dir: run_dir.to_owned(),
                        holder,
                    });
                }
            }
            let generation = highest + 1;
            let expires_ms = now_ms + HOLDS_MS;
            let path = file(&folder, generation);
            let text = Text {
                holder: holder.clone(),
                generation,
                expires_ms,
                released: false,
            };
            let json = serde_json::to_vec(&text).expect("plain fields are JSON");
            let draft = SyncedDraft::beside(&path, &json).map_err(io(&path))?;
            // One of several processes gets the name; the others look who it is.
            if draft.place_exclusively(&path).map_err(io(&path))? {
                let lease = Self {
                    text,
                    folder: folder.clone(),
                };
                lease.forget_older();
                return Ok(lease);
            }
        }
    }

    /// Checks before a commit that the lease still holds, and renews it when less than half of its
    /// time is left.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] if the lease expired or another process took it.
    pub fn check(&mut self, now_ms: i64) -> Result<(), StoreError> {
        let failed = |folder: &Path| {
            let file = folder.to_owned();
            move |source| StoreError::File {
                what: "read",
                file,
                source,
            }
        };
        let highest = highest(&self.folder).map_err(failed(&self.folder))?;
        if highest != self.text.generation || now_ms >= self.text.expires_ms {
            return Err(StoreError::LeaseLost {
                generation: self.text.generation,
                now: highest,
            });
        }
        if self.text.expires_ms - now_ms < HOLDS_MS / 2 {
            self.text.expires_ms = now_ms + HOLDS_MS;
            self.rewrite().map_err(failed(&self.folder))?;
        }
        Ok(())
    }

    fn rewrite(&self) -> io::Result<()> {
        let path = file(&self.folder, self.text.generation);
        let json = serde_json::to_vec(&self.text).expect("plain fields are JSON");
        files::replace(&path, &json)
    }

    fn forget_older(&self) {
        for entry in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            if generation_of(&entry.path())
                .is_some_and(|generation| generation < self.text.generation)
            {
                let _ = fs::remove_file(entry.path()); // an old generation has no effect
            }
        }
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        if highest(&self.folder).is_ok_and(|highest| highest == self.text.generation) {
            self.text.released = true;
            // If this fails, the lease expires, or its process is found dead.
            let _ = self.rewrite();
        }
    }
}

fn generation_of(path: &Path) -> Option<u64> {
    let name = path.file_name()?.to_str()?;
    name.strip_suffix(".json")?.parse().ok()
}

fn highest(folder: &Path) -> io::Result<u64> {
    let mut highest = 0;
    for entry in fs::read_dir(folder)? {
        highest = highest.max(generation_of(&entry?.path()).unwrap_or(0));
    }
    Ok(highest)
}

fn read(path: &Path) -> Option<Text> {
    LEASE.read(&path.display(), &fs::read(path).ok()?).ok()
}

/// Whether a file was modified less than a lease's time ago.
fn is_young(path: &Path, now_ms: i64) -> bool {
    let modified = path.metadata().and_then(|m| m.modified()).ok();
    let made = modified.and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok());
    made.is_some_and(|made| now_ms - i64::try_from(made.as_millis()).unwrap_or(0) < HOLDS_MS)
}

/// Present holder of a run's lease, according to its file.
#[must_use]
pub fn holder(run_dir: &Path) -> Option<LockHolder> {
    let folder = run_dir.join(FOLDER);
    let text = read(&file(&folder, highest(&folder).ok()?))?;
    let held = !text.released && clock::now_ms() < text.expires_ms;
    let generation = text.generation;
    held.then(|| text.into_holder(&file(&folder, generation), clock::now_ms()))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn is_read_as_written(golden: &serde_json::Value) {
        let read: Text = serde_json::from_value(golden.clone()).unwrap();
        assert_eq!(&serde_json::to_value(&read).unwrap(), golden);
    }

    fn claim(host: &str, pid: u32) -> Claim {
        Claim {
            host: host.into(),
            boot_id: "b".into(),
            pid,
            pid_start_ticks: 1,
            at: "T".into(),
            nodes: Vec::new(),
        }
    }

    #[test]
    fn one_holds_it_the_next_takes_over_and_the_first_commits_nothing_more() {
        let dir = tempfile::tempdir().unwrap();
        let elsewhere = |_: &Claim| None;
        let mut first = Lease::acquire(dir.path(), &claim("a", 1), elsewhere, 1000).unwrap();
        first.check(2000).unwrap();
        let error = Lease::acquire(dir.path(), &claim("b", 2), elsewhere, 2000).unwrap_err();
        assert!(error.to_string().contains("process 1 on a"), "{error}");
        // The holder slept: its lease expired and was taken over from another host.
        let later = 1000 + HOLDS_MS;
        assert!(matches!(
            first.check(later),
            Err(StoreError::LeaseLost { .. })
        ));
        let mut second = Lease::acquire(dir.path(), &claim("b", 2), elsewhere, later).unwrap();
        assert!(matches!(
            first.check(2000),
            Err(StoreError::LeaseLost {
                generation: 1,
                now: 2
            })
        ));
        drop(first);
        second.check(later + 1).unwrap();
        // A released lease is free at once.
        drop(second);
        Lease::acquire(dir.path(), &claim("a", 3), elsewhere, later + 2).unwrap();
    }

    #[test]
    fn a_dead_holder_on_this_host_is_not_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let first = Lease::acquire(dir.path(), &claim("a", 1), |_| None, 1000).unwrap();
        std::mem::forget(first);
        assert!(Lease::acquire(dir.path(), &claim("a", 2), |_| Some(true), 1001).is_err());
        let mut second = Lease::acquire(dir.path(), &claim("a", 2), |_| Some(false), 1001).unwrap();
        // The lease is renewed when less than half of its time is left.
        second.check(1001 + HOLDS_MS * 3 / 4).unwrap();
        second.check(1001 + HOLDS_MS * 5 / 4).unwrap();
    }

    #[test]
    fn of_many_one_gets_it() {
        let dir = tempfile::tempdir().unwrap();
        let barrier = std::sync::Barrier::new(32);
        let held: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..32)
                .map(|pid| {
                    let (barrier, path) = (&barrier, dir.path());
                    scope.spawn(move || {
                        barrier.wait();
                        Lease::acquire(path, &claim("a", pid), |_| None, 1000).ok()
                    })
                })
                .collect();
            threads
                .into_iter()
                .filter_map(|thread| thread.join().unwrap())
                .collect()
        });
        assert_eq!(held.len(), 1);
    }

    #[test]
    fn a_lease_of_a_clock_that_is_ahead_says_until_when_and_how_to_end_it() {
        let dir = tempfile::tempdir().unwrap();
        let elsewhere = |_: &Claim| None;
        let five_hours = 5 * 3_600_000;
        let ahead = Lease::acquire(dir.path(), &claim("login4", 1), elsewhere, five_hours).unwrap();
        let told = Lease::acquire(dir.path(), &claim("b", 2), elsewhere, 0)
            .unwrap_err()
            .to_string();
        for part in [
            "process 1 on login4",
            "holds until 1970-01-01T05:10:00.000Z",
            "the clock of login4 is ahead by 300 min or more",
            "0000000001.json",
        ] {
            assert!(told.contains(part), "{told}");
        }
        // With clocks that agree nothing is said of them.
        let told =
            Lease::acquire(dir.path(), &claim("b", 2), elsewhere, five_hours + 1000).unwrap_err();
        let told = told.to_string();
        assert!(
            told.contains("holds until 1970-01-01T05:10:00.000Z unless"),
            "{told}"
        );
        assert!(!told.contains("ahead"), "{told}");
        drop(ahead);
    }
}
