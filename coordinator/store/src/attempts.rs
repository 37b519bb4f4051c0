//! Tables `attempts` (tries at tasks) and `allocations` (resources that a scheduler gave for them).

use cardiotwin_workflow::attempt::Attempt;
use serde::Serialize;

/// A new row of `attempts`.
#[derive(Debug, Serialize)]
pub struct NewAttempt<'a> {
    /// Key of the task.
    pub task: &'a str,
    /// Generation of the attempt, from 1.
    pub generation: u32,
    /// Row id of its allocation.
    pub allocation: i64,
    /// Directory, relative to the run directory.
    pub directory: &'a str,
    /// State at the attempt's beginning.
    pub state: &'a Attempt,
    /// Name of the state.
    pub word: &'a str,
    /// Time of planning, milliseconds since 1970.
    pub planned_ms: i64,
}

/// A changed row of `attempts`.
#[derive(Debug, Serialize)]
pub struct AttemptChange<'a> {
    /// Key of the task.
    pub task: &'a str,
    /// Generation of the attempt.
    pub generation: u32,
    /// Version of the row in the store before the change.
    pub version: i64,
    /// State after the change.
    pub state: &'a Attempt,
    /// Name of the new state.
    pub word: &'a str,
    /// Whether the attempt is over.
    pub over: bool,
    /// Process id or job id; `None` keeps the stored one.
    pub external_id: Option<&'a str>,
    /// Claim of the worker as JSON; `None` keeps the stored one.
    pub claim: Option<&'a str>,
    /// Time of the end, milliseconds since 1970; `None` if it is not over.
    pub ended_ms: Option<i64>,
}

/// A row of `attempts` as read.
#[derive(Debug, Clone)]
pub struct AttemptRow {
    /// Key of the task.
    pub task: String,
    /// Generation of the attempt.
    pub generation: u32,
    /// Directory, relative to the run directory.
    pub directory: String,
    /// Version of the row, which guards updates.
    pub version: i64,
    /// State of the attempt.
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

/// Also closes allocations whose coordinator died: there is one writer, so they are out of use.
pub(super) const CLOSE_ALLOCATIONS: &str =
    "UPDATE allocations SET closed_ms = ?1 WHERE closed_ms IS NULL AND kind = ?2";

pub(super) const OPEN_CLUSTER: &str =
    "SELECT id FROM allocations WHERE kind = 'slurm' AND closed_ms IS NULL ORDER BY id LIMIT 1";
