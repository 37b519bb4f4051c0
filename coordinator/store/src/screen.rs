//! Patients as `status` shows them. SQLite counts, orders and limits them and returns a single
//! text, so that a screen of a hundred thousand patients costs little more than a screen of a few.

use std::collections::BTreeMap;

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::status::{PatientState, PatientStatus};
use serde::Deserialize;
use sqlx::Row as _;
use sqlx::sqlite::{SqliteConnection, SqliteRow};

/// Number of patients by state, and the first rows.
pub struct Screen {
    /// Number of patients in each state.
    pub counts: BTreeMap<PatientState, u64>,
    /// Failed patients first, then unknown, running, waiting and cancelled ones, then the rest; in
    /// the cohort's order within each group.
    pub patients: Vec<PatientStatus>,
}

const COUNTS: &str = "SELECT word, count(*) FROM patients WHERE active GROUP BY word";

const FIRST: &str = "
SELECT json_group_array(json_array(patient, step, word, iteration, max_iterations, step1_cost, step1_quality, step2_cost,
                                   failure_class, note, since_ms))
FROM (SELECT * FROM patients WHERE active
      ORDER BY CASE word WHEN 'failed' THEN 0 WHEN 'unknown' THEN 1 WHEN 'running' THEN 2 WHEN 'waiting' THEN 3
                         WHEN 'cancelled' THEN 4 ELSE 5 END, position, id
      LIMIT ?1)";

/// A row of [`FIRST`].
#[derive(Deserialize)]
struct Shown(
    String,
    String,
    PatientState,
    Option<u32>,
    Option<u32>,
    Option<f64>,
    Option<String>,
    Option<f64>,
    Option<FailureClass>,
    String,
    i64,
);

/// State in the first column of a row.
///
/// # Errors
/// A decoding error for a name that no state has.
pub(super) fn state_of(row: &SqliteRow) -> Result<PatientState, sqlx::Error> {
    let name: String = row.try_get(0)?;
    PatientState::from_name(&name)
        .ok_or_else(|| sqlx::Error::Decode(format!("no patient is {name:?}").into()))
}

/// Reads the counts and at most `rows` of the patients.
///
/// # Errors
/// Errors of SQLite, or a decoding error if a row is not as expected.
pub async fn read(
    connection: &mut SqliteConnection,
    rows: usize,
    now_ms: i64,
) -> Result<Screen, sqlx::Error> {
    let counted = sqlx::query(COUNTS).fetch_all(&mut *connection).await?;
    let count = |row: &SqliteRow| {
        let n = u64::try_from(row.get::<i64, _>(1)).unwrap_or(0);
        Ok::<_, sqlx::Error>((state_of(row)?, n))
    };
    let counts = counted.iter().map(count).collect::<Result<_, _>>()?;
    let rows = i64::try_from(rows).unwrap_or(i64::MAX);
    let text: String = sqlx::query_scalar(FIRST)
        .bind(rows)
        .fetch_one(connection)
        .await?;
    let shown: Vec<Shown> =
        serde_json::from_str(&text).map_err(|error| sqlx::Error::Decode(error.into()))?;
    let patients = shown.into_iter().map(|row| PatientStatus {
        patient: row.0,
        step: row.1,
        state: row.2,
        iteration: row.3.zip(row.4),
        step1_cost: row.5,
        step1_quality: row.6,
        step2_cost: row.7,
        failure_class: row.8,
        note: row.9,
        for_s: (now_ms - row.10).max(0) as f64 / 1000.0,
    });
    Ok(Screen {
        counts,
        patients: patients.collect(),
    })
}
