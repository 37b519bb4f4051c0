//! The one writer: it loads the state of a run for a coordinator and commits batches of
//! transitions.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::status::PatientStatus;
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::patient::{Stage, Step};
use serde::de::DeserializeOwned;
use sqlx::query::Query;
use sqlx::sqlite::{Sqlite, SqliteArguments, SqliteConnection, SqliteQueryResult, SqliteRow};
use sqlx::{Connection as _, Row as _};

use super::attempts::AttemptRow;
use super::batch::{Batch, Statement};
use super::cluster_jobs::{Allotment, JobRow};
use super::creation::Pass;
use super::database::{DATABASE_FILE, SNAPSHOT_FILE};
use super::lease::Lease;
use super::outbox::Action;
use super::patience::Patience;
use super::patients::{PatientRow, PlanRow};
use super::tasks::{OutcomeRow, TaskRow};
use super::{
    StoreError, attempts, cluster_jobs, file_system, open, outbox, patients, revision, steps, tasks,
};
use crate::clock;

/// The writing end of a run's database. Its owner holds the run's lock or lease.
#[derive(Debug)]
pub struct Writer {
    file: PathBuf,
    connection: SqliteConnection,
    patience: Patience,
    lease: Option<Lease>,
    /// Name of the shared file system of the run; `None` on a local one.
    shared: Option<&'static str>,
}

/// Key of the run's folder among the store's single values.
pub(super) const RUN_DIR: &str = "run_dir";

/// Plans read at a time.
const GROUP: i64 = 512;

/// How much of the tasks is loaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// All columns.
    All,
    /// States of all tasks, and specifications of those that are not over. Most of a large run's
    /// bytes are outcomes that nothing asks for again; [`Writer::outcomes`] reads the others.
    States,
}

/// Content of the store when a coordinator begins.
#[derive(Debug, Default)]
pub struct Loaded {
    /// Name, description and other single values.
    pub meta: HashMap<String, String>,
    /// Patients with their plans and chains, in the cohort's order.
    pub patients: Vec<(PatientRow, PlanRow, Chain)>,
    /// Tasks of the run, settled or not.
    pub tasks: Vec<TaskRow>,
    /// Attempts that are not over.
    pub attempts: Vec<AttemptRow>,
    /// The present task of each step, by patient.
    pub steps: HashMap<i64, HashMap<Step, TaskKey>>,
    /// Actions that were decided and possibly not executed yet.
    pub outbox: Vec<(i64, Action)>,
    /// Jobs of a cluster that are not over.
    pub jobs: Vec<JobRow>,
    /// Allotments for patients' next jobs, by row id of the patient.
    pub allotments: HashMap<i64, Allotment>,
}

impl Writer {
    /// Opens the database of a run directory, or creates it.
    ///
    /// # Errors
    /// [`StoreError`] that names what is wrong with the file, which is then unchanged.
    pub async fn open(run_dir: &Path) -> Result<Self, StoreError> {
        Self::open_past(run_dir, Patience::default(), &|_| Ok(())).await
    }

    /// As [`Writer::open`].
    ///
    /// - `patience`: decides how long this writer waits while another program has locked the
    ///   database
    /// - `pass`: called at each instant of creation and conversion
    ///
    /// # Errors
    /// As [`Writer::open`], and [`StoreError::File`] with the error of `pass`.
    pub async fn open_past(
        run_dir: &Path,
        mut patience: Patience,
        pass: Pass<'_>,
    ) -> Result<Self, StoreError> {
        let shared = file_system::shared(run_dir);
        let file = run_dir.join(DATABASE_FILE);
        let mut wait = patience.wait_for(&file);
        let connection = loop {
            // A second try finds whatever the first one has done.
            match open::writable(run_dir, shared.is_some(), pass).await {
                Ok(connection) => break connection,
                Err(error) => wait.after(error).await?,
            }
        };
        Ok(Self {
            file,
            connection,
            patience,
            lease: None,
            shared,
        })
    }

    /// Content of the database of a run, read without writing to it; empty if there is no database.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn look(run_dir: &Path) -> Result<Loaded, StoreError> {
        let open::ReadOnly {
            connection, _copy, ..
        } = match open::readable(run_dir).await {
            Err(StoreError::Missing { .. }) => return Ok(Loaded::default()),
            opened => opened?,
        };
        Self {
            file: run_dir.join(DATABASE_FILE),
            connection,
            patience: Patience::default(),
            lease: None,
            shared: None,
        }
        .load(Extent::All)
        .await
    }

    /// From now on, commits only while this lease holds.
    pub fn under(&mut self, lease: Lease) {
        self.lease = Some(lease);
    }

    /// Name of the shared file system of the run; `None` on a local one.
    #[must_use]
    pub fn shared_file_system(&self) -> Option<&'static str> {
        self.shared
    }

    /// Copies the database for readers, by a rename, if the run lies on a shared file system, whose
    /// locks are not reliable.
    ///
    /// # Errors
    /// [`StoreError`] if the copy cannot be written.
    pub async fn publish_snapshot(&mut self) -> Result<(), StoreError> {
        if self.shared.is_none() {
            return Ok(());
        }
        let folder = self.file.parent().unwrap_or(&self.file);
        let snapshot = folder.join(SNAPSHOT_FILE);
        let mut wait = self.patience.wait_for(&self.file);
        loop {
            match open::copy_to(&mut self.connection, &snapshot).await {
                Ok(()) => return Ok(()),
                Err(error) => wait.after(error).await?,
            }
        }
    }

    /// Commits a batch as a whole or not at all.
    ///
    /// # Errors
    /// [`StoreError::Guard`] if another process changed a row, [`StoreError::LeaseLost`] without
    /// the lease, [`StoreError::DiskFull`] and other errors of SQLite.
    pub async fn commit(&mut self, batch: &mut Batch) -> Result<(), StoreError> {
        let statements = batch.statements();
        let mut wait = self.patience.wait_for(&self.file);
        loop {
            if let Some(lease) = &mut self.lease {
                lease.check(clock::now_ms())?;
            }
            match write_all(&mut self.connection, &self.file, &statements).await {
                Ok(()) => return Ok(()),
                Err(error) => wait.after(error).await?,
            }
        }
    }

    /// All single values.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn meta(&mut self) -> Result<HashMap<String, String>, StoreError> {
        let rows = self.rows("SELECT key, value FROM meta").await?;
        Ok(rows
            .into_iter()
            .map(|row| (row.get(0), row.get(1)))
            .collect())
    }

    /// Mark of the store's contents, as [`Reader::revision`](super::Reader::revision).
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn revision(&mut self) -> Result<String, StoreError> {
        Ok(revision::of_rows(&self.rows(revision::ROWS).await?))
    }

    /// Sets single values.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be written.
    pub async fn set_meta(&mut self, values: &[(&str, &str)]) -> Result<(), StoreError> {
        for (key, value) in values {
            self.write(|| sqlx::query("INSERT INTO meta (key, value) VALUES (?1, ?2) ON CONFLICT (key) DO UPDATE SET value = ?2 WHERE value <> ?2").bind(*key).bind(*value))
                .await?;
        }
        Ok(())
    }

    /// Notes the run's folder. If the run was moved or copied since it was last opened, specifications
    /// of tasks without an outcome name their files at the new place from now on.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read or written.
    pub async fn lies_in(&mut self, run_dir: &Path) -> Result<(), StoreError> {
        let here = run_dir.to_string_lossy();
        if let Some(before) = self.meta().await?.remove(RUN_DIR).filter(|at| *at != here) {
            let below = |folder: &str| {
                let text = serde_json::json!(format!("{folder}/")).to_string();
                format!("\"path\":{}", text.trim_end_matches('"'))
            };
            self.write(|| sqlx::query("UPDATE tasks SET spec = replace(spec, ?1, ?2) WHERE outcome IS NULL AND instr(spec, ?1)").bind(below(&before)).bind(below(&here)))
                .await?;
        }
        self.set_meta(&[(RUN_DIR, &here)]).await
    }

    /// Closes the allocations of earlier coordinators and opens one for this coordinator. Returns
    /// its row id.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be written.
    pub async fn open_allocation(
        &mut self,
        kind: &str,
        external_id: &str,
        host: &str,
        at_ms: i64,
    ) -> Result<i64, StoreError> {
        self.close_allocations(kind, at_ms).await?;
        // `RETURNING` is not used: a caller that stops reading after the one row does not see a
        // failure of the commit.
        let inserted = self
            .write(|| {
                sqlx::query(attempts::OPEN_ALLOCATION)
                    .bind(kind)
                    .bind(external_id)
                    .bind(host)
                    .bind(at_ms)
            })
            .await?;
        Ok(inserted.last_insert_rowid())
    }

    /// Row id of the one allocation for all jobs of a cluster. Each attempt's directory names its
    /// job.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read or written.
    pub async fn cluster_allocation(&mut self, host: &str, at_ms: i64) -> Result<i64, StoreError> {
        match self.rows(attempts::OPEN_CLUSTER).await?.first() {
            Some(row) => Ok(row.get(0)),
            None => self.open_allocation("slurm", "", host, at_ms).await,
        }
    }

    /// Closes the database but not the allocation, because jobs of a cluster live on.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be closed; what was committed stays.
    pub async fn close_file(mut self) -> Result<(), StoreError> {
        self.publish_snapshot().await?;
        open::close(self.connection, &self.file).await
    }

    /// Closes this coordinator's allocation and the database.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be written or closed; what was committed stays.
    pub async fn close(mut self, kind: &str, at_ms: i64) -> Result<(), StoreError> {
        let closed = self.close_allocations(kind, at_ms).await;
        self.publish_snapshot().await?;
        open::close(self.connection, &self.file).await?;
        closed
    }

    async fn close_allocations(&mut self, kind: &str, at_ms: i64) -> Result<(), StoreError> {
        let closed = self.write(|| {
            sqlx::query(attempts::CLOSE_ALLOCATIONS)
                .bind(at_ms)
                .bind(kind)
        });
        closed.await.map(|_| ())
    }

    /// Executes one statement, which is a transaction, when no other program has locked the
    /// database.
    async fn write<'q>(
        &mut self,
        statement: impl Fn() -> Query<'q, Sqlite, SqliteArguments>,
    ) -> Result<SqliteQueryResult, StoreError> {
        let mut wait = self.patience.wait_for(&self.file);
        loop {
            let done = statement().execute(&mut self.connection).await;
            let failed = |source| StoreError::from_sqlite(self.file.clone(), "writing", source);
            match done.map_err(failed) {
                Ok(done) => return Ok(done),
                Err(error) => wait.after(error).await?,
            }
        }
    }

    /// Limits the size of the database, as a full disk does.
    #[cfg(test)]
    pub(super) async fn limit_pages(&mut self, pages: u32) {
        let sql = sqlx::AssertSqlSafe(format!("PRAGMA max_page_count = {pages}"));
        sqlx::query(sql)
            .execute(&mut self.connection)
            .await
            .unwrap();
    }

    /// Loads what a coordinator needs.
    ///
    /// # Errors
    /// [`StoreError`] if the database or one of its columns cannot be read.
    pub async fn load(&mut self, extent: Extent) -> Result<Loaded, StoreError> {
        let mut loaded = Loaded {
            meta: self.meta().await?,
            ..Loaded::default()
        };
        let mut plans: HashMap<i64, (PlanRow, Chain)> = HashMap::new();
        let last = self.rows(patients::LAST_PLAN).await?;
        let last: i64 = last.first().map_or(0, |row| row.get(0));
        for from in (0..=last).step_by(GROUP as usize) {
            let group = || {
                sqlx::query(patients::SELECT_GROUP)
                    .bind(from)
                    .bind(from + GROUP - 1)
            };
            for row in self.rows_of(group).await? {
                let (patient_id, chain): (i64, String) = (row.get(0), row.get(5));
                let chain = parse(&chain, "plans", "chain", &patient_id)?;
                let plan = PlanRow {
                    patient_id,
                    given: row.get(1),
                    overrides: row.get(2),
                    carried: row.get(3),
                    plan: row.get(4),
                };
                plans.insert(patient_id, (plan, chain));
            }
        }
        for row in self.rows(patients::SELECT_ALL).await? {
            let patient = patient_row(&row)?;
            if let Some((plan, chain)) = plans.remove(&patient.id) {
                loaded.patients.push((patient, plan, chain));
            }
        }
        loaded.tasks = self.tasks(extent).await?;
        for row in self.rows(attempts::SELECT_AT_WORK).await? {
            let (task, state): (String, String) = (row.get(0), row.get(4));
            let state = parse(&state, "attempts", "state", &task)?;
            let (generation, directory, version) = (row.get(1), row.get(2), row.get(3));
            loaded.attempts.push(AttemptRow {
                task,
                generation,
                directory,
                version,
                state,
            });
        }
        for row in self.rows(steps::SELECT_PRESENT).await? {
            let (patient, steps): (i64, String) = (row.get(0), row.get(1));
            let steps: Vec<(Stage, u32, TaskKey)> = parse(&steps, "steps", "stage", &patient)?;
            let steps = steps
                .into_iter()
                .map(|(stage, number, task)| (Step { stage, number }, task));
            loaded.steps.insert(patient, steps.collect());
        }
        for row in self.rows(outbox::SELECT_PENDING).await? {
            let (id, action): (i64, String) = (row.get(0), row.get(1));
            loaded
                .outbox
                .push((id, parse(&action, "outbox", "action", &id)?));
        }
        for row in self.rows(cluster_jobs::SELECT_AT_WORK).await? {
            loaded.jobs.push(job_row(&row)?);
        }
        for row in self.rows(cluster_jobs::SELECT_ALLOTMENTS).await? {
            let (patient, allotment): (i64, String) = (row.get(0), row.get(1));
            loaded.allotments.insert(
                patient,
                parse(&allotment, "allotments", "allotment", &patient)?,
            );
        }
        Ok(loaded)
    }

    /// All tasks, read in groups: a row of its own costs more than its content.
    async fn tasks(&mut self, extent: Extent) -> Result<Vec<TaskRow>, StoreError> {
        let (sql, group) = match extent {
            Extent::States => (tasks::SELECT_STATES, 4096),
            Extent::All => (tasks::SELECT_ALL, 512),
        };
        let last = self.rows(tasks::LAST_ID).await?;
        let last: i64 = last.first().map_or(0, |row| row.get(0));
        let mut found = Vec::new();
        let mut from = 0;
        while from <= last {
            let to = from + group - 1;
            let rows = self
                .rows_of(|| sqlx::query(sql).bind(from).bind(to))
                .await?;
            for row in rows {
                let rows: String = row.get(0);
                found.extend(parse::<Vec<TaskRow>>(&rows, "tasks", "state", &"some row")?);
            }
            from = to + 1;
        }
        Ok(found)
    }

    /// Outcomes of these tasks, which [`Extent::States`] leaves in the store. Keys that the store
    /// does not have are left out.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn outcomes(&mut self, keys: &[TaskKey]) -> Result<Vec<OutcomeRow>, StoreError> {
        let mut found = Vec::with_capacity(keys.len());
        for keys in keys.chunks(1024) {
            let keys = serde_json::to_string(keys).expect("keys are JSON");
            let rows = self.rows_of(|| sqlx::query(tasks::SELECT_OUTCOMES).bind(keys.clone()));
            found.extend(rows.await?.iter().map(outcome_row));
        }
        Ok(found)
    }

    /// Outcomes of the first `n` published tasks of each of these kinds.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn first_outcomes(
        &mut self,
        kinds: &[String],
        n: u32,
    ) -> Result<Vec<OutcomeRow>, StoreError> {
        let mut found = Vec::new();
        for kind in kinds {
            let first = || {
                sqlx::query(tasks::SELECT_FIRST_OUTCOMES)
                    .bind(kind.clone())
                    .bind(n)
            };
            found.extend(self.rows_of(first).await?.iter().map(outcome_row));
        }
        Ok(found)
    }

    async fn rows(&mut self, sql: &'static str) -> Result<Vec<SqliteRow>, StoreError> {
        self.rows_of(|| sqlx::query(sql)).await
    }

    /// Rows of one statement, read when no other program has locked the database.
    async fn rows_of<'q>(
        &mut self,
        statement: impl Fn() -> Query<'q, Sqlite, SqliteArguments>,
    ) -> Result<Vec<SqliteRow>, StoreError> {
        let mut wait = self.patience.wait_for(&self.file);
        loop {
            let read = statement().fetch_all(&mut self.connection).await;
            let failed = |source| StoreError::from_sqlite(self.file.clone(), "reading", source);
            match read.map_err(failed) {
                Ok(rows) => return Ok(rows),
                Err(error) => wait.after(error).await?,
            }
        }
    }
}

fn outcome_row(row: &SqliteRow) -> OutcomeRow {
    OutcomeRow {
        key: row.get(0),
        kind: row.get(1),
        outcome: row.get(2),
    }
}

/// Executes these statements in one transaction.
async fn write_all(
    connection: &mut SqliteConnection,
    file: &Path,
    statements: &[Statement],
) -> Result<(), StoreError> {
    let failed = |source| StoreError::from_sqlite(file.to_owned(), "committing", source);
    let mut transaction = connection
        .begin_with("BEGIN IMMEDIATE")
        .await
        .map_err(failed)?;
    for statement in statements {
        let done = sqlx::query(statement.sql)
            .bind(&statement.json)
            .execute(&mut *transaction)
            .await
            .map_err(failed)?;
        statement.check(done.rows_affected())?;
    }
    transaction.commit().await.map_err(failed)
}

pub(super) fn parse<T: DeserializeOwned>(
    text: &str,
    table: &'static str,
    column: &'static str,
    row: &dyn std::fmt::Display,
) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|source| StoreError::Content {
        table,
        column,
        row: row.to_string(),
        source,
    })
}

pub(super) fn job_row(row: &SqliteRow) -> Result<JobRow, StoreError> {
    let name: String = row.get("name");
    let column = |column: &'static str| -> String { row.get(column) };
    let state: cardiotwin_workflow::cluster_job::ClusterJob =
        parse(&column("state"), "jobs", "state", &name)?;
    Ok(JobRow {
        version: row.get("version"),
        over: false,
        spec: parse(&column("spec"), "jobs", "spec", &name)?,
        seen: parse(&column("seen"), "jobs", "seen", &name)?,
        intended_ms: row.get("intended_ms"),
        state,
        name,
    })
}

pub(super) fn patient_row(row: &SqliteRow) -> Result<PatientRow, StoreError> {
    let patient: String = row.get("patient");
    let class: Option<String> = row.get("failure_class");
    let failure_class = class
        .map(|c| parse(&format!("\"{c}\""), "patients", "failure_class", &patient))
        .transpose()?;
    let (state, word): (String, String) = (row.get("state"), row.get("word"));
    let shown = parse(&format!("\"{word}\""), "patients", "word", &patient)?;
    let iteration: Option<u32> = row.get("iteration");
    Ok(PatientRow {
        id: row.get("id"),
        position: row.get("position"),
        active: row.get("active"),
        version: row.get("version"),
        state: parse(&state, "patients", "state", &patient)?,
        status: PatientStatus {
            patient,
            step: row.get("step"),
            state: shown,
            iteration: iteration.zip(row.get("max_iterations")),
            for_s: 0.0,
            step1_cost: row.get("step1_cost"),
            step1_quality: row.get("step1_quality"),
            step2_cost: row.get("step2_cost"),
            failure_class,
            note: row.get("note"),
        },
        since_ms: row.get("since_ms"),
    })
}
