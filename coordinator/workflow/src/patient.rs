//! A patient's way along its chain of tasks.
//!
//! ```text
//!            Want(step, task)              TaskSettled(task)
//!  Waiting ───────────────────► Working ─────────────────────► Deciding{after}
//!   │  ▲                         │  ▲                            │    │     │
//!   │  │                         │  └──────── Want(step, task) ──┘    │     │ Fail
//!   │  └─ Replan (from anywhere: inputs or settings changed, retry)    │     ▼
//!   │                            │ Cancel               Finish ────────┘   Failed{step, failure}
//!   ├──────────── Finish ────────┼──────────► Done
//!   └──────────── Cancel ────────┴──────────► Cancelled{at}
//!
//!  steps:  step-0 ─► step-1 iteration 1 … k ─► targets ─► step-2 ─► verification ─► step-3 iteration 1 … n  (personalise)
//!                    each after a proposal of its own, where space mapping finds the next parameters
//!          noop-1 ─► noop-2 ─► noop-3                                                 (noop)
//!          task                                                                       (an element of a sweep)
//! ```
//! `stalled` is a quality of step 1's result, no state: the chain goes on from the best iteration. Steps only go
//! forward; only `Replan` goes back. Done, Failed and Cancelled absorb every observation.

use std::cmp::Ordering;
use std::fmt;
use std::str::FromStr;

use cardiotwin_schemas::failure::Failure;
use cardiotwin_schemas::ids::TaskKey;
use serde::{Deserialize, Serialize};

use super::IllegalTransition;

/// A stage of the chain, as people name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Passive state and loads.
    #[serde(rename = "step-0")]
    Step0,
    /// What to simulate next at the organ, where a task of its own finds that.
    #[serde(rename = "step-1-proposal")]
    Step1Proposal,
    /// The simulations at the organ.
    #[serde(rename = "step-1")]
    Step1,
    /// Median traces.
    Targets,
    /// Differential evolution at the cell.
    #[serde(rename = "step-2")]
    Step2,
    /// One beat with the fitted cell.
    Verification,
    /// What to simulate next with a cell in the organ.
    #[serde(rename = "step-3-proposal")]
    Step3Proposal,
    /// The simulations with cells in the organ.
    #[serde(rename = "step-3")]
    Step3,
    /// How sure the twin is.
    Posterior,
    /// A no-op.
    Noop,
    /// The one task of a sweep's element.
    Task,
}

impl Stage {
    /// As in tables and files.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Step0 => "step-0",
            Self::Step1Proposal => "step-1-proposal",
            Self::Step1 => "step-1",
            Self::Targets => "targets",
            Self::Step2 => "step-2",
            Self::Verification => "verification",
            Self::Step3Proposal => "step-3-proposal",
            Self::Step3 => "step-3",
            Self::Posterior => "posterior",
            Self::Noop => "noop",
            Self::Task => "task",
        }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A word that names no stage.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{found}` is no step; expected step0, step1, targets, step2, verification, step3 or posterior"
)]
pub struct UnknownStage {
    /// What was given.
    pub found: String,
}

impl FromStr for Stage {
    type Err = UnknownStage;

    /// Accepts `step1` and `step-1` alike.
    fn from_str(text: &str) -> Result<Self, UnknownStage> {
        match text {
            "step0" | "step-0" => Ok(Self::Step0),
            "step1" | "step-1" => Ok(Self::Step1),
            "targets" => Ok(Self::Targets),
            "step2" | "step-2" => Ok(Self::Step2),
            "verification" => Ok(Self::Verification),
            "step3" | "step-3" => Ok(Self::Step3),
            "posterior" => Ok(Self::Posterior),
            _ => Err(UnknownStage {
                found: text.to_owned(),
            }),
        }
    }
}

/// A stage, and which of its tasks: iterations of steps 1 and 3, their proposals and no-ops count from 1, the others have
/// one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Step {
    /// The stage.
    pub stage: Stage,
    /// 1 for the first.
    pub number: u32,
}

impl Step {
    /// The only task of a stage.
    #[must_use]
    pub fn only(stage: Stage) -> Self {
        Self { stage, number: 1 }
    }
}

impl Ord for Step {
    /// The order of the chain: proposals and simulations of a step take turns.
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |step: &Self| match step.stage {
            Stage::Step1Proposal => (Stage::Step1, step.number, 0),
            Stage::Step3Proposal => (Stage::Step3, step.number, 0),
            stage => (stage, step.number, 1),
        };
        key(self).cmp(&key(other))
    }
}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.stage {
            Stage::Step1Proposal => write!(f, "step-1 proposal {}", self.number),
            Stage::Step1 => write!(f, "step-1 iteration {}", self.number),
            Stage::Step3Proposal => write!(f, "step-3 proposal {}", self.number),
            Stage::Step3 => write!(f, "step-3 iteration {}", self.number),
            Stage::Noop => write!(f, "noop-{}", self.number),
            stage => write!(f, "{stage}"),
        }
    }
}

/// Where a patient stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum Patient {
    /// Nothing asked for yet (or again).
    Waiting,
    /// A task is wanted.
    Working {
        /// Where.
        step: Step,
        /// Which.
        task: TaskKey,
    },
    /// The task is settled; what follows is not decided yet.
    Deciding {
        /// Where the settled task stood.
        after: Step,
    },
    /// The whole chain is done.
    Done,
    /// Held by a failure.
    Failed {
        /// Where.
        step: Step,
        /// Why.
        failure: Failure,
    },
    /// A person ended it.
    Cancelled {
        /// Where it stood.
        at: Option<Step>,
    },
}

/// What happens to a patient. All but `TaskSettled` are commands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum PatientEvent {
    /// The chain needs this task next.
    Want {
        /// Where.
        step: Step,
        /// Which.
        task: TaskKey,
    },
    /// Observation: a task was published or failed for good.
    TaskSettled {
        /// Which.
        task: TaskKey,
    },
    /// Nothing is left to do.
    Finish,
    /// The chain cannot go on.
    Fail {
        /// Where.
        step: Step,
        /// Why.
        failure: Failure,
    },
    /// A person ends it.
    Cancel,
    /// Inputs or settings changed, or a person wants a rerun or a retry: decide anew.
    Replan {
        /// For the history.
        reason: String,
    },
}

/// What to do about it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PatientAction {
    /// This patient does not want the task any more; it may end if nobody else does.
    Release(TaskKey),
}

impl Patient {
    /// Whether it is over: done, failed or cancelled.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(
            self,
            Self::Done | Self::Failed { .. } | Self::Cancelled { .. }
        )
    }

    /// One word for tables; whether a wanted task runs is the task's affair.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Waiting | Self::Deciding { .. } => "waiting",
            Self::Working { .. } => "running",
            Self::Done => "done",
            Self::Failed { .. } => "failed",
            Self::Cancelled { .. } => "cancelled",
        }
    }

    /// Where it stands, if anywhere.
    #[must_use]
    pub fn step(&self) -> Option<Step> {
        match self {
            Self::Working { step, .. } | Self::Failed { step, .. } => Some(*step),
            Self::Deciding { after } => Some(*after),
            Self::Cancelled { at } => *at,
            Self::Waiting | Self::Done => None,
        }
    }

    /// Next state and what to do about it.
    ///
    /// # Errors
    /// [`IllegalTransition`] for a command that makes no sense here; never for an observation.
    pub fn on(self, event: PatientEvent) -> Result<(Self, Vec<PatientAction>), IllegalTransition> {
        use PatientEvent as E;
        match (self, event) {
            (Self::Waiting, E::Want { step, task }) => Ok((Self::Working { step, task }, vec![])),
            (Self::Deciding { after }, E::Want { step, task }) if step > after => {
                Ok((Self::Working { step, task }, vec![]))
            }
            (Self::Waiting | Self::Deciding { .. }, E::Finish) => Ok((Self::Done, vec![])),
            (Self::Waiting | Self::Deciding { .. }, E::Fail { step, failure }) => {
                Ok((Self::Failed { step, failure }, vec![]))
            }
            (Self::Waiting, E::Cancel) => Ok((Self::Cancelled { at: None }, vec![])),
            (Self::Deciding { after }, E::Cancel) => {
                Ok((Self::Cancelled { at: Some(after) }, vec![]))
            }
            (Self::Working { step, task }, E::Cancel) => Ok((
                Self::Cancelled { at: Some(step) },
                vec![PatientAction::Release(task)],
            )),
            (Self::Working { task, .. }, E::Replan { .. }) => {
                Ok((Self::Waiting, vec![PatientAction::Release(task)]))
            }
            (_, E::Replan { .. }) => Ok((Self::Waiting, vec![])),
            (Self::Working { step, task }, E::TaskSettled { task: settled }) if task == settled => {
                Ok((Self::Deciding { after: step }, vec![]))
            }
            (state, E::TaskSettled { .. }) => Ok((state, vec![])),
            (state, event) => Err(IllegalTransition {
                machine: "patient",
                state: state.step().map_or_else(
                    || state.word().into(),
                    |step| format!("{} ({step})", state.word()),
                ),
                event: match event {
                    E::Want { step, .. } => format!("want {step}"),
                    E::Finish => "finish".into(),
                    E::Fail { .. } => "fail".into(),
                    _ => "cancel".into(),
                },
            }),
        }
    }
}
