//! Views of the store beyond the schemas' records: history, attempts, explanations.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::formats::CLAIM;
use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::progress::Claim;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_workflow::attempt::Attempt;
use cardiotwin_workflow::patient::Step;
use cardiotwin_workflow::task::Task;
use serde::{Serialize, Serializer};
use sqlx::Row as _;
use sqlx::sqlite::SqliteRow;

use super::StoreError;
use super::writer::parse;
use crate::clock;

/// An event of the append-only log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EventRecord {
    /// Position in the log.
    pub sequence: i64,
    /// Time, UTC, RFC 3339.
    pub at: String,
    /// State machine: `patient`, `task`, `attempt` or `job`.
    pub machine: String,
    /// Patient whose chain the event belongs to; `None` for the other machines.
    pub patient: Option<PatientId>,
    /// Key of the task; `None` for events of patients and jobs.
    pub task: Option<TaskKey>,
    /// Generation of the attempt; `None` for the other machines.
    pub generation: Option<u32>,
    /// The event as it was fed to the machine.
    pub event: serde_json::Value,
}

/// An attempt at one of a patient's tasks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AttemptRecord {
    /// Step of the chain, such as `step-1 iteration 3`.
    pub step: String,
    /// Key of the task.
    pub task: TaskKey,
    /// Generation of the attempt, from 1.
    pub generation: u32,
    /// State of the attempt.
    pub state: Attempt,
    /// Absolute directory, with `stderr.log`, `progress.jsonl` and `outcome.json`.
    pub directory: PathBuf,
    /// Process id or job id; `None` if it is unknown.
    pub external_id: Option<String>,
    /// Claim of the worker, as far as the coordinator has seen it.
    pub claim: Option<Claim>,
    /// Time of planning, UTC, RFC 3339.
    pub planned: String,
    /// Time of the end, UTC, RFC 3339; `None` if it is not over.
    pub ended: Option<String>,
}

/// Explanation of the present task of a step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepExplanation {
    /// Step of the chain, such as `step-1 iteration 3`.
    pub step: String,
    /// Key of the present task.
    pub task: TaskKey,
    /// State of the task, written as its name: `open`, `attempting`, `published` or `failed`.
    #[serde(serialize_with = "word_of")]
    pub state: Task,
    /// Number of attempts so far.
    pub generations: u32,
    /// Time since which this is the task of the step, UTC, RFC 3339.
    pub since: String,
    /// Key of the previous task of the step; `None` for the first.
    pub previous: Option<TaskKey>,
    /// Differences from the previous task, leaf by leaf; empty for the first.
    pub changes: Vec<LeafChange>,
    /// Other patients of this run that share the task.
    pub shared_with: Vec<PatientId>,
}

fn word_of<S: Serializer>(state: &Task, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(state.word())
}

/// A changed value of a task's canonical specification.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LeafChange {
    /// Path of the value, such as `contraction.parameters.Smax_ref_kPa`.
    pub path: String,
    /// Previous value; `None` if there was none.
    pub old: Option<serde_json::Value>,
    /// Present value; `None` if there is none.
    pub new: Option<serde_json::Value>,
}

/// Compares a step's present task with the previous one. `rows` are the present and former tasks of
/// the step, oldest first.
pub(super) fn explanation(
    step: Step,
    rows: &[SqliteRow],
    shared: &HashMap<String, Vec<PatientId>>,
) -> Result<StepExplanation, StoreError> {
    let spec = |row: &SqliteRow| -> Result<serde_json::Value, StoreError> {
        let (task, text): (String, String) = (row.get("task"), row.get("spec"));
        let spec: TaskSpec = parse(&text, "tasks", "spec", &task)?;
        parse(&spec.canonical(), "tasks", "spec", &task)
    };
    let present = &rows[rows.len() - 1];
    let (task, state): (String, String) = (present.get("task"), present.get("state"));
    let state: Task = parse(&state, "tasks", "state", &task)?;
    let previous = rows[..rows.len() - 1].last();
    Ok(StepExplanation {
        step: step.to_string(),
        generations: state.generation(),
        state,
        since: clock::utc_text(present.get("at_ms")),
        previous: previous.map(|row| TaskKey(row.get("task"))),
        changes: match previous {
            Some(previous) => leaf_changes(&spec(previous)?, &spec(present)?),
            None => Vec::new(),
        },
        shared_with: shared.get(&task).cloned().unwrap_or_default(),
        task: TaskKey(task),
    })
}

/// A row of `attempts`, for people.
pub(super) fn attempt(
    step: Step,
    row: &SqliteRow,
    run_dir: &Path,
) -> Result<AttemptRecord, StoreError> {
    let (task, state): (String, String) = (row.get("task"), row.get("state"));
    let claim: Option<String> = row.get("claim");
    let directory: String = row.get("directory");
    Ok(AttemptRecord {
        step: step.to_string(),
        generation: row.get("generation"),
        state: parse(&state, "attempts", "state", &task)?,
        directory: run_dir.join(directory),
        external_id: row.get("external_id"),
        claim: claim
            .map(|text| CLAIM.read(&"attempts.claim", text.as_bytes()))
            .transpose()?,
        planned: clock::utc_text(row.get("planned_ms")),
        ended: row.get::<Option<i64>, _>("ended_ms").map(clock::utc_text),
        task: TaskKey(task),
    })
}

impl LeafChange {
    /// Path, old and new value in a line.
    #[must_use]
    pub fn words(&self) -> String {
        let value = |value: &Option<serde_json::Value>| {
            value
                .as_ref()
                .map_or("absent".to_owned(), ToString::to_string)
        };
        format!(
            "{}: {} -> {}",
            self.path,
            value(&self.old),
            value(&self.new)
        )
    }
}

/// Leaves that differ between two JSON values, in the order of their paths.
#[must_use]
pub fn leaf_changes(old: &serde_json::Value, new: &serde_json::Value) -> Vec<LeafChange> {
    let mut changes = Vec::new();
    compare(String::new(), Some(old), Some(new), &mut changes);
    changes
}

fn compare(
    path: String,
    old: Option<&serde_json::Value>,
    new: Option<&serde_json::Value>,
    changes: &mut Vec<LeafChange>,
) {
    use serde_json::Value;
    let child = |key: &str| {
        if path.is_empty() {
            key.to_owned()
        } else {
            format!("{path}.{key}")
        }
    };
    match (old, new) {
        (old, new) if old == new => {}
        (Some(Value::Object(a)), Some(Value::Object(b))) => {
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                compare(child(key), a.get(key), b.get(key), changes);
            }
        }
        (Some(Value::Array(a)), Some(Value::Array(b))) => {
            for i in 0..a.len().max(b.len()) {
                compare(format!("{path}[{i}]"), a.get(i), b.get(i), changes);
            }
        }
        (old, new) => changes.push(LeafChange {
            path,
            old: old.cloned(),
            new: new.cloned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn only_leaves_that_differ_are_named_with_both_values() {
        let old = json!({"a": {"b": 1, "c": [1, 2]}, "same": true, "gone": 3});
        let new = json!({"a": {"b": 2, "c": [1, 5]}, "same": true, "come": 4});
        let named: Vec<_> = leaf_changes(&old, &new)
            .into_iter()
            .map(|c| {
                (
                    c.path,
                    c.old.map(|v| v.to_string()),
                    c.new.map(|v| v.to_string()),
                )
            })
            .collect();
        let text = |v: &str| Some(v.to_owned());
        assert_eq!(
            named,
            [
                ("a.b".to_owned(), text("1"), text("2")),
                ("a.c[1]".to_owned(), text("2"), text("5")),
                ("come".to_owned(), None, text("4")),
                ("gone".to_owned(), text("3"), None),
            ]
        );
    }
}
