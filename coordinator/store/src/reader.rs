//! Reading of a run without disturbing its writer.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::failure::Failure;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::outcome::{Ending, TaskOutcome, TaskResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::status::{
    ClusterStatus, LearnedStatus, PatientStatus, RefusedPatient, Status,
};
use cardiotwin_workflow::chain::Chain;
use cardiotwin_workflow::patient::{Patient, Stage, Step};
use sqlx::Row as _;
use sqlx::query::Query;
use sqlx::sqlite::{Sqlite, SqliteArguments, SqliteRow};
use tokio::sync::Mutex;

use super::before::{self, Was};
use super::chosen::{CHOSEN, Chosen};
use super::cluster_jobs::{self, Allotment, ClusterReport, JobRecord, JobRow, REPORT};
use super::database::{DATABASE_FILE, SNAPSHOT_FILE, VERSION};
use super::job_costs::{self, JobCosts};
use super::notable::Notable;
use super::open::ReadOnly;
use super::pace::{self, Pace};
use super::patients::{PatientRow, REFUSED};
use super::pilots::{PILOTS, Pilots};
use super::record::{self, MemberRecord, Settled};
use super::view::{self, AttemptRecord, EventRecord, StepExplanation};
use super::writer::{parse, patient_row};
use super::{
    MovedCohort, StoreError, attempts, events, lease, lock, notable, open, patients, revision,
    screen, steps, writer,
};
use crate::clock;

/// A read-only view of a run's database. It works while a coordinator runs, and without
/// permission to write.
pub struct Reader {
    run_dir: PathBuf,
    database: Mutex<ReadOnly>,
}

const SETTLED: &str = "
SELECT tasks.key, tasks.state, tasks.outcome, attempts.directory
FROM tasks LEFT JOIN attempts ON attempts.task = tasks.key AND attempts.generation = (tasks.state->>'generation')
WHERE tasks.word IN ('published', 'failed')";

const HAS_LESSONS: &str = "SELECT 1 FROM meta WHERE key = 'lessons' AND value <> 'null'";

/// Outcome of the law that the first patient in the cohort's order has learned.
const LEARNED: &str = "
SELECT tasks.outcome
FROM patients JOIN plans ON plans.patient_id = patients.id JOIN tasks ON tasks.key = (plans.chain->>'law')
WHERE patients.active AND tasks.word = 'published'
ORDER BY patients.position LIMIT 1";

/// Settled tasks of the patients whose ids are in a JSON array.
const SETTLED_OF_GROUP: &str = "
SELECT tasks.key, tasks.state, tasks.outcome, attempts.directory
FROM tasks LEFT JOIN attempts ON attempts.task = tasks.key AND attempts.generation = (tasks.state->>'generation')
WHERE tasks.word IN ('published', 'failed')
AND tasks.key IN (SELECT task FROM steps WHERE patient_id IN (SELECT value FROM json_each(?1)))";

/// Plans of the patients whose ids are in a JSON array.
const PLANS_OF_GROUP: &str = "
SELECT patient_id, given, overrides, carried, plan, chain FROM plans WHERE patient_id IN (SELECT value FROM json_each(?1))";

/// Patients whose results are in memory at a time.
const GROUP: usize = 64;

const SETTLED_OF_PATIENT: &str = "
SELECT tasks.key, tasks.state, tasks.outcome, attempts.directory
FROM tasks LEFT JOIN attempts ON attempts.task = tasks.key AND attempts.generation = (tasks.state->>'generation')
WHERE tasks.word IN ('published', 'failed') AND tasks.key IN (SELECT task FROM steps WHERE patient_id = ?1)";

impl Reader {
    /// Opens the database of a run directory.
    ///
    /// # Errors
    /// [`StoreError`] that names what is wrong with the file.
    pub async fn open(run_dir: &Path) -> Result<Self, StoreError> {
        let run_dir = std::path::absolute(run_dir).unwrap_or_else(|_| run_dir.to_owned());
        let database = open::readable(&run_dir).await?;
        Ok(Self {
            run_dir,
            database: Mutex::new(database),
        })
    }

    /// Status of the run with every patient, failures first.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn status(&self) -> Result<Status, StoreError> {
        self.screen(usize::MAX).await
    }

    /// One screen of the status: all patients are counted, and the first `rows` are listed,
    /// failures first.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn screen(&self, rows: usize) -> Result<Status, StoreError> {
        self.screen_at(rows, clock::now_ms()).await
    }

    /// [`Reader::screen`] with durations up to `now_ms`, milliseconds since 1970.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn screen_at(&self, rows: usize, now_ms: i64) -> Result<Status, StoreError> {
        let read = screen::read(&mut self.database.lock().await.connection, rows, now_ms).await;
        let screen::Screen { counts, patients } = read.map_err(|source| {
            StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source)
        })?;
        Ok(Status {
            schema_version: formats::STATUS.version,
            cohort: self.meta("cohort").await?,
            as_of: clock::utc_text(now_ms),
            coordinator_running: self.is_driven(),
            counts,
            patients,
            refused: self.refused().await?,
            // Whoever has the cohort's files adds them.
            new_patients: Vec::new(),
            changed_patients: Vec::new(),
            learned: self.learned().await?,
            cluster: self.cluster(now_ms).await?,
        })
    }

    /// Whether a coordinator holds the run now.
    #[must_use]
    pub fn is_driven(&self) -> bool {
        lock::is_held(&self.run_dir) || lease::holder(&self.run_dir).is_some()
    }

    /// SQLite's mark of the database: it changes with each commit of another process, and costs no
    /// look at a table. `None` if this reader has a snapshot or a copy, which stands still.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn data_version(&self) -> Result<Option<i64>, StoreError> {
        let mut database = self.database.lock().await;
        if !database.live {
            return Ok(None);
        }
        let version = sqlx::query_scalar("PRAGMA data_version")
            .fetch_one(&mut database.connection)
            .await;
        version.map(Some).map_err(|source| {
            StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source)
        })
    }

    /// Files in the run directory that hold the database: itself, its log, and its snapshot.
    #[must_use]
    pub fn files(run_dir: &Path) -> [PathBuf; 3] {
        let log = format!("{DATABASE_FILE}-wal");
        [DATABASE_FILE, log.as_str(), SNAPSHOT_FILE].map(|name| run_dir.join(name))
    }

    /// Time that the patients took so far; attempts at work count up to `now_ms`, milliseconds
    /// since 1970.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn pace(&self, now_ms: i64) -> Result<Pace, StoreError> {
        let read = pace::read(&mut self.database.lock().await.connection, now_ms).await;
        read.map_err(|source| {
            StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source)
        })
    }

    /// Conditions of the run that operators are notified of.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn notable(&self) -> Result<Notable, StoreError> {
        let read = notable::read(&mut self.database.lock().await.connection).await;
        let read = read.map_err(|source| {
            StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source)
        })?;
        Ok(Notable {
            cohort: self.meta("cohort").await?,
            ..read
        })
    }

    /// Patients that the last run left out.
    async fn refused(&self) -> Result<Vec<RefusedPatient>, StoreError> {
        // Runs of earlier programs have no such entry.
        Ok(serde_json::from_str(&self.meta(REFUSED).await?).unwrap_or_default())
    }

    /// What pilots taught; `None` before a patient has learned from them.
    async fn learned(&self) -> Result<Option<LearnedStatus>, StoreError> {
        // Most runs have no pilots, and no further table is looked at for them.
        let pilots = serde_json::from_str::<Pilots>(&self.meta(PILOTS).await?);
        if pilots.is_ok_and(|pilots| pilots.names.is_empty()) || !self.has_lessons().await? {
            return Ok(None);
        }
        let rows = self.rows(LEARNED, None).await?;
        let Some(outcome) = rows.first().map(|row| row.get::<String, _>(0)) else {
            return Ok(None);
        };
        let outcome: TaskOutcome = formats::OUTCOME.read(&"tasks.outcome", outcome.as_bytes())?;
        let Ending::Succeeded { result } = outcome.ending else {
            return Ok(None);
        };
        let TaskResult::LearnLaw(result) = *result else {
            return Ok(None);
        };
        let errors = result.errors_mmhg();
        Ok(Some(LearnedStatus {
            organs: result.organs.iter().map(|o| o.patient.clone()).collect(),
            beats: result.n_beats() as u64,
            pressure_error_before_mmhg: errors.map(|(before, _)| before),
            pressure_error_after_mmhg: errors.map(|(_, after)| after),
            words: result.words(),
        }))
    }

    /// Whether all pilots have ended. The lessons themselves are large, and are not read.
    async fn has_lessons(&self) -> Result<bool, StoreError> {
        let rows = self.rows(HAS_LESSONS, None).await?;
        Ok(!rows.is_empty())
    }

    /// State of the cluster; `None` if the run never used one.
    async fn cluster(&self, now_ms: i64) -> Result<Option<ClusterStatus>, StoreError> {
        let Some(report) = self.cluster_report().await? else {
            return Ok(None);
        };
        let (jobs, names) = (self.job_rows().await?, self.names().await?);
        Ok(Some(cluster_jobs::status(&report, &jobs, &names, now_ms)))
    }

    /// Costs of all jobs; `None` if the run never used a cluster.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn job_costs(&self) -> Result<Option<JobCosts>, StoreError> {
        let Some(report) = self.cluster_report().await? else {
            return Ok(None);
        };
        let (jobs, names) = (self.job_rows().await?, self.names().await?);
        Ok(Some(job_costs::costs(
            &report,
            &jobs,
            &names,
            clock::now_ms(),
        )))
    }

    async fn cluster_report(&self) -> Result<Option<ClusterReport>, StoreError> {
        Ok(serde_json::from_str(&self.meta(REPORT).await?).ok())
    }

    async fn job_rows(&self) -> Result<Vec<JobRow>, StoreError> {
        let rows = self.rows(cluster_jobs::SELECT_ALL, None).await?;
        rows.iter().map(writer::job_row).collect()
    }

    /// Pseudonyms of all patients, by row id.
    async fn names(&self) -> Result<HashMap<i64, String>, StoreError> {
        let rows = self.rows("SELECT id, patient FROM patients", None).await?;
        Ok(rows
            .into_iter()
            .map(|row| (row.get(0), row.get(1)))
            .collect())
    }

    /// The record of the run that reports and exports read.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn record(&self) -> Result<RunRecord, StoreError> {
        let mut patients = Vec::new();
        let keep = |record| -> Result<(), StoreError> {
            patients.push(record);
            Ok(())
        };
        let run = self.each_record(keep).await?;
        Ok(RunRecord { patients, ..run })
    }

    /// As [`Reader::record`] without what only the patients' own pages show, so that thousands of
    /// patients fit in memory.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn overview(&self) -> Result<RunRecord, StoreError> {
        let mut patients = Vec::new();
        let keep = |record: PatientRecord| -> Result<(), StoreError> {
            patients.push(record::without_bulk(record));
            Ok(())
        };
        let run = self.each_record(keep).await?;
        Ok(RunRecord { patients, ..run })
    }

    /// Calls `take` with the record of each patient, in the cohort's order, and returns the record
    /// of the run without patients. Few records are in memory at a time.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read; errors of `take`.
    pub async fn each_record<E: From<StoreError>>(
        &self,
        mut take: impl FnMut(PatientRecord) -> Result<(), E>,
    ) -> Result<RunRecord, E> {
        // What is written while the record is read makes another revision.
        let revision = self.revision().await?;
        let now_ms = clock::now_ms();
        let moved = self.moved_cohort().await?;
        let mut rows = self.active_patients().await?.into_iter();
        loop {
            let group: Vec<PatientRow> = rows.by_ref().take(GROUP).collect();
            if group.is_empty() {
                break;
            }
            let ids: Vec<i64> = group.iter().map(|row| row.id).collect();
            let ids = serde_json::to_string(&ids).expect("numbers are JSON");
            let of_group = |sql: &'static str| sqlx::query(sql).bind(ids.clone());
            let settled = self.settled(of_group(SETTLED_OF_GROUP)).await?;
            let mut wide = HashMap::new();
            for row in self.fetch(of_group(PLANS_OF_GROUP)).await? {
                wide.insert(row.get::<i64, _>("patient_id"), row);
            }
            for row in group {
                if let Some(plan) = wide.get(&row.id) {
                    let id = row.id;
                    let record = patient_of(row, plan, moved.as_ref(), &settled, now_ms)?;
                    take(self.with_before(id, record, &settled).await?)?;
                }
            }
        }
        Ok(RunRecord {
            schema_version: formats::RUN_RECORD.version,
            cohort: self.meta("cohort").await?,
            description: self.meta("description").await?,
            run_directory: self.run_dir.clone(),
            as_of: clock::utc_text(now_ms),
            version: VERSION.to_owned(),
            revision,
            patients: Vec::new(),
            refused: self.refused().await?,
        })
    }

    /// Mark of the store's contents, as in [`RunRecord::revision`]: the last event of the machines, the
    /// versions of all patients' rows, and the cohort's own entries.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn revision(&self) -> Result<String, StoreError> {
        Ok(revision::of_rows(&self.rows(revision::ROWS, None).await?))
    }

    /// Elements of a sweep, in its order.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn members(&self) -> Result<Vec<MemberRecord>, StoreError> {
        let settled = self.settled(sqlx::query(SETTLED)).await?;
        let now_ms = clock::now_ms();
        let mut wide = HashMap::new();
        for row in self.rows(patients::SELECT_PLANS, None).await? {
            wide.insert(row.get::<i64, _>("patient_id"), row);
        }
        let moved = self.moved_cohort().await?;
        let rows = self.active_patients().await?;
        rows.into_iter()
            .filter_map(|row| Some((wide.get(&row.id)?, row)))
            .map(|(wide, row)| {
                let (plan, chain) = plan_and_chain(&row, wide, moved.as_ref())?;
                let failure = failure_of(&row);
                Ok(record::member(
                    plan,
                    status_of(row, now_ms),
                    failure,
                    &chain,
                    &settled,
                ))
            })
            .collect()
    }

    /// [`Reader::record`] for one patient.
    ///
    /// # Errors
    /// [`StoreError::NoPatient`] for an unknown patient; other [`StoreError`]s if the database
    /// cannot be read.
    pub async fn patient_record(&self, patient: &PatientId) -> Result<PatientRecord, StoreError> {
        let row = self.find(patient).await?;
        let settled = self
            .settled(sqlx::query(SETTLED_OF_PATIENT).bind(row.id))
            .await?;
        let (id, plan) = (row.id, self.plan_row(row.id).await?);
        let moved = self.moved_cohort().await?;
        let record = patient_of(row, &plan, moved.as_ref(), &settled, clock::now_ms())?;
        self.with_before(id, record, &settled).await
    }

    /// Adds the simulations before effects were accepted, if the plan has any effects.
    async fn with_before(
        &self,
        id: i64,
        mut record: PatientRecord,
        settled: &HashMap<TaskKey, Settled>,
    ) -> Result<PatientRecord, StoreError> {
        if record.plan.effects.is_empty() {
            return Ok(record);
        }
        let rows = self.rows(steps::SELECT_OF_PATIENT, Some(id)).await?;
        let was = |row: &SqliteRow| -> Result<Was, StoreError> {
            let (key, spec): (String, String) = (row.get("task"), row.get("spec"));
            Ok(Was {
                stage: step_of(row)?.stage,
                key: TaskKey(key),
                spec: serde_json::from_str(&spec).ok(),
            })
        };
        let history = rows.iter().map(was).collect::<Result<Vec<_>, _>>()?;
        let step0 = record.step0.as_ref().map(|step0| &step0.result);
        record.before = before::before(&record.plan, step0, &history, settled).map(Box::new);
        Ok(record)
    }

    /// Explanation of each of a patient's tasks, in the order of the chain: its key, and its
    /// changes against the previous task of the same step.
    ///
    /// # Errors
    /// As [`Reader::patient_record`].
    pub async fn explain(&self, patient: &PatientId) -> Result<Vec<StepExplanation>, StoreError> {
        let id = self.find(patient).await?.id;
        let mut shared: HashMap<String, Vec<PatientId>> = HashMap::new();
        for row in self.rows(steps::SELECT_SHARED, Some(id)).await? {
            shared
                .entry(row.get(0))
                .or_default()
                .push(PatientId(row.get(1)));
        }
        let mut by_step: std::collections::BTreeMap<Step, Vec<SqliteRow>> =
            std::collections::BTreeMap::new();
        for row in self.rows(steps::SELECT_OF_PATIENT, Some(id)).await? {
            by_step.entry(step_of(&row)?).or_default().push(row);
        }
        by_step
            .into_iter()
            .map(|(step, rows)| view::explanation(step, &rows, &shared))
            .collect()
    }

    /// The log of one patient and its tasks, or of all patients, oldest first.
    ///
    /// # Errors
    /// As [`Reader::patient_record`].
    pub async fn history(
        &self,
        patient: Option<&PatientId>,
    ) -> Result<Vec<EventRecord>, StoreError> {
        let rows = match patient {
            Some(patient) => {
                self.rows(
                    events::SELECT_OF_PATIENT,
                    Some(self.find(patient).await?.id),
                )
                .await?
            }
            None => self.rows(events::SELECT_ALL, None).await?,
        };
        rows.iter()
            .map(|row| {
                let (sequence, event): (i64, String) = (row.get("sequence"), row.get("event"));
                Ok(EventRecord {
                    sequence,
                    at: clock::utc_text(row.get("at_ms")),
                    machine: row.get("machine"),
                    patient: row.get::<Option<String>, _>("patient").map(PatientId),
                    task: row.get::<Option<String>, _>("task").map(TaskKey),
                    generation: row.get("generation"),
                    event: parse(&event, "events", "event", &sequence)?,
                })
            })
            .collect()
    }

    /// Every attempt at every task of a patient, in the order of the chain.
    ///
    /// # Errors
    /// As [`Reader::patient_record`].
    pub async fn attempts(&self, patient: &PatientId) -> Result<Vec<AttemptRecord>, StoreError> {
        let id = self.find(patient).await?.id;
        // A task that belonged to several steps over time is shown with the last one.
        let mut steps_of_tasks: HashMap<String, Step> = HashMap::new();
        for row in self.rows(steps::SELECT_OF_PATIENT, Some(id)).await? {
            steps_of_tasks.insert(row.get("task"), step_of(&row)?);
        }
        let mut found = Vec::new();
        for row in self.rows(attempts::SELECT_OF_PATIENT, Some(id)).await? {
            let task: String = row.get("task");
            if let Some(step) = steps_of_tasks.get(&task) {
                found.push((*step, view::attempt(*step, &row, &self.run_dir)?));
            }
        }
        found.sort_by_key(|(step, attempt)| (*step, attempt.generation));
        Ok(found.into_iter().map(|(_, attempt)| attempt).collect())
    }

    /// Jobs of a cluster that got a patient, oldest first, and the reason of the last
    /// repeat.
    ///
    /// # Errors
    /// As [`Reader::patient_record`].
    pub async fn jobs(&self, patient: &PatientId) -> Result<(Vec<JobRecord>, String), StoreError> {
        let id = self.find(patient).await?.id;
        let jobs = self.job_rows().await?;
        let mut why = String::new();
        for row in self.rows(cluster_jobs::SELECT_ALLOTMENTS, None).await? {
            if row.get::<i64, _>(0) == id {
                let allotment: Allotment = parse(row.get(1), "allotments", "allotment", &patient)?;
                why = allotment.why;
            }
        }
        Ok((cluster_jobs::of_patient(&jobs, id, &self.run_dir), why))
    }

    /// Settings that reruns changed for a patient: tables of `cohort.toml` that override every
    /// other layer.
    ///
    /// # Errors
    /// As [`Reader::patient_record`].
    pub async fn overrides(&self, patient: &PatientId) -> Result<SettingsLayer, StoreError> {
        let id = self.find(patient).await?.id;
        let text: String = self.plan_row(id).await?.get("overrides");
        parse(&text, "plans", "overrides", &patient)
    }

    /// Choice of the last `run`; `None` before the first one that keeps it.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn chosen(&self) -> Result<Option<Chosen>, StoreError> {
        let text = self.meta(CHOSEN).await?;
        if text.is_empty() {
            return Ok(None);
        }
        parse(&text, "meta", "value", &CHOSEN).map(Some)
    }

    /// Absolute path of the run directory.
    #[must_use]
    pub fn run_dir(&self) -> &Path {
        &self.run_dir
    }

    pub(super) async fn rows(
        &self,
        sql: &'static str,
        patient_id: Option<i64>,
    ) -> Result<Vec<SqliteRow>, StoreError> {
        let mut query = sqlx::query(sql);
        if let Some(id) = patient_id {
            query = query.bind(id);
        }
        self.fetch(query).await
    }

    /// Rows of a statement with its arguments.
    pub(super) async fn fetch(
        &self,
        query: Query<'_, Sqlite, SqliteArguments>,
    ) -> Result<Vec<SqliteRow>, StoreError> {
        let mut database = self.database.lock().await;
        query
            .fetch_all(&mut database.connection)
            .await
            .map_err(|source| {
                StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source)
            })
    }

    /// Folder of the cohort, as the last call that read it named it; empty for runs of programs that did not keep it.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn cohort_dir(&self) -> Result<std::path::PathBuf, StoreError> {
        Ok(self.meta("cohort_dir").await?.into())
    }

    /// The cohort's former and present folder, where the run lies in a cohort's folder that was copied
    /// or moved since the run last worked; `None` where the files lie as the run read them.
    ///
    /// # Errors
    /// [`StoreError`] if the database cannot be read.
    pub async fn moved_cohort(&self) -> Result<Option<MovedCohort>, StoreError> {
        let was = PathBuf::from(self.meta(writer::RUN_DIR).await?);
        Ok(MovedCohort::of(&was, &self.run_dir))
    }

    pub(super) async fn meta(&self, key: &'static str) -> Result<String, StoreError> {
        let mut database = self.database.lock().await;
        let value: Option<String> = sqlx::query_scalar("SELECT value FROM meta WHERE key = ?1")
            .bind(key)
            .fetch_optional(&mut database.connection)
            .await
            .map_err(|source| {
                StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source)
            })?;
        Ok(value.unwrap_or_default())
    }

    async fn active_patients(&self) -> Result<Vec<PatientRow>, StoreError> {
        let rows = self.rows(patients::SELECT_ALL, None).await?;
        let all = rows
            .iter()
            .map(patient_row)
            .collect::<Result<Vec<_>, _>>()?;
        Ok(all.into_iter().filter(|row| row.active).collect())
    }

    async fn find(&self, patient: &PatientId) -> Result<PatientRow, StoreError> {
        let all = self.active_patients().await?;
        let names: Vec<String> = all
            .iter()
            .take(20)
            .map(|row| row.status.patient.clone())
            .collect();
        let more = if all.len() > names.len() { ", …" } else { "" };
        all.into_iter()
            .find(|row| row.status.patient == patient.0)
            .ok_or_else(|| StoreError::NoPatient {
                patient: patient.clone(),
                known: names.join(", ") + more,
            })
    }

    async fn plan_row(&self, id: i64) -> Result<SqliteRow, StoreError> {
        let mut database = self.database.lock().await;
        sqlx::query("SELECT patient_id, given, overrides, carried, plan, chain FROM plans WHERE patient_id = ?1")
            .bind(id)
            .fetch_one(&mut database.connection)
            .await
            .map_err(|source| StoreError::from_sqlite(self.run_dir.join(DATABASE_FILE), "reading", source))
    }

    async fn settled(
        &self,
        query: Query<'_, Sqlite, SqliteArguments>,
    ) -> Result<HashMap<TaskKey, Settled>, StoreError> {
        self.fetch(query)
            .await?
            .iter()
            .map(|row| record::settled(row, &self.run_dir))
            .collect()
    }
}

fn status_of(row: PatientRow, now_ms: i64) -> PatientStatus {
    let for_s = (now_ms - row.since_ms).max(0) as f64 / 1000.0;
    PatientStatus {
        for_s,
        ..row.status
    }
}

fn step_of(row: &SqliteRow) -> Result<Step, StoreError> {
    let stage: String = row.get("stage");
    let stage: Stage = parse(&format!("\"{stage}\""), "steps", "stage", &stage)?;
    Ok(Step {
        stage,
        number: row.get("number"),
    })
}

fn patient_of(
    row: PatientRow,
    wide: &SqliteRow,
    moved: Option<&MovedCohort>,
    settled: &HashMap<TaskKey, Settled>,
    now_ms: i64,
) -> Result<PatientRecord, StoreError> {
    let (plan, chain) = plan_and_chain(&row, wide, moved)?;
    let failure = failure_of(&row);
    Ok(record::patient(
        plan,
        status_of(row, now_ms),
        failure,
        chain,
        settled,
    ))
}

fn plan_and_chain(
    row: &PatientRow,
    wide: &SqliteRow,
    moved: Option<&MovedCohort>,
) -> Result<(ResolvedPatient, Chain), StoreError> {
    let (plan, chain): (String, String) = (
        wide.get::<Option<String>, _>("plan")
            .unwrap_or_else(|| wide.get("given")),
        wide.get("chain"),
    );
    let plan = MovedCohort::plan(moved, plan);
    Ok((
        parse(&plan, "plans", "plan", &row.status.patient)?,
        parse(&chain, "plans", "chain", &row.status.patient)?,
    ))
}

fn failure_of(row: &PatientRow) -> Option<Failure> {
    match &row.state {
        Patient::Failed { failure, .. } => Some(failure.clone()),
        _ => None,
    }
}
