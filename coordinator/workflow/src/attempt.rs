//! State machine of one attempt at a task, with a directory and a generation of its own.
//!
//! ```text
//!            Approve            Accepted / Seen             Ended(how)
//! Planned ───────────► Submitting ───────────► Running ───────────────────► Done(how)
//!    │                     │  │                 │   ▲                          ▲
//!    │ Cancel              │  └─ Refused ───────┼───┼──► Done(Failed)          │
//!    ▼                     │           Vanished │   │ Seen                     │
//! Done(Cancelled)          │                    ▼   │                          │
//!                          │                 Unknown{since} ── Ended(how) ─────┤
//!                          │                    │ GiveUp ──► Done(Lost)        │
//!                          └──── Cancel ────────┴────► Cancelling ─ Ended(how)─┘
//! ```
//! `Unknown` is the absence of news, which is a state and not an ending. `GiveUp` and `Cancel`
//! fence the attempt's directory first, so that a process that lives on out of sight publishes
//! nothing. `Done` absorbs every observation.

use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::ids::ExternalId;
use serde::{Deserialize, Serialize};

use super::IllegalTransition;

/// State of an attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum Attempt {
    /// Recorded, but not yet approved.
    Planned,
    /// The intent to submit is durable, but it is not known yet whether the submission took place.
    Submitting,
    /// The attempt's process was seen alive.
    Running {
        /// Name of the attempt in the executor.
        id: ExternalId,
    },
    /// No news: the attempt is visibly neither alive nor ended.
    Unknown {
        /// Time since which there has been no news, milliseconds since 1970.
        since_ms: i64,
    },
    /// Asked to end. A result that it has published by then counts.
    Cancelling,
    /// The attempt is over.
    Done {
        /// Success, failure or interruption of the attempt.
        how: AttemptEnding,
    },
}

/// Ending of an attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "how", rename_all = "kebab-case")]
pub enum AttemptEnding {
    /// It left a result that passed the checks of [`crate::judge`].
    Succeeded,
    /// It left a failure, or a result that did not pass the checks.
    Failed {
        /// Class and message of the failure.
        failure: Failure,
    },
    /// Its process ended without an outcome while the coordinator watched it. This is charged to
    /// the retries for site failures.
    Lost {
        /// Known facts: exit code, signal.
        reason: String,
    },
    /// The coordinator stopped it on its way out, or found it dead at a restart. This is not
    /// charged to any retries.
    Interrupted,
    /// It was not wanted any more.
    Cancelled,
}

impl AttemptEnding {
    /// Failure of the task that this ending implies; `None` if it implies none.
    #[must_use]
    pub fn failure(&self) -> Option<Failure> {
        match self {
            Self::Failed { failure } => Some(failure.clone()),
            Self::Lost { reason } => Some(Failure::new(FailureClass::Site, reason.clone())),
            Self::Succeeded | Self::Interrupted | Self::Cancelled => None,
        }
    }
}

/// Event of an attempt. The first three are commands, the others observations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum AttemptEvent {
    /// Command: submit the attempt.
    Approve,
    /// Command: the attempt is not wanted any more.
    Cancel,
    /// Command: the grace time of an unknown attempt is over.
    GiveUp,
    /// The executor accepted the attempt.
    Accepted {
        /// Name of the attempt in the executor.
        id: ExternalId,
    },
    /// The executor could not accept the attempt.
    Refused {
        /// Class and message of the failure.
        failure: Failure,
    },
    /// The attempt was seen alive (again).
    Seen {
        /// Name of the attempt in the executor.
        id: ExternalId,
    },
    /// The attempt is not where it was.
    Vanished {
        /// Time of this observation, milliseconds since 1970.
        since_ms: i64,
    },
    /// The attempt has no process any more, and its ending is known.
    Ended {
        /// Success, failure or interruption of the attempt.
        how: AttemptEnding,
    },
}

/// Action that follows from a transition.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AttemptAction {
    /// Hand the attempt to the executor.
    Submit,
    /// Fence the attempt's directory and end its process.
    Stop,
}

impl Attempt {
    /// Whether the attempt is over.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(self, Self::Done { .. })
    }

    /// Name of the state in one word, for tables.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Planned => "planned",
            Self::Submitting => "submitting",
            Self::Running { .. } => "running",
            Self::Unknown { .. } => "unknown",
            Self::Cancelling => "cancelling",
            Self::Done { how } => match how {
                AttemptEnding::Succeeded => "succeeded",
                AttemptEnding::Failed { .. } => "failed",
                AttemptEnding::Lost { .. } => "lost",
                AttemptEnding::Interrupted => "interrupted",
                AttemptEnding::Cancelled => "cancelled",
            },
        }
    }

    /// Next state, and the actions that follow.
    ///
    /// # Errors
    /// [`IllegalTransition`] for a command that makes no sense in this state; never for an
    /// observation.
    pub fn on(self, event: AttemptEvent) -> Result<(Self, Vec<AttemptAction>), IllegalTransition> {
        use AttemptEvent as E;
        let stay = |state: Self| Ok((state, vec![]));
        let done = |how: AttemptEnding| Self::Done { how };
        match (self, event) {
            (Self::Planned, E::Approve) => Ok((Self::Submitting, vec![AttemptAction::Submit])),
            (Self::Planned, E::Cancel) => stay(done(AttemptEnding::Cancelled)),
            (Self::Submitting | Self::Running { .. } | Self::Unknown { .. }, E::Cancel) => {
                Ok((Self::Cancelling, vec![AttemptAction::Stop]))
            }
            // Repeating the action is harmless: it may have been lost with the process that had to
            // execute it.
            (Self::Cancelling, E::Cancel) => Ok((Self::Cancelling, vec![AttemptAction::Stop])),
            (Self::Unknown { since_ms }, E::GiveUp) => {
                let reason = format!("no news since {} ms (Unix time)", since_ms);
                Ok((
                    done(AttemptEnding::Lost { reason }),
                    vec![AttemptAction::Stop],
                ))
            }
            (state, event @ (E::Approve | E::Cancel | E::GiveUp)) => Err(IllegalTransition {
                machine: "attempt",
                state: state.word().into(),
                event: match event {
                    E::Approve => "approve",
                    E::Cancel => "cancel",
                    _ => "give up",
                }
                .into(),
            }),

            (state @ Self::Done { .. }, _) => stay(state),
            // Evidence of an end wins in every state: an attempt whose submission was never
            // confirmed may have run and finished, because the coordinator was killed in between.
            (
                Self::Cancelling,
                E::Ended {
                    how: AttemptEnding::Lost { .. } | AttemptEnding::Interrupted,
                },
            ) => stay(done(AttemptEnding::Cancelled)),
            (_, E::Ended { how }) => stay(done(how)),
            (Self::Submitting, E::Refused { failure }) => {
                stay(done(AttemptEnding::Failed { failure }))
            }
            (Self::Cancelling, E::Refused { .. }) => stay(done(AttemptEnding::Cancelled)),
            (Self::Submitting | Self::Unknown { .. }, E::Accepted { id } | E::Seen { id }) => {
                stay(Self::Running { id })
            }
            (Self::Submitting | Self::Running { .. }, E::Vanished { since_ms }) => {
                stay(Self::Unknown { since_ms })
            }
            (
                state,
                E::Accepted { .. } | E::Refused { .. } | E::Seen { .. } | E::Vanished { .. },
            ) => stay(state),
        }
    }
}
