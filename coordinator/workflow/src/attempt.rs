//! One attempt at a task: its own directory, its own generation.
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
//! `Unknown` is absence of news: a state, not an ending. `GiveUp` and `Cancel` fence the attempt's directory first, so
//! that a process that lives on unseen publishes nothing. `Done` absorbs every observation.

use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::ids::ExternalId;
use serde::{Deserialize, Serialize};

use super::IllegalTransition;

/// Where an attempt stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum Attempt {
    /// Written down, not yet approved.
    Planned,
    /// The intent to submit is durable; whether it happened is not known yet.
    Submitting,
    /// Seen alive.
    Running {
        /// What the executor calls it.
        id: ExternalId,
    },
    /// No news: neither alive nor ended as far as can be seen.
    Unknown {
        /// Milliseconds since 1970.
        since_ms: i64,
    },
    /// Asked to end; what it has published by then counts.
    Cancelling,
    /// Over.
    Done {
        /// How.
        how: AttemptEnding,
    },
}

/// How an attempt ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "how", rename_all = "kebab-case")]
pub enum AttemptEnding {
    /// It left a result that passed the judge.
    Succeeded,
    /// It left a failure, or a result that did not pass.
    Failed {
        /// Why.
        failure: Failure,
    },
    /// Its process ended without an outcome while we watched: the site's doing, charged to the retry budget.
    Lost {
        /// What is known: exit code, signal.
        reason: String,
    },
    /// Stopped by us on the way out, or found dead at a restart: nobody's fault, charged to nobody.
    Interrupted,
    /// Not wanted any more.
    Cancelled,
}

impl AttemptEnding {
    /// The failure that this ending means for the task, if it means one.
    #[must_use]
    pub fn failure(&self) -> Option<Failure> {
        match self {
            Self::Failed { failure } => Some(failure.clone()),
            Self::Lost { reason } => Some(Failure::new(FailureClass::Site, reason.clone())),
            Self::Succeeded | Self::Interrupted | Self::Cancelled => None,
        }
    }
}

/// What happens to an attempt. The first three are commands, the others observations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum AttemptEvent {
    /// Command: submit it.
    Approve,
    /// Command: it is not wanted any more.
    Cancel,
    /// Command: the grace of an unknown attempt is over.
    GiveUp,
    /// The executor took it.
    Accepted {
        /// What the executor calls it.
        id: ExternalId,
    },
    /// The executor could not take it.
    Refused {
        /// Why.
        failure: Failure,
    },
    /// It was seen alive (again).
    Seen {
        /// What the executor calls it.
        id: ExternalId,
    },
    /// It is not where it was.
    Vanished {
        /// Milliseconds since 1970.
        since_ms: i64,
    },
    /// It ended.
    Ended {
        /// How.
        how: AttemptEnding,
    },
}

/// What to do about it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AttemptAction {
    /// Hand it to the executor.
    Submit,
    /// Fence its directory and end its process.
    Stop,
}

impl Attempt {
    /// Whether it is over.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(self, Self::Done { .. })
    }

    /// One word for tables.
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

    /// Next state and what to do about it.
    ///
    /// # Errors
    /// [`IllegalTransition`] for a command that makes no sense here; never for an observation.
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
            // Asking twice is harmless: the action may have been lost with the process that should have done it.
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
            // Evidence of an end wins wherever it comes from: an attempt whose submission we never saw confirmed may
            // have run and finished (the coordinator was killed in between).
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
