//! Tables `attempts` (one try at a task) and `allocations` (what a scheduler gave for it).

use cardiotwin_workflow::attempt::Attempt;
use serde::Serialize;

/// A new row.
#[derive(Debug, Serialize)]
pub struct NewAttempt<'a> {
    /// The task.
    pub task: &'a str,
    /// Which try.
    pub generation: u32,
    /// Where it runs.
    pub allocation: i64,
    /// Relative to the run directory.
    pub directory: &'a str,
    /// First state.
    pub state: &'a Attempt,
    /// Its word.
    pub word: &'a str,
    /// Milliseconds since 1970.
    pub planned_ms: i64,
}

/// A changed row.
#[derive(Debug, Serialize)]
pub struct AttemptChange<'a> {
    /// The task.
    pub task: &'a str,
    /// Which try.
    pub generation: u32,
    /// The version that stands in the store.
    pub version: i64,
    /// The new state.
    pub state: &'a Attempt,
    /// Its word.
    pub word: &'a str,
    /// Whether it is over.
    pub over: bool,
    /// Process id or job id; absent: as it was.
    pub external_id: Option<&'a str>,
    /// Who claimed it, in JSON; absent: as it was.
    pub claim: Option<&'a str>,
    /// Milliseconds since 1970.
    pub ended_ms: Option<i64>,
}

/// A row as it was read.
#[derive(Debug, Clone)]
pub struct AttemptRow {
    /// The task.
    pub task: String,
    /// Which try.
    pub generation: u32,
    /// Relative to the run directory.
    pub directory: String,
    /// Guards updates.
    pub version: i64,
    /// Where it stands.
    pub state: Attempt,
}

pub(super) const INSERT: &str = "
INSERT INTO attempts (task, generation, allocation, directory, version, word, over, state, planned_ms)
SELECT value->>'task', value->>'generation', value->>'allocation', value->>'directory', 1, value->>'word', 0,
       value->'state', value->>'planned_ms'
FROM json_each(?1)";

pub(super) const UPDATE: &str = "
UPDATE attempts
SET version = attempts.version + 1, word = value->>'word', over = value->>'over', state = value->'state',
    external_id = coalesce(value->>'external_id', external_id), claim = coalesce(value->>'claim', claim),
    ended_ms = value->>'ended_ms'
FROM json_each(?1) AS new
WHERE attempts.task = (new.value->>'task') AND attempts.generation = (new.value->>'generation')
  AND attempts.version = (new.value->>'version')";

pub(super) const SELECT_AT_WORK: &str = "SELECT task, generation, directory, version, state FROM attempts WHERE over = 0 ORDER BY planned_ms, task";

pub(super) const SELECT_OF_PATIENT: &str = "
SELECT task, generation, directory, state, external_id, claim, planned_ms, ended_ms FROM attempts
WHERE task IN (SELECT task FROM steps WHERE patient_id = ?1) ORDER BY generation";

pub(super) const OPEN_ALLOCATION: &str = "
INSERT INTO allocations (kind, external_id, host, opened_ms) VALUES (?1, ?2, ?3, ?4)";

/// Also closes those whose coordinator could not: there is one writer, so none of them is alive.
pub(super) const CLOSE_ALLOCATIONS: &str =
    "UPDATE allocations SET closed_ms = ?1 WHERE closed_ms IS NULL AND kind = ?2";

pub(super) const OPEN_CLUSTER: &str =
    "SELECT id FROM allocations WHERE kind = 'slurm' AND closed_ms IS NULL ORDER BY id LIMIT 1";
