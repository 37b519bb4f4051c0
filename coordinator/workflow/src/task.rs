//! State machine of a task, that is of a wanted result. Its key identifies the result, so two
//! patients that want the same result share one task.
//!
//! ```text
//!          Start{g}                 Ended{g, Succeeded}
//!  Open ───────────► Attempting{g} ─────────────────────► Published{g}
//!   ▲ ▲                 │     │
//!   │ └── Interrupted, ─┘     └─ Ended{g, Failed} or site budget spent ──► Failed{failure}
//!   │     Cancelled, site failure within the budget                            │
//!   └───────────────────────────── Retry ──────────────────────────────────────┘
//! ```
//! Only the current generation counts: an `Ended` of an older one changes nothing. A published task
//! is never run again, unless its files were purged and are still needed: `Purged` opens it for a
//! further generation.

use cardiotwin_schemas::failure::{Failure, FailureClass};
use serde::{Deserialize, Serialize};

use super::IllegalTransition;
use super::attempt::AttemptEnding;

/// State of a task. Generations count from 1 and never decrease.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum Task {
    /// The task has no result, and no attempt is in progress.
    Open {
        /// Last generation that was tried; 0 if there is none.
        generation: u32,
        /// Number of site failures charged so far.
        site_failures: u32,
    },
    /// An attempt is in progress.
    Attempting {
        /// Generation of the attempt, the only one that may publish.
        generation: u32,
        /// Number of site failures charged so far.
        site_failures: u32,
    },
    /// The task has a result.
    Published {
        /// Generation of the attempt that published it.
        generation: u32,
    },
    /// The task failed, and another attempt without a request would be useless.
    Failed {
        /// Generation of the last attempt.
        generation: u32,
        /// Class and message of the failure.
        failure: Failure,
    },
}

/// Event of a task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum TaskEvent {
    /// Command: begin the next attempt.
    Start,
    /// Command: a person requests another attempt at a failed task.
    Retry,
    /// Observation: files of the published attempt are gone, and a wanted task reads them.
    Purged,
    /// Observation: an attempt ended.
    Ended {
        /// Generation of the attempt.
        generation: u32,
        /// Success, failure or interruption of the attempt.
        how: AttemptEnding,
        /// Number of site failures that are forgiven.
        site_retries: u32,
    },
}

impl Default for Task {
    fn default() -> Self {
        Self::Open {
            generation: 0,
            site_failures: 0,
        }
    }
}

impl Task {
    /// Last generation that was begun; 0 if there is none.
    #[must_use]
    pub fn generation(&self) -> u32 {
        match self {
            Self::Open { generation, .. }
            | Self::Attempting { generation, .. }
            | Self::Published { generation }
            | Self::Failed { generation, .. } => *generation,
        }
    }

    /// Whether the task is settled, that is published or failed.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(self, Self::Published { .. } | Self::Failed { .. })
    }

    /// Name of the state in one word, for the database.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Open { .. } => "open",
            Self::Attempting { .. } => "attempting",
            Self::Published { .. } => "published",
            Self::Failed { .. } => "failed",
        }
    }

    /// The state in a word that needs no page, for tables.
    #[must_use]
    pub fn shown(&self) -> &'static str {
        match self {
            Self::Open { .. } => "to do",
            Self::Attempting { .. } => "running",
            Self::Published { .. } => "finished",
            Self::Failed { .. } => "failed",
        }
    }

    /// Next state.
    ///
    /// # Errors
    /// [`IllegalTransition`] for `Start` of a task that is not open, and for `Retry` of a task that
    /// did not fail.
    pub fn on(self, event: TaskEvent) -> Result<Self, IllegalTransition> {
        match (self, event) {
            (
                Self::Open {
                    generation,
                    site_failures,
                },
                TaskEvent::Start,
            ) => Ok(Self::Attempting {
                generation: generation + 1,
                site_failures,
            }),
            (Self::Failed { generation, .. }, TaskEvent::Retry) => Ok(Self::Open {
                generation,
                site_failures: 0,
            }),
            (Self::Published { generation }, TaskEvent::Purged) => Ok(Self::Open {
                generation,
                site_failures: 0,
            }),
            (state, TaskEvent::Purged) => Ok(state),
            (state, TaskEvent::Start) => Err(illegal(&state, "start")),
            (state, TaskEvent::Retry) => Err(illegal(&state, "retry")),
            (
                Self::Attempting {
                    generation,
                    site_failures,
                },
                TaskEvent::Ended {
                    generation: ended,
                    how,
                    site_retries,
                },
            ) if generation == ended => Ok(match how {
                AttemptEnding::Succeeded => Self::Published { generation },
                AttemptEnding::Interrupted | AttemptEnding::Cancelled => Self::Open {
                    generation,
                    site_failures,
                },
                AttemptEnding::Failed { failure } => {
                    settle(generation, site_failures, failure, site_retries)
                }
                AttemptEnding::Lost { reason } => settle(
                    generation,
                    site_failures,
                    Failure::new(FailureClass::Site, reason),
                    site_retries,
                ),
            }),
            (state, TaskEvent::Ended { .. }) => Ok(state),
        }
    }
}

/// Pause before the first retry after a failure of the site \[ms\].
const FIRST_PAUSE_MS: i64 = 1_000;
/// Length above which the pause does not grow \[ms\].
const LONGEST_PAUSE_MS: i64 = 300_000;

/// Pause before the retry after so many failures of the site, in ms: a second, and four times as
/// long after each further one. What killed one worker would kill the next one at once, too.
#[must_use]
pub fn pause_before_retry_ms(site_failures: u32) -> i64 {
    let further = site_failures.saturating_sub(1).min(16);
    (FIRST_PAUSE_MS << (2 * further)).min(LONGEST_PAUSE_MS)
}

/// State after a failure: site failures are forgiven `site_retries` times, all others are final.
fn settle(generation: u32, site_failures: u32, failure: Failure, site_retries: u32) -> Task {
    if failure.class == FailureClass::Site && site_failures < site_retries {
        Task::Open {
            generation,
            site_failures: site_failures + 1,
        }
    } else {
        Task::Failed {
            generation,
            failure,
        }
    }
}

fn illegal(state: &Task, event: &str) -> IllegalTransition {
    IllegalTransition {
        machine: "task",
        state: state.word().into(),
        event: event.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::pause_before_retry_ms;

    #[test]
    fn pauses_grow_fourfold_up_to_five_minutes() {
        let pauses = [1, 2, 3, 4, 5, 6, 40, u32::MAX].map(pause_before_retry_ms);
        assert_eq!(
            pauses,
            [
                1_000, 4_000, 16_000, 64_000, 256_000, 300_000, 300_000, 300_000
            ]
        );
    }
}
