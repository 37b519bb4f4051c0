//! Damaged, foreign and outdated databases, and directories without permission to write.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::status::PatientStatus;
use cardiotwin_workflow::patient::Patient;
use sqlx::Connection as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

use super::patients::{PatientRow, PlanRow};
use super::{Batch, DATABASE_FILE, Extent, Patience, Reader, StoreError, Writer};

fn patient(id: i64, version: i64) -> PatientRow {
    PatientRow {
        id,
        position: id,
        active: true,
        version,
        state: Patient::Waiting,
        status: PatientStatus {
            patient: format!("P{id}"),
            step: "-".into(),
            ..PatientStatus::default()
        },
        since_ms: 0,
    }
}

fn plan(patient_id: i64, bytes: usize) -> PlanRow {
    let text = |c: &str| c.to_owned();
    let given = format!("\"{}\"", "x".repeat(bytes));
    PlanRow {
        patient_id,
        given,
        overrides: text("{}"),
        carried: text("[]"),
        plan: None,
    }
}

async fn add(writer: &mut Writer, id: i64, bytes: usize) -> Result<(), StoreError> {
    let mut batch = Batch::default();
    batch.insert_patient(&patient(id, 1));
    batch.put_plan(&plan(id, bytes));
    writer.commit(&mut batch).await
}

async fn raw(dir: &Path) -> SqliteConnection {
    let options = SqliteConnectOptions::new()
        .filename(dir.join(DATABASE_FILE))
        .create_if_missing(true);
    SqliteConnection::connect_with(&options).await.unwrap()
}

async fn execute(dir: &Path, sql: &'static str) -> Result<(), sqlx::Error> {
    let mut connection = raw(dir).await;
    sqlx::raw_sql(sql).execute(&mut connection).await?;
    connection.close().await
}

/// A run directory with two patients, closed properly.
async fn run_dir() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = Writer::open(dir.path()).await.unwrap();
    writer.set_meta(&[("cohort", "test")]).await.unwrap();
    add(&mut writer, 1, 10).await.unwrap();
    add(&mut writer, 2, 10).await.unwrap();
    writer.close("none", 0).await.unwrap();
    dir
}

#[tokio::test]
async fn a_database_of_a_newer_version_is_refused_with_both_versions_and_left_alone() {
    let dir = run_dir().await;
    execute(
        dir.path(),
        "PRAGMA user_version = 7; UPDATE meta SET value = '9.1.0' WHERE key = 'written_by'",
    )
    .await
    .unwrap();
    let before = std::fs::read(dir.path().join(DATABASE_FILE)).unwrap();
    for error in [
        Writer::open(dir.path()).await.err(),
        Reader::open(dir.path()).await.err(),
    ] {
        let text = error.expect("refused").to_string();
        for part in [
            "format 7",
            "9.1.0",
            env!("CARGO_PKG_VERSION"),
            "formats up to 2",
        ] {
            assert!(text.contains(part), "{part} is missing: {text}");
        }
    }
    assert_eq!(
        std::fs::read(dir.path().join(DATABASE_FILE)).unwrap(),
        before
    );
}

#[tokio::test]
async fn what_is_not_ours_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join(DATABASE_FILE);
    assert!(matches!(
        Reader::open(dir.path()).await.err(),
        Some(StoreError::Missing { .. })
    ));
    std::fs::write(
        &file,
        b"this is a letter to my mother, and it is long enough to be looked at\n".repeat(100),
    )
    .unwrap();
    assert!(matches!(
        Reader::open(dir.path()).await.err(),
        Some(StoreError::NotOurs { .. })
    ));
    let error = Writer::open(dir.path()).await.err().unwrap();
    assert!(matches!(error, StoreError::NotOurs { .. }), "{error:?}");
    std::fs::remove_file(&file).unwrap();
    execute(dir.path(), "CREATE TABLE addresses (name TEXT)")
        .await
        .unwrap();
    let error = Writer::open(dir.path()).await.err().unwrap();
    assert!(matches!(error, StoreError::NotOurs { .. }), "{error:?}");
    assert!(error.to_string().contains("--run-dir"), "{error}");
}

#[tokio::test]
async fn a_damaged_database_is_named_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = Writer::open(dir.path()).await.unwrap();
    for id in 1..200 {
        add(&mut writer, id, 400).await.unwrap();
    }
    writer.close("none", 0).await.unwrap();
    let file = dir.path().join(DATABASE_FILE);
    let mut bytes = std::fs::read(&file).unwrap();
    let n = bytes.len();
    // The first page identifies the file and stays intact. Pages in the middle are overwritten.
    bytes[n / 2..n / 2 + 3 * 4096].fill(0xA5);
    std::fs::write(&file, &bytes).unwrap();
    let error = Writer::open(dir.path()).await.err().unwrap();
    assert!(matches!(error, StoreError::Corrupted { .. }), "{error:?}");
    assert!(error.to_string().contains("backup"), "{error}");
}

#[tokio::test]
async fn a_row_that_somebody_else_changed_stops_the_writer() {
    let dir = run_dir().await;
    let mut writer = Writer::open(dir.path()).await.unwrap();
    let mut batch = Batch::default();
    batch.update_patient(&patient(1, 1));
    batch.update_patient(&patient(2, 8));
    let error = writer.commit(&mut batch).await.unwrap_err();
    assert!(
        matches!(
            error,
            StoreError::Guard {
                table: "patients",
                expected: 2,
                changed: 1
            }
        ),
        "{error:?}"
    );
    // The batch is committed as a whole or not at all: the first row has kept its version, too.
    let mut batch = Batch::default();
    batch.update_patient(&patient(1, 1));
    batch.update_patient(&patient(2, 1));
    writer.commit(&mut batch).await.unwrap();
}

#[tokio::test]
async fn a_full_disk_is_named_and_what_was_committed_stays() {
    let dir = run_dir().await;
    let mut writer = Writer::open(dir.path()).await.unwrap();
    writer.limit_pages(80).await;
    let mut id = 3;
    let error = loop {
        match add(&mut writer, id, 20_000).await {
            Ok(()) => id += 1,
            Err(error) => break error,
        }
        assert!(id < 1000, "the limit was never met");
    };
    assert!(matches!(error, StoreError::DiskFull { .. }), "{error:?}");
    assert!(error.to_string().contains("no space left"), "{error}");
    drop(writer);
    // With free space again, everything is there and more can be committed.
    let mut writer = Writer::open(dir.path()).await.unwrap();
    assert_eq!(
        writer.load(Extent::All).await.unwrap().patients.len() as i64,
        id - 1
    );
    add(&mut writer, id, 20_000).await.unwrap();
}

#[tokio::test]
async fn the_log_cannot_be_rewritten() {
    let dir = run_dir().await;
    execute(
        dir.path(),
        "INSERT INTO events (at_ms, machine, event) VALUES (1, 'task', '{}')",
    )
    .await
    .unwrap();
    for sql in ["UPDATE events SET at_ms = 2", "DELETE FROM events"] {
        let error = execute(dir.path(), sql).await.unwrap_err();
        assert!(error.to_string().contains("append-only"), "{error}");
    }
}

#[tokio::test]
async fn readers_see_commits_while_the_writer_is_at_work() {
    let dir = run_dir().await;
    let mut writer = Writer::open(dir.path()).await.unwrap();
    let reader = Reader::open(dir.path()).await.unwrap();
    assert_eq!(reader.status().await.unwrap().patients.len(), 2);
    add(&mut writer, 3, 10).await.unwrap();
    assert_eq!(reader.status().await.unwrap().patients.len(), 3);
    let error = reader
        .patient_record(&PatientId::from("P9"))
        .await
        .unwrap_err();
    assert!(
        error.to_string().contains("known patients: P1, P2, P3"),
        "{error}"
    );
}

#[tokio::test]
async fn tasks_of_a_moved_run_find_their_files() {
    let run = run_dir().await;
    let mut writer = Writer::open(run.path()).await.unwrap();
    writer
        .lies_in(Path::new("/old/it's \"run\""))
        .await
        .unwrap();
    let specs = [
        r#"{"nodal":{"path":"/old/it's \"run\"/attempts/aa/nodal.csv","sha256":"x"}}"#,
        r#"{"nodal":{"path":"/old/it's \"run\"-2/nodal.csv","sha256":"x"}}"#,
    ];
    let mut raw = raw(run.path()).await;
    for (key, spec) in ["a", "b"].into_iter().zip(specs) {
        sqlx::query("INSERT INTO tasks (key, kind, version, word, state, spec) VALUES (?1, 'noop', 1, 'w', '{}', ?2)")
            .bind(key)
            .bind(spec)
            .execute(&mut raw)
            .await
            .unwrap();
    }
    let spec_of = async |raw: &mut SqliteConnection, key: &str| -> String {
        let query = sqlx::query_scalar("SELECT spec FROM tasks WHERE key = ?1");
        query.bind(key).fetch_one(raw).await.unwrap()
    };
    writer.lies_in(Path::new("/new")).await.unwrap();
    let moved = spec_of(&mut raw, "a").await;
    assert_eq!(
        moved,
        r#"{"nodal":{"path":"/new/attempts/aa/nodal.csv","sha256":"x"}}"#
    );
    assert_eq!(spec_of(&mut raw, "b").await, specs[1]);
}

const READ_ONLY: &str = "CARDIOTWIN_TEST_READ_ONLY";

/// The test runs itself again in a namespace where the run directory is mounted read-only, because
/// root may write anywhere else.
#[tokio::test]
async fn a_run_can_be_read_where_nothing_can_be_written() {
    if let Some(dir) = std::env::var_os(READ_ONLY) {
        let dir = Path::new(&dir);
        let status = Reader::open(dir).await.unwrap().status().await.unwrap();
        assert_eq!((status.patients.len(), status.cohort.as_str()), (2, "test"));
        let error = Writer::open(dir).await.err().unwrap();
        assert!(matches!(error, StoreError::ReadOnly { .. }), "{error:?}");
        assert!(error.to_string().contains("read-only"), "{error}");
        return;
    }
    let mount = ["--user", "--map-root-user", "--mount", "sh", "-c"];
    let possible = Command::new("unshare").args(mount).arg("true").status();
    if !possible.is_ok_and(|status| status.success()) {
        cardiotwin_not_tested::not_tested("own-mounts", "unshare may not mount a file system");
        return;
    }
    for killed in [false, true] {
        let dir = run_dir().await;
        if killed {
            // The log was not merged into the database and has all of the content.
            let copy = tempfile::tempdir().unwrap();
            let mut writer = Writer::open(copy.path()).await.unwrap();
            writer.set_meta(&[("cohort", "test")]).await.unwrap();
            add(&mut writer, 1, 10).await.unwrap();
            add(&mut writer, 2, 10).await.unwrap();
            for file in [DATABASE_FILE.to_owned(), format!("{DATABASE_FILE}-wal")] {
                std::fs::copy(copy.path().join(&file), dir.path().join(&file)).unwrap();
            }
        }
        let script =
            r#"mount --bind "$1" "$1" && mount -o remount,bind,ro "$1" && shift && exec "$@""#;
        let run = Command::new("unshare")
            .args(mount)
            .args([script, "sh"])
            .arg(dir.path())
            .arg(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "tests::a_run_can_be_read_where_nothing_can_be_written",
            ])
            .env(READ_ONLY, dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&run.stdout);
        assert!(
            run.status.success() && said.contains("1 passed"),
            "killed: {killed}\n{said}"
        );
    }
}

/// Files that a killed program may have left under the database's name: nothing in it, SQLite's first page of a write-ahead log
/// whose log is lost, and sqlx's own table alone.
async fn unfinished() -> Vec<(&'static str, tempfile::TempDir)> {
    let new = || tempfile::tempdir().unwrap();
    let (empty, header, table) = (new(), new(), new());
    std::fs::write(empty.path().join(DATABASE_FILE), "").unwrap();
    // A log of another database, which would be applied to the new one.
    let other = new();
    let mut writer = Writer::open(other.path()).await.unwrap();
    add(&mut writer, 1, 10).await.unwrap();
    let log = format!("{DATABASE_FILE}-wal");
    std::fs::copy(other.path().join(&log), empty.path().join(&log)).unwrap();
    execute(table.path(), "CREATE TABLE _sqlx_migrations (version BIGINT PRIMARY KEY, description TEXT NOT NULL, installed_on TIMESTAMP NOT NULL DEFAULT CURRENT_TIMESTAMP, success BOOLEAN NOT NULL, checksum BLOB NOT NULL, execution_time BIGINT NOT NULL)")
        .await
        .unwrap();
    execute(header.path(), "PRAGMA journal_mode = wal")
        .await
        .unwrap();
    assert_eq!(
        header.path().join(DATABASE_FILE).metadata().unwrap().len(),
        4096
    );
    vec![("empty", empty), ("header", header), ("table", table)]
}

#[tokio::test]
async fn a_database_that_was_never_finished_is_made_anew() {
    for (which, dir) in unfinished().await {
        let error = Reader::open(dir.path()).await.err().unwrap();
        assert!(
            matches!(error, StoreError::Missing { .. }),
            "{which}: {error:?}"
        );
        assert!(
            error.to_string().contains("`cardiotwin run` creates it"),
            "{which}: {error}"
        );
        let mut writer = Writer::open(dir.path()).await.unwrap();
        add(&mut writer, 1, 10).await.unwrap();
        writer.close("none", 0).await.unwrap();
        let status = Reader::open(dir.path()).await.unwrap().status().await;
        assert_eq!(status.unwrap().patients.len(), 1, "{which}");
    }
}

/// What a run directory holds after each instant at which a writer that opens it may be killed.
async fn killed_at_each_instant(of: impl AsyncFn() -> tempfile::TempDir) -> Vec<tempfile::TempDir> {
    let mut left = Vec::new();
    loop {
        let dir = of().await;
        let passed = AtomicUsize::new(0);
        let die = |_: &str| match passed.fetch_add(1, Ordering::Relaxed) == left.len() {
            true => Err(std::io::Error::other("killed")),
            false => Ok(()),
        };
        let opened = Writer::open_past(dir.path(), Patience::default(), &die).await;
        if opened.is_ok() {
            return left;
        }
        left.push(dir);
    }
}

#[tokio::test]
async fn whenever_its_making_is_killed_the_database_has_its_name_whole_or_not_at_all() {
    let left = killed_at_each_instant(async || tempfile::tempdir().unwrap()).await;
    assert!(left.len() >= 8, "only {} instants", left.len());
    for dir in &left {
        match Reader::open(dir.path()).await {
            Ok(reader) => assert_eq!(reader.status().await.unwrap().patients.len(), 0),
            Err(error) => {
                assert!(matches!(error, StoreError::Missing { .. }), "{error:?}");
                assert!(!dir.path().join(DATABASE_FILE).exists());
            }
        }
        let mut writer = Writer::open(dir.path()).await.unwrap();
        add(&mut writer, 1, 10).await.unwrap();
        writer.close("none", 0).await.unwrap();
        let files = std::fs::read_dir(dir.path()).unwrap().count();
        assert_eq!(files, 1, "no draft is left behind");
    }
}

#[tokio::test]
async fn whenever_its_conversion_is_killed_the_database_is_read_and_converted_later() {
    let left = killed_at_each_instant(run_of_format_1).await;
    assert_eq!(left.len(), 3, "copy, and around the one conversion");
    for dir in &left {
        let status = Reader::open(dir.path()).await.unwrap().status().await;
        assert_eq!(status.unwrap().patients.len(), 2);
        let mut writer = Writer::open(dir.path()).await.unwrap();
        add(&mut writer, 3, 10).await.unwrap();
        writer.close("none", 0).await.unwrap();
        let file = dir.path().join(DATABASE_FILE);
        assert_eq!(number(&file, "PRAGMA user_version").await, 2);
    }
}

/// A run of format 1, as the first version left it: without the tables for clusters and without
/// their migration.
async fn run_of_format_1() -> tempfile::TempDir {
    let dir = run_dir().await;
    let sql = "DROP TABLE jobs; DROP TABLE allotments; DELETE FROM _sqlx_migrations WHERE version = 2; PRAGMA user_version = 1";
    execute(dir.path(), sql).await.unwrap();
    dir
}

async fn number(file: &Path, sql: &'static str) -> i64 {
    let options = SqliteConnectOptions::new().filename(file).read_only(true);
    let mut connection = SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query_scalar(sql)
        .fetch_one(&mut connection)
        .await
        .unwrap()
}

#[tokio::test]
async fn a_database_of_an_older_format_is_copied_before_it_is_brought_up_to_date() {
    let dir = run_of_format_1().await;
    let before = std::fs::read(dir.path().join(DATABASE_FILE)).unwrap();
    let status = Reader::open(dir.path())
        .await
        .unwrap()
        .status()
        .await
        .unwrap();
    assert_eq!((status.cohort.as_str(), status.patients.len()), ("test", 2));
    assert_eq!(
        std::fs::read(dir.path().join(DATABASE_FILE)).unwrap(),
        before,
        "readers change nothing"
    );
    let mut writer = Writer::open(dir.path()).await.unwrap();
    add(&mut writer, 3, 10).await.unwrap();
    writer.close("none", 0).await.unwrap();
    let (now, copy) = (
        dir.path().join(DATABASE_FILE),
        dir.path().join("cardiotwin.format-1.db"),
    );
    assert_eq!(
        (
            number(&now, "PRAGMA user_version").await,
            number(&copy, "PRAGMA user_version").await
        ),
        (2, 1)
    );
    let patients = "SELECT count(*) FROM patients";
    assert_eq!(
        (number(&now, patients).await, number(&copy, patients).await),
        (3, 2),
        "the copy is as it was before"
    );
    assert_eq!(
        number(
            &copy,
            "SELECT count(*) FROM sqlite_master WHERE name = 'jobs'"
        )
        .await,
        0
    );
    // The copy is a database with which an older version can continue.
    let back = tempfile::tempdir().unwrap();
    std::fs::copy(&copy, back.path().join(DATABASE_FILE)).unwrap();
    drop(Writer::open(back.path()).await.unwrap());
}

#[tokio::test]
async fn a_migration_that_fails_leaves_the_database_and_its_copy_as_they_were() {
    let dir = run_of_format_1().await;
    execute(dir.path(), "CREATE TABLE allotments (in_the_way INTEGER)")
        .await
        .unwrap();
    let error = Writer::open(dir.path())
        .await
        .expect_err("the table is in the way")
        .to_string();
    assert!(
        error.contains("allotments") || error.contains("migrating"),
        "{error}"
    );
    for file in [DATABASE_FILE, "cardiotwin.format-1.db"] {
        let file = dir.path().join(file);
        assert_eq!(
            number(&file, "PRAGMA user_version").await,
            1,
            "{}",
            file.display()
        );
        assert_eq!(number(&file, "SELECT count(*) FROM patients").await, 2);
        assert_eq!(
            number(
                &file,
                "SELECT count(*) FROM sqlite_master WHERE name = 'jobs'"
            )
            .await,
            0,
            "nothing half done"
        );
    }
}

#[tokio::test]
async fn the_mark_of_the_database_changes_with_commits_alone() {
    let dir = run_dir().await;
    let mut writer = Writer::open(dir.path()).await.unwrap();
    let reader = Reader::open(dir.path()).await.unwrap();
    let first = reader.data_version().await.unwrap();
    assert!(first.is_some(), "a connection to the file itself is live");
    reader.status().await.unwrap();
    assert_eq!(reader.data_version().await.unwrap(), first);
    add(&mut writer, 3, 10).await.unwrap();
    assert_ne!(reader.data_version().await.unwrap(), first);
}

#[tokio::test]
async fn the_pace_counts_every_attempt_once_and_those_at_work_up_to_now() {
    let dir = run_dir().await;
    execute(
        dir.path(),
        "UPDATE patients SET word = 'done' WHERE id = 1;
         INSERT INTO allocations (id, kind, external_id, host, opened_ms) VALUES (1, 'local', '1', 'here', 0);
         INSERT INTO tasks (key, kind, version, word, state, spec) VALUES
             ('a', 'noop', 1, 'published', '{}', '{}'), ('b', 'noop', 1, 'attempting', '{}', '{}');
         -- A task that left a step and came back has two rows.
         INSERT INTO steps (patient_id, stage, number, task, at_ms) VALUES
             (1, 'step0', 1, 'a', 0), (1, 'step0', 1, 'a', 5), (2, 'step0', 1, 'b', 0);
         INSERT INTO attempts (task, generation, allocation, directory, version, word, over, state, planned_ms, ended_ms) VALUES
             ('a', 1, 1, 'd', 1, 'done', 1, '{}', 0, 700), ('a', 2, 1, 'e', 1, 'done', 1, '{}', 1000, 1300),
             ('b', 1, 1, 'f', 1, 'running', 0, '{}', 2000, NULL);",
    )
    .await
    .unwrap();
    let pace = Reader::open(dir.path())
        .await
        .unwrap()
        .pace(2500)
        .await
        .unwrap();
    assert_eq!(
        (pace.done_ms, pace.open_ms, pace.n_at_work),
        (vec![1000], vec![500], 1)
    );
}

/// A connection of another program that has begun to write.
async fn foreign_lock(dir: &Path) -> SqliteConnection {
    let mut foreign = raw(dir).await;
    sqlx::raw_sql("BEGIN IMMEDIATE")
        .execute(&mut foreign)
        .await
        .unwrap();
    foreign
}

#[tokio::test]
async fn a_writer_waits_for_another_program_and_says_for_whom() {
    let dir = run_dir().await;
    let mut foreign = foreign_lock(dir.path()).await;
    let (tell, mut told) = tokio::sync::mpsc::unbounded_channel();
    let patience = Patience::new(move |waiting| tell.send(waiting.clone()).is_ok());
    let held = dir.path().to_owned();
    let writing = tokio::spawn(async move {
        let mut writer = Writer::open_past(&held, patience, &|_| Ok(()))
            .await
            .unwrap();
        writer.set_meta(&[("cohort", "written")]).await.unwrap();
        add(&mut writer, 3, 10).await.unwrap();
        writer.close("none", 0).await.unwrap();
    });
    let waiting = told.recv().await.expect("the writer waits");
    assert_eq!(waiting.file, dir.path().join(DATABASE_FILE));
    // The other program is this process, which is never named.
    assert_eq!(waiting.holder, "another program");
    let second = told.recv().await.expect("it waits on");
    assert_eq!(second.since, waiting.since);
    sqlx::raw_sql("ROLLBACK")
        .execute(&mut foreign)
        .await
        .unwrap();
    writing.await.unwrap();
    let status = Reader::open(dir.path()).await.unwrap().status().await;
    let status = status.unwrap();
    assert_eq!(
        (status.cohort.as_str(), status.patients.len()),
        ("written", 3)
    );
}

#[tokio::test]
async fn a_wait_that_is_given_up_loses_nothing() {
    let dir = run_dir().await;
    let mut writer = Writer::open_past(dir.path(), Patience::of_ms(0), &|_| Ok(()))
        .await
        .unwrap();
    let mut foreign = foreign_lock(dir.path()).await;
    let mut batch = Batch::default();
    batch.insert_patient(&patient(3, 1));
    batch.put_plan(&plan(3, 10));
    let error = writer.commit(&mut batch).await.unwrap_err();
    assert!(matches!(error, StoreError::Busy { .. }), "{error:?}");
    assert!(error.to_string().contains("locked by"), "{error}");
    sqlx::raw_sql("ROLLBACK")
        .execute(&mut foreign)
        .await
        .unwrap();
    add(&mut writer, 3, 10).await.unwrap();
}
