//! Table `tasks`: what is wanted, with its state and, once settled, the outcome that settled it.

use cardiotwin_workflow::task::Task;
use serde::{Deserialize, Serialize};

/// A new row.
#[derive(Debug, Serialize)]
pub struct NewTask<'a> {
    /// The key.
    pub key: &'a str,
    /// The kind.
    pub kind: &'a str,
    /// First state.
    pub state: &'a Task,
    /// Its word.
    pub word: &'a str,
    /// The specification in JSON.
    pub spec: &'a str,
}

/// A changed row.
#[derive(Debug, Serialize)]
pub struct TaskChange<'a> {
    /// The key.
    pub key: &'a str,
    /// The version that stands in the store.
    pub version: i64,
    /// The new state.
    pub state: &'a Task,
    /// Its word.
    pub word: &'a str,
    /// The outcome that settled it; absent: as it was.
    pub outcome: Option<&'a str>,
}

/// A row as it was read: a tuple in JSON.
#[derive(Debug, Clone, Deserialize)]
pub struct TaskRow {
    /// The key.
    pub key: String,
    /// The kind.
    pub kind: String,
    /// Guards updates.
    pub version: i64,
    /// Where it stands.
    pub state: Task,
    /// The specification in JSON.
    pub spec: String,
    /// The outcome in JSON.
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

pub(super) const SELECT_ALL: &str = "
SELECT json_group_array(json_array(key, kind, version, json(state), spec, outcome)) FROM tasks GROUP BY id / 512";
