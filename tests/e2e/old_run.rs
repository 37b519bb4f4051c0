//! Runs that the programs of commit 531ec84 made open, are shown as what they were, and continue.
//!
//! `tests/fixtures/run-of-531ec84/make.sh` made them: the databases of one finished run and of one whose coordinator and worker
//! were killed in step 2, as SQL.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;
use sqlx::Connection as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};

use super::support::{Cohort, published};

const PATIENT: &str = "01-CoA";

fn fixture(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/run-of-531ec84");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

fn database(cohort: &Cohort) -> PathBuf {
    cohort.run_dir().join("cardiotwin.db")
}

/// Does something with the run's database.
fn with_database<T>(cohort: &Cohort, act: impl AsyncFnOnce(&mut SqliteConnection) -> T) -> T {
    let options = SqliteConnectOptions::new()
        .filename(database(cohort))
        .create_if_missing(true)
        // The rows of a dump come table by table.
        .foreign_keys(false);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let mut connection = SqliteConnection::connect_with(&options).await.unwrap();
        let done = act(&mut connection).await;
        connection.close().await.unwrap();
        done
    })
}

/// The cohort next to the run that a file holds.
fn restored(name: &str) -> Cohort {
    let cohort = Cohort::quick_of(PATIENT);
    std::fs::create_dir_all(cohort.run_dir()).unwrap();
    let sql = fixture(name);
    with_database(&cohort, async |connection| {
        sqlx::raw_sql(sqlx::AssertSqlSafe(sql))
            .execute(connection)
            .await
            .unwrap();
    });
    cohort
}

/// Keys of all tasks of the run, with how often each was tried and what came of it.
fn tasks(cohort: &Cohort) -> BTreeSet<(String, i64, String)> {
    let select = "SELECT key, (SELECT count(*) FROM attempts WHERE task = key), word FROM tasks";
    with_database(cohort, async |connection| {
        let rows = sqlx::query_as(select).fetch_all(connection).await.unwrap();
        rows.into_iter().collect()
    })
}

fn is_published((_, _, word): &&(String, i64, String)) -> bool {
    word == "published"
}

#[test]
fn a_finished_run_is_shown_as_what_it_was() {
    let cohort = restored("finished.sql");
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["patients"][0]["state"], "done", "{status}");
    assert!(
        cohort
            .call(&["show", PATIENT])
            .expect(0)
            .out
            .contains("step-2")
    );
    let patient = cohort.patient(PATIENT);
    assert_eq!(patient["cell_fit"]["result"]["lambda_0"], 1.0);
    assert_eq!(patient["targets"]["result"]["lambda_max"], 1.0);
    let settings = &patient["plan"]["settings"];
    assert_eq!(settings["workflow"]["until"], "step2-verification");
    assert_eq!(settings["solver"]["cell_stretch"], "end-diastole");
    // Readers change nothing.
    assert!(!cohort.run_dir().join("cardiotwin.format-2.db").exists());
}

#[test]
fn a_finished_run_goes_on_with_another_version_where_that_is_said() {
    let cohort = restored("finished.sql");
    let before = tasks(&cohort);
    assert!(
        before.iter().filter(is_published).count() >= 5,
        "{before:?}"
    );
    let dry = cohort.call(&["run", "--dry-run"]).expect(0);
    assert!(dry.out.contains(PATIENT), "{dry:?}");
    let refused = cohort.call(&["run"]);
    assert_ne!(refused.code, 0);
    refused.complains_of(&["--adopt-version"]);
    cohort.call(&["run", "--adopt-version"]).expect(0);
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["patients"][0]["state"], "done", "{status}");
    // Other versions of the models make other tasks; those of before stay as they are, and none is tried again.
    let after = tasks(&cohort);
    assert!(
        before.is_subset(&after) && after.len() > before.len(),
        "{after:?}"
    );
    cohort.call(&["show", PATIENT]).expect(0);
    assert_eq!(
        cohort.patient(PATIENT)["plan"]["settings"]["solver"]["cell_stretch"],
        "unloaded"
    );
}

#[test]
fn a_killed_run_goes_on_to_its_end() {
    let cohort = restored("killed.sql");
    let status = cohort.call(&["status", "--json"]).json();
    assert_eq!(status["patients"][0]["state"], "running", "{status}");
    assert_eq!(status["patients"][0]["step"], "step-2", "{status}");
    let before = tasks(&cohort);
    cohort.call(&["run", "--adopt-version"]).expect(0);
    let after = tasks(&cohort);
    let finished: BTreeSet<_> = before.iter().filter(is_published).cloned().collect();
    assert!(
        finished.len() >= 3 && finished.is_subset(&after),
        "{after:?}"
    );
    let patient: Value = cohort.patient(PATIENT);
    assert!(
        published(&patient)
            .iter()
            .any(|(step, ..)| step == "verification")
    );
    // Nothing is left at work.
    let again = cohort.call(&["run"]).expect(0);
    assert_eq!(tasks(&cohort), after, "{again:?}");
}
