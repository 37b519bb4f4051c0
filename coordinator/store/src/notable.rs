//! Conditions of a run that operators are notified of, derived from the database: failed or stalled
//! patients, and the end of the run.

use std::collections::BTreeMap;

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::status::PatientState;
use sqlx::Row as _;
use sqlx::sqlite::{SqliteConnection, SqliteRow};

use super::screen::state_of;

/// Notable conditions of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Notable {
    /// Name of the cohort.
    pub cohort: String,
    /// Number of patients by state.
    pub counts: BTreeMap<PatientState, u64>,
    /// Failed or stalled patients.
    pub patients: Vec<NotablePatient>,
    /// Time since which every patient is over, milliseconds since 1970; `None` if one is not.
    pub over_since_ms: Option<i64>,
}

/// A patient that failed or stalled.
#[derive(Debug, Clone, PartialEq)]
pub struct NotablePatient {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Step at which it is.
    pub step: String,
    /// Whether a failure holds the patient; otherwise its step 1 stalled.
    pub failed: bool,
    /// Class of the failure; `None` for a stalled patient.
    pub class: Option<FailureClass>,
    /// Mark of this occurrence. A failure after a retry has another mark; the same failure, seen
    /// again, has the same mark.
    pub mark: String,
}

const COUNTS: &str =
    "SELECT word, count(*), max(since_ms) FROM patients WHERE active GROUP BY word";

const FAILED: &str = "SELECT patient, step, failure_class, since_ms FROM patients WHERE active AND word = 'failed' ORDER BY position";

const STALLED: &str = "SELECT patient, step, step1_quality, step1_cost FROM patients
                       WHERE active AND step1_quality LIKE 'stalled%' ORDER BY position";

/// Reads the conditions; the cohort's name is left empty.
///
/// # Errors
/// Errors of SQLite.
pub async fn read(connection: &mut SqliteConnection) -> Result<Notable, sqlx::Error> {
    let mut notable = Notable::default();
    let (mut over, mut since_ms) = (true, 0);
    for row in sqlx::query(COUNTS).fetch_all(&mut *connection).await? {
        let state = state_of(&row)?;
        over &= state.is_over();
        since_ms = since_ms.max(row.get::<i64, _>(2));
        notable
            .counts
            .insert(state, u64::try_from(row.get::<i64, _>(1)).unwrap_or(0));
    }
    notable.over_since_ms = (over && !notable.counts.is_empty()).then_some(since_ms);
    let failed = |row: SqliteRow| {
        let class: Option<String> = row.get(2);
        NotablePatient {
            patient: row.get(0),
            step: row.get(1),
            failed: true,
            class: class.and_then(|class| serde_json::from_value(class.into()).ok()),
            mark: row.get::<i64, _>(3).to_string(),
        }
    };
    notable.patients.extend(
        sqlx::query(FAILED)
            .fetch_all(&mut *connection)
            .await?
            .into_iter()
            .map(failed),
    );
    let stalled = |row: SqliteRow| {
        let (quality, cost): (String, Option<f64>) = (row.get(2), row.get(3));
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let quality: String = quality.chars().map(plain).take(60).collect();
        let mark = format!("{quality}-{:016x}", cost.unwrap_or_default().to_bits());
        NotablePatient {
            patient: row.get(0),
            step: row.get(1),
            failed: false,
            class: None,
            mark,
        }
    };
    notable.patients.extend(
        sqlx::query(STALLED)
            .fetch_all(connection)
            .await?
            .into_iter()
            .map(stalled),
    );
    Ok(notable)
}
