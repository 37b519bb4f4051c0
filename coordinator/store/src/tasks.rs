//! Table `tasks`: wanted results, with their states and the outcomes that settled them.

use cardiotwin_workflow::task::Task;
use serde::{Deserialize, Serialize};

/// A new row of `tasks`.
#[derive(Debug, Serialize)]
pub struct NewTask<'a> {
    /// Key of the task.
    pub key: &'a str,
    /// Kind of the task.
    pub kind: &'a str,
    /// State at the task's beginning.
    pub state: &'a Task,
    /// Name of the state.
    pub word: &'a str,
    /// Specification from which a worker computes the result, as JSON.
    pub spec: &'a str,
}

/// A changed row of `tasks`.
#[derive(Debug, Serialize)]
pub struct TaskChange<'a> {
    /// Key of the task.
    pub key: &'a str,
    /// Version of the row in the store before the change.
    pub version: i64,
    /// State after the change.
    pub state: &'a Task,
    /// Name of the new state.
    pub word: &'a str,
    /// Outcome that settled the task, as JSON; `None` keeps the stored one.
    pub outcome: Option<&'a str>,
}

/// A row of `tasks` as read from a JSON tuple.
#[derive(Debug, Clone, Deserialize)]
pub struct TaskRow {
    /// Key of the task.
    pub key: String,
    /// Kind of the task.
    pub kind: String,
    /// Version of the row, which guards updates.
    pub version: i64,
    /// State of the task.
    pub state: Task,
    /// Specification from which a worker computes the result, as JSON; `None` if the task is over
    /// and only its state was loaded.
    pub spec: Option<String>,
    /// Outcome that settled the task, as JSON; `None` if it is not settled by one, or was not loaded.
    pub outcome: Option<String>,
    /// Whether the store has an outcome.
    pub has_outcome: bool,
}

/// Outcome of a task, read after the rest of its row.
#[derive(Debug, Clone)]
pub struct OutcomeRow {
    /// Key of the task.
    pub key: String,
    /// Kind of the task.
    pub kind: String,
    /// Outcome that settled the task, as JSON; `None` if it is not settled by one.
    pub outcome: Option<String>,
}

pub(super) const INSERT: &str = "
INSERT INTO tasks (key, kind, version, word, state, spec)
SELECT value->>'key', value->>'kind', 1, value->>'word', value->'state', value->>'spec' FROM json_each(?1)";

pub(super) const UPDATE: &str = "
UPDATE tasks
SET version = tasks.version + 1, word = value->>'word', state = value->'state',
    outcome = coalesce(value->>'outcome', outcome)
FROM json_each(?1) AS new
WHERE tasks.key = (new.value->>'key') AND tasks.version = (new.value->>'version')";

/// Rows whose ids are in a range, without specifications and outcomes of tasks that are over.
pub(super) const SELECT_STATES: &str = "
SELECT json_group_array(json_array(key, kind, version, json(state),
    CASE WHEN word IN ('published', 'failed') THEN NULL ELSE spec END, NULL, json(iif(outcome IS NULL, 'false', 'true'))))
FROM tasks WHERE id BETWEEN ?1 AND ?2";

/// Rows whose ids are in a range, with all columns.
pub(super) const SELECT_ALL: &str = "
SELECT json_group_array(json_array(key, kind, version, json(state), spec, outcome,
    json(iif(outcome IS NULL, 'false', 'true'))))
FROM tasks WHERE id BETWEEN ?1 AND ?2";

pub(super) const LAST_ID: &str = "SELECT coalesce(max(id), 0) FROM tasks";

/// Outcomes of the tasks whose keys are in a JSON array.
pub(super) const SELECT_OUTCOMES: &str = "
SELECT key, kind, outcome FROM tasks WHERE key IN (SELECT value FROM json_each(?1))";

/// Outcomes of the first published tasks of a kind.
pub(super) const SELECT_FIRST_OUTCOMES: &str = "
SELECT key, kind, outcome FROM tasks WHERE word = 'published' AND kind = ?1 ORDER BY id LIMIT ?2";
