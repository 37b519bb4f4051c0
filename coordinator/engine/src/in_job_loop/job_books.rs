//! The driver's books: tasks and their outcomes, kept in memory alone.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::allocation::{JobOrder, KnownTaskState};
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, TaskKey};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_workflow::attempt::AttemptEnding;
use cardiotwin_workflow::derivation::Settled;
use cardiotwin_workflow::task::{Task, TaskEvent};

use crate::books::{attempt_directory, settled};
use crate::dispatch::{self, AttemptFindings};

/// States and outcomes of tasks, as far as a driver knows them.
#[derive(Debug, Default)]
pub struct JobBooks {
    run_dir: PathBuf,
    tasks: HashMap<TaskKey, Entry>,
}

#[derive(Debug, Default)]
struct Entry {
    state: Task,
    outcome: Option<TaskOutcome>,
    kind: String,
}

impl JobBooks {
    pub fn new(order: &JobOrder) -> Self {
        let mut ledger = Self {
            run_dir: order.run_dir.clone(),
            tasks: HashMap::new(),
        };
        for known in order.patients.iter().flat_map(|patient| &patient.known) {
            let generation = known.generation;
            let (state, outcome) = match &known.standing {
                KnownTaskState::Open => (
                    Task::Open {
                        generation,
                        site_failures: 0,
                    },
                    None,
                ),
                KnownTaskState::Failed(failure) => (
                    Task::Failed {
                        generation,
                        failure: failure.clone(),
                    },
                    None,
                ),
                KnownTaskState::Published => {
                    match read_outcome(&ledger.run_dir, &known.task, generation) {
                        Some(outcome) => (Task::Published { generation }, Some(outcome)),
                        // The files of the result are gone, so it is computed once more under a further
                        // generation.
                        None => (
                            Task::Open {
                                generation,
                                site_failures: 0,
                            },
                            None,
                        ),
                    }
                }
            };
            ledger.tasks.insert(
                known.task.clone(),
                Entry {
                    state,
                    outcome,
                    kind: String::new(),
                },
            );
        }
        ledger
    }

    pub fn settled(&self, key: &TaskKey) -> Option<Settled<'_>> {
        let entry = self.tasks.get(key)?;
        settled(key, &entry.state, || entry.outcome.as_ref(), &self.run_dir)
    }

    pub fn generation(&self, key: &TaskKey) -> u32 {
        self.tasks
            .get(key)
            .map_or(0, |entry| entry.state.generation())
    }

    pub fn kind(&self, key: &TaskKey) -> String {
        self.tasks
            .get(key)
            .map(|entry| entry.kind.clone())
            .unwrap_or_default()
    }

    /// Longest wall time among the outcomes of this kind of task, s.
    pub fn longest_s(&self, kind: &str) -> f64 {
        let outcomes = self
            .tasks
            .values()
            .filter(|entry| entry.kind == kind)
            .filter_map(|entry| entry.outcome.as_ref());
        outcomes
            .map(|outcome| outcome.provenance.wall_s)
            .fold(0.0, f64::max)
    }

    pub fn start(&mut self, attempt: &AttemptId, kind: &str) {
        let entry = self.tasks.entry(attempt.task.clone()).or_default();
        kind.clone_into(&mut entry.kind);
        entry.state = Task::Attempting {
            generation: attempt.generation,
            site_failures: 0,
        };
    }

    /// Skips a generation that another, revoked job had begun.
    pub fn skip(&mut self, key: &TaskKey) {
        let generation = self.generation(key) + 1;
        self.tasks.entry(key.clone()).or_default().state = Task::Open {
            generation,
            site_failures: 0,
        };
    }

    pub fn ended(
        &mut self,
        attempt: &AttemptId,
        how: AttemptEnding,
        outcome: Option<TaskOutcome>,
    ) -> bool {
        let Some(entry) = self.tasks.get_mut(&attempt.task) else {
            return false;
        };
        // The coordinator decides whether a site failure is tried again.
        if how.failure().is_some_and(|f| f.class == FailureClass::Site) {
            return false;
        }
        let event = TaskEvent::Ended {
            generation: attempt.generation,
            how,
            site_retries: 0,
        };
        if let Ok(state) = entry.state.clone().on(event) {
            entry.state = state;
            entry.outcome = outcome;
        }
        entry.state.is_final()
    }
}

fn read_outcome(run_dir: &Path, task: &TaskKey, generation: u32) -> Option<TaskOutcome> {
    let attempt = AttemptId {
        task: task.clone(),
        generation,
    };
    match dispatch::outcome(&run_dir.join(attempt_directory(&attempt))) {
        Ok(Some(AttemptFindings::Outcome { outcome, .. })) => Some(*outcome),
        _ => None,
    }
}
