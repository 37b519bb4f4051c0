//! Files that something else removed: a scratch file system that empties itself, or a person who
//! tidied up. A published task whose files are gone is computed again only if a task that is about
//! to begin reads them. Files that no task reads any more stay missing.

use std::path::{Path, PathBuf};

use cardiotwin_schemas::ids::{PatientId, TaskKey};
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_workflow::derivation::Next;
use cardiotwin_workflow::task::{Task, TaskEvent};
use serde_json::Value;

use super::Decider;
use crate::books::{ATTEMPTS, Books};
use crate::{EngineError, EngineEvent};

/// A task with this many attempts is not computed again by itself, even if its files are missing
/// each time. The task that reads them then reports the error.
const MOST_GENERATIONS: u32 = 10;

/// What became of the inputs of a patient's next task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Inputs {
    /// All are there, or nothing can make the missing ones.
    Settled,
    /// Published tasks were reopened, because their files are missing.
    Reopened,
    /// It is not known yet whether they exist.
    Unseen,
}

impl Decider {
    /// Reopens published tasks whose files are missing and are needed by a patient's next task.
    pub(super) fn open_purged(
        &mut self,
        books: &mut Books,
        i: usize,
        next: &Next,
    ) -> Result<Inputs, EngineError> {
        let Next::Run { step, key, spec } = next else {
            return Ok(Inputs::Settled);
        };
        // A task that is already running has read its inputs, or reports a missing one itself.
        if books
            .task(key)
            .is_some_and(|task| matches!(task.state, Task::Attempting { .. }))
        {
            return Ok(Inputs::Settled);
        }
        let Some(missing) = self.missing(inputs(spec)) else {
            return Ok(Inputs::Unseen);
        };
        let mut found = Inputs::Settled;
        for path in missing {
            let Some(made) = maker(books, &path) else {
                continue;
            };
            // Each task is reopened once per coordinator: a file that is still missing after that
            // was not purged.
            if books.tasks()[&made].state.generation() >= MOST_GENERATIONS
                || !self.remade.insert(made.clone())
            {
                continue;
            }
            books.task_event(&made, TaskEvent::Purged)?;
            found = Inputs::Reopened;
            let patient = PatientId(books.patient(i).row.status.patient.clone());
            let name = path
                .strip_prefix(books.run_dir())
                .unwrap_or(&path)
                .display();
            let text = format!("{patient}: {name} is gone, but {step} needs it: it is recomputed");
            self.events.push(EngineEvent::Request { text });
        }
        Ok(found)
    }
}

/// Every file that a specification names: each `path` next to a `sha256`, at any depth.
fn inputs(spec: &TaskSpec) -> Vec<PathBuf> {
    fn look(value: &Value, found: &mut Vec<PathBuf>) {
        match value {
            Value::Object(fields) => {
                if let (Some(Value::String(path)), Some(_)) =
                    (fields.get("path"), fields.get("sha256"))
                {
                    found.push(PathBuf::from(path));
                }
                fields.values().for_each(|value| look(value, found));
            }
            Value::Array(values) => values.iter().for_each(|value| look(value, found)),
            _ => {}
        }
    }
    if matches!(spec, TaskSpec::Noop(_)) {
        return Vec::new();
    }
    let mut found = Vec::new();
    look(
        &serde_json::to_value(spec).expect("a task's spec is JSON"),
        &mut found,
    );
    found
}

/// The published task whose present attempt wrote a file of this run.
fn maker(books: &Books, path: &Path) -> Option<TaskKey> {
    let inside = path.strip_prefix(books.run_dir().join(ATTEMPTS)).ok()?;
    let attempt = inside.components().nth(1)?.as_os_str().to_str()?;
    let (prefix, generation) = attempt.rsplit_once("-g")?;
    let generation: u32 = generation.parse().ok()?;
    let made =
        |state: &Task| matches!(state, Task::Published { generation: by } if *by == generation);
    let mut tasks = books
        .tasks()
        .iter()
        .filter(|(key, task)| key.as_str().starts_with(prefix) && made(&task.state));
    tasks.next().map(|(key, _)| key.clone())
}
