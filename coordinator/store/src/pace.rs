//! Pace of a run: the time that attempts took for finished patients, and so far for the others.

use sqlx::Row as _;
use sqlx::sqlite::SqliteConnection;

/// Time that a run's patients took.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pace {
    /// Time of all attempts for each patient that is done, ms.
    pub done_ms: Vec<i64>,
    /// Time of all attempts so far for each patient with work left, ms.
    pub open_ms: Vec<i64>,
    /// Number of attempts at work.
    pub n_at_work: usize,
}

const SPENT: &str = "
SELECT patients.word, coalesce(spent.ms, 0) FROM patients LEFT JOIN
    (SELECT own.patient_id AS id, sum(coalesce(attempts.ended_ms, ?1) - attempts.planned_ms) AS ms
     FROM (SELECT DISTINCT patient_id, task FROM steps) AS own JOIN attempts ON attempts.task = own.task
     GROUP BY own.patient_id) AS spent ON spent.id = patients.id
WHERE patients.active AND patients.word IN ('done', 'running', 'waiting', 'unknown')";

const AT_WORK: &str = "SELECT count(*) FROM attempts WHERE over = 0";

/// Reads the pace; attempts at work count up to `now_ms`, milliseconds since 1970.
///
/// # Errors
/// Errors of SQLite.
pub async fn read(connection: &mut SqliteConnection, now_ms: i64) -> Result<Pace, sqlx::Error> {
    let mut pace = Pace::default();
    for row in sqlx::query(SPENT)
        .bind(now_ms)
        .fetch_all(&mut *connection)
        .await?
    {
        let (word, ms): (String, i64) = (row.get(0), row.get(1));
        let of = if word == "done" {
            &mut pace.done_ms
        } else {
            &mut pace.open_ms
        };
        of.push(ms);
    }
    let n: i64 = sqlx::query_scalar(AT_WORK).fetch_one(connection).await?;
    pace.n_at_work = usize::try_from(n).unwrap_or(0);
    Ok(pace)
}
