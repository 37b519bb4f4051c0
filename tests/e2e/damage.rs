//! Damaged or newer databases, unwritable directories and full disks: each is reported clearly, and
//! nothing is lost.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{Cohort, cardiotwin, published};

fn database(cohort: &Cohort) -> PathBuf {
    cohort.run_dir().join("cardiotwin.db")
}

/// Merges SQLite's log into the database file: a second run with nothing to do has no reader open
/// while it closes.
fn settle(cohort: &Cohort, arguments: &[&str]) {
    let mut all = vec!["run", "--no-report"];
    all.extend(arguments);
    cohort.call(&all).expect(0);
    cohort.call(&all).expect(0);
    let log = cohort.run_dir().join("cardiotwin.db-wal");
    assert!(
        std::fs::metadata(&log).map_or(0, |m| m.len()) == 0,
        "a clean end leaves one file"
    );
}

/// Overwrites bytes in the database file, as SQLite never would.
fn overwrite(cohort: &Cohort, at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut content = std::fs::read(database(cohort)).unwrap();
    content[at..at + bytes.len()].copy_from_slice(bytes);
    std::fs::write(database(cohort), &content).unwrap();
    content
}

#[test]
fn a_damaged_database_is_named_and_left_alone() {
    let cohort = Cohort::quick();
    settle(&cohort, &[]);
    let before = published(&cohort.patient("01-CoA"));
    let whole = std::fs::read(database(&cohort)).unwrap();

    // Overwrite all but the first page.
    let length = whole.len() - 4096;
    let damaged = overwrite(&cohort, 4096, &vec![0x5a; length]);
    for command in ["run", "status"] {
        let said = cohort
            .call(&[command])
            .expect(5)
            .complains_of(&["cardiotwin.db"]);
        assert!(!said.err.contains("panicked"), "{}", said.err);
    }
    cohort
        .call(&["run"])
        .expect(5)
        .complains_of(&["damaged", "restore it from a backup"]);
    assert_eq!(
        std::fs::read(database(&cohort)).unwrap(),
        damaged,
        "it was not touched"
    );

    std::fs::write(
        database(&cohort),
        b"this was never a database, only a long enough text to look like one",
    )
    .unwrap();
    cohort
        .call(&["run"])
        .expect(5)
        .complains_of(&["not a database of cardiotwin"]);

    std::fs::write(database(&cohort), &whole).unwrap();
    cohort.call(&["run", "--no-report"]).expect(0);
    assert_eq!(published(&cohort.patient("01-CoA")), before);
}

#[test]
fn a_database_of_a_newer_version_is_refused_unchanged() {
    let cohort = Cohort::quick();
    settle(&cohort, &["--patient", "01-CoA"]);
    // SQLite keeps `user_version`, which holds the format, at byte 60, big-endian.
    let newer = overwrite(&cohort, 60, &99_u32.to_be_bytes());
    for command in ["run", "status"] {
        cohort
            .call(&[command])
            .expect(5)
            .complains_of(&["format 99", "use the newer program"]);
    }
    assert_eq!(std::fs::read(database(&cohort)).unwrap(), newer);
}

#[test]
fn a_database_that_was_never_finished_is_made_anew_by_run() {
    let cohort = Cohort::quick();
    settle(&cohort, &[]);
    let before = published(&cohort.patient("01-CoA"));
    // As a kill leaves it before the first page is written, or a lost log behind an empty file.
    std::fs::write(database(&cohort), "").unwrap();
    for command in [&["status"][..], &["show", "01-CoA"], &["export"]] {
        cohort
            .call(command)
            .expect(5)
            .complains_of(&["is empty", "`cardiotwin run` creates it"]);
    }
    cohort.call(&["run", "--no-report"]).expect(0);
    assert_eq!(
        published(&cohort.patient("01-CoA")),
        before,
        "finished attempts are taken up"
    );
}

#[test]
fn a_run_of_an_older_format_is_read_as_it_is_and_brought_up_to_date_by_run() {
    use sqlx::Connection as _;
    let cohort = Cohort::quick();
    settle(&cohort, &["--patient", "01-CoA", "--workers", "1"]);
    let before = published(&cohort.patient("01-CoA"));
    let file = sqlx::sqlite::SqliteConnectOptions::new().filename(database(&cohort));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let mut connection = sqlx::sqlite::SqliteConnection::connect_with(&file)
            .await
            .unwrap();
        let sql = "DROP TABLE jobs; DROP TABLE allotments; DELETE FROM _sqlx_migrations WHERE version = 2; PRAGMA user_version = 1";
        sqlx::raw_sql(sql).execute(&mut connection).await.unwrap();
        connection.close().await.unwrap();
    });
    let older = std::fs::read(database(&cohort)).unwrap();
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["counts"]["done"], 1);
    for command in [&["show", "01-CoA"][..], &["export"], &["run", "--dry-run"]] {
        cohort.call(command).expect(0);
    }
    assert_eq!(
        std::fs::read(database(&cohort)).unwrap(),
        older,
        "readers change nothing"
    );
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(
        said.err.contains("executor.workers=1"),
        "the kept options apply: {}",
        said.err
    );
    assert_eq!(published(&cohort.patient("01-CoA")), before);
    assert!(cohort.run_dir().join("cardiotwin.format-1.db").exists());
}

#[test]
fn another_program_that_locks_the_database_is_waited_for_and_named() {
    use sqlx::Connection as _;
    let cohort = Cohort::quick();
    settle(&cohort, &["--patient", "01-CoA"]);
    let file = sqlx::sqlite::SqliteConnectOptions::new().filename(database(&cohort));
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let mut foreign = runtime.block_on(async {
        let mut foreign = sqlx::sqlite::SqliteConnection::connect_with(&file)
            .await
            .unwrap();
        sqlx::raw_sql("BEGIN IMMEDIATE")
            .execute(&mut foreign)
            .await
            .unwrap();
        foreign
    });
    let mut running = cohort.start(&["--no-report"]);
    running.wait_for_words("which has locked");
    runtime.block_on(async {
        sqlx::raw_sql("ROLLBACK")
            .execute(&mut foreign)
            .await
            .unwrap();
        foreign.close().await.unwrap();
    });
    let said = running.end().expect(0);
    let own = format!("process {}", std::process::id());
    assert!(said.err.contains(&own), "{}", said.err);
    assert_eq!(cohort.patient("02-CoA")["status"]["state"], "done");
}

#[test]
fn a_run_that_may_not_be_written_can_still_be_read() {
    let Some(place) = Tmpfs::mount("32m") else {
        return;
    };
    let cohort = Cohort::quick();
    let run = place.path().join("run");
    let run = run.to_str().unwrap();
    cohort
        .call(&["run", "--no-report", "--run-dir", run])
        .expect(0);
    place.remount("ro");
    let said = cohort.call(&["run", "--run-dir", run]);
    assert!([5, 6].contains(&said.code), "{said:?}");
    assert!(
        said.err.contains("writ") || said.err.contains("ead-only"),
        "{}",
        said.err
    );
    let status = cohort.call(&["status", "--run-dir", run, "--json"]).json();
    assert_eq!(status["counts"]["done"], 2);
    cohort.call(&["show", "01-CoA", "--run-dir", run]).expect(0);
    cohort
        .call(&["export", "--run-dir", run, "--out", "tables"])
        .expect(0);
    cohort
        .call(&["cancel", "01-CoA", "--run-dir", run])
        .complains_of(&["error"]);
    place.remount("rw");
    cohort.call(&["run", "--run-dir", run]).expect(0);
}

#[test]
fn a_full_disk_stops_the_run_and_more_space_lets_it_go_on() {
    let Some(place) = Tmpfs::mount("200m") else {
        return;
    };
    let cohort = Cohort::quick();
    let run = place.path().join("run");
    let run_text = run.to_str().unwrap();
    cohort
        .call(&[
            "run",
            "--no-report",
            "--run-dir",
            run_text,
            "--patient",
            "01-CoA",
        ])
        .expect(0);
    let show = |id: &str| {
        cohort
            .call(&["show", id, "--json", "--run-dir", run_text])
            .json()
    };
    let before = published(&show("01-CoA"));
    // Something else fills the disk to its last block.
    fill(&place.path().join("ballast"));
    let said = cohort.call(&["run", "--no-report", "--run-dir", run_text]);
    assert!([1, 5, 6].contains(&said.code), "{said:?}");
    assert!(
        said.err.contains("free") || said.err.contains("space"),
        "{}",
        said.err
    );
    assert!(!said.err.contains("panicked"), "{}", said.err);
    std::fs::remove_file(place.path().join("ballast")).unwrap();
    let said = cohort.call(&["run", "--no-report", "--run-dir", run_text]);
    if said.code == 1 {
        // Attempts that failed for lack of space have used up their retries.
        cohort
            .call(&["retry", "--failed", "--run-dir", run_text])
            .expect(0);
        cohort
            .call(&["run", "--no-report", "--run-dir", run_text])
            .expect(0);
    }
    assert_eq!(
        published(&show("01-CoA")),
        before,
        "what was done before is not done again"
    );
    assert_eq!(show("02-CoA")["status"]["state"], "done");
}

/// Writes until no space is left.
fn fill(path: &Path) {
    use std::io::Write as _;
    let mut file = std::fs::File::create(path).unwrap();
    for size in [1 << 20, 1 << 12, 1] {
        let block = vec![0_u8; size];
        while file.write_all(&block).is_ok() {}
    }
}

#[test]
fn a_missing_worker_is_named() {
    let cohort = Cohort::quick();
    cohort
        .call(&["run", "--worker", "nowhere/worker"])
        .expect(6)
        .complains_of(&["no worker at", "nowhere/worker"]);
    let elsewhere = tempfile::tempdir().unwrap();
    cardiotwin(elsewhere.path(), &["run"])
        .expect(3)
        .complains_of(&["cohort.toml", "cardiotwin init"]);
}

/// A small file system for this test, which needs root. Without root the test is skipped with a
/// message.
struct Tmpfs {
    folder: tempfile::TempDir,
}

impl Tmpfs {
    fn mount(size: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let options = format!("size={size}");
        let output = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &options, "tmpfs"])
            .arg(folder.path())
            .output();
        match output {
            Ok(output) if output.status.success() => Some(Self { folder }),
            Ok(output) => {
                let why = String::from_utf8_lossy(&output.stderr);
                cardiotwin_not_tested::not_tested("own-mounts", why.trim());
                None
            }
            Err(error) => {
                cardiotwin_not_tested::not_tested("own-mounts", error);
                None
            }
        }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn remount(&self, option: &str) {
        let option = format!("remount,{option}");
        let status = Command::new("mount")
            .args(["-o", &option])
            .arg(self.path())
            .status()
            .unwrap();
        assert!(status.success(), "mount -o {option}");
    }
}

impl Drop for Tmpfs {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.path()).status();
    }
}
