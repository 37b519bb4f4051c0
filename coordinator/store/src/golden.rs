//! A database of format 2, and what its columns hold in JSON, as their versions of today were written.

use std::path::Path;

use cardiotwin_schemas::formats::{self, ALL, Format};
use cardiotwin_workflow::attempt::Attempt;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use sqlx::Connection as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

use super::cluster_jobs::{Allotment, ClusterReport, JobSpec, SeenElement};
use super::lock::LockHolder;
use super::outbox::Action;
use super::stored_formats::{KEY, STORED};
use super::{DATABASE_FILE, Extent, Reader, StoreError, Writer, lease};

const DATABASE: &str = include_str!("golden/database.sql");

fn text(format: &Format) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::fs::read_to_string(root.join(format.golden)).unwrap()
}

fn round<T: DeserializeOwned + Serialize>(golden: &Value) -> T {
    let read: T = serde_json::from_value(golden.clone()).unwrap();
    assert_eq!(&serde_json::to_value(&read).unwrap(), golden);
    read
}

async fn raw(dir: &Path) -> SqliteConnection {
    let options = SqliteConnectOptions::new()
        .filename(dir.join(DATABASE_FILE))
        .create_if_missing(true)
        // The rows of a dump come table by table.
        .foreign_keys(false);
    SqliteConnection::connect_with(&options).await.unwrap()
}

/// A run directory with that database.
async fn restored() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut connection = raw(dir.path()).await;
    sqlx::raw_sql(DATABASE)
        .execute(&mut connection)
        .await
        .unwrap();
    connection.close().await.unwrap();
    dir
}

#[tokio::test]
async fn a_database_of_today_is_read_whole() {
    let dir = restored().await;
    let status = Reader::open(dir.path())
        .await
        .unwrap()
        .status()
        .await
        .unwrap();
    assert_eq!(
        (status.cohort.as_str(), status.patients.len()),
        ("golden", 3)
    );
    let mut writer = Writer::open(dir.path()).await.unwrap();
    let loaded = writer.load(Extent::All).await.unwrap();
    let states: Vec<&Patient> = loaded.patients.iter().map(|(row, ..)| &row.state).collect();
    assert!(
        matches!(
            states[..],
            [
                Patient::Done,
                Patient::Failed { .. },
                Patient::Working { .. }
            ]
        ),
        "{states:?}"
    );
    let tasks: Vec<&Task> = loaded.tasks.iter().map(|row| &row.state).collect();
    assert!(
        matches!(
            tasks[..],
            [
                Task::Published { .. },
                Task::Failed { .. },
                Task::Attempting { .. }
            ]
        ),
        "{tasks:?}"
    );
    assert!(matches!(loaded.attempts[..], [ref a] if matches!(a.state, Attempt::Running { .. })));
    assert_eq!(
        (
            loaded.outbox.len(),
            loaded.jobs.len(),
            loaded.allotments.len()
        ),
        (1, 1, 1)
    );
    let history = Reader::open(dir.path())
        .await
        .unwrap()
        .history(None)
        .await
        .unwrap();
    assert_eq!(history.len(), 1);
}

#[tokio::test]
async fn versions_of_states_are_noted_and_later_ones_are_refused() {
    let dir = restored().await;
    Writer::open(dir.path())
        .await
        .unwrap()
        .close("none", 0)
        .await
        .unwrap();
    let mut connection = raw(dir.path()).await;
    let noted: String = sqlx::query_scalar("SELECT value FROM meta WHERE key = ?1")
        .bind(KEY)
        .fetch_one(&mut connection)
        .await
        .unwrap();
    let mut noted: Value = serde_json::from_str(&noted).unwrap();
    for format in STORED {
        assert_eq!(noted[format.name], format.version, "{}", format.name);
    }
    noted["task's state"] = 2.into();
    noted["of tomorrow"] = 7.into();
    sqlx::query("UPDATE meta SET value = ?2 WHERE key = ?1")
        .bind(KEY)
        .bind(noted.to_string())
        .execute(&mut connection)
        .await
        .unwrap();
    connection.close().await.unwrap();
    for error in [
        Writer::open(dir.path()).await.err(),
        Reader::open(dir.path()).await.err(),
    ] {
        let error = error.expect("refused");
        assert!(matches!(error, StoreError::Format(_)), "{error:?}");
        let text = error.to_string();
        assert!(
            text.contains("task's state of version 2, expected version 1 or earlier"),
            "{text}"
        );
    }
}

#[test]
fn what_columns_and_files_hold_is_read_as_it_was_written() {
    for format in ALL
        .iter()
        .filter(|format| format.golden.starts_with("coordinator/src/store/"))
    {
        if *format == formats::DATABASE {
            continue; // read above
        }
        let golden: Value = serde_json::from_str(&text(format)).unwrap();
        match *format {
            formats::ACTIONS => {
                let kinds = round::<Vec<Action>>(&golden)
                    .into_iter()
                    .map(|action| match action {
                        Action::Submit { .. } => 0,
                        Action::Stop { .. } => 1,
                        Action::SubmitJob { .. } => 2,
                        Action::FenceJob { .. } => 3,
                        Action::CancelJob { .. } => 4,
                        Action::WriteOverlay { .. } => 5,
                    });
                assert_eq!(kinds.collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
            }
            formats::JOB_BOOKS => {
                round::<JobSpec>(&golden["spec"]);
                round::<Vec<SeenElement>>(&golden["seen"]);
                round::<Allotment>(&golden["allotment"]);
                round::<ClusterReport>(&golden["report"]);
            }
            formats::LOCK => drop(round::<LockHolder>(&golden)),
            formats::LEASE => lease::tests::is_read_as_written(&golden),
            _ => panic!("nothing here reads {}", format.golden),
        }
    }
}
