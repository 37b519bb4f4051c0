//! State machine of a patient on its way along the chain of tasks.
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
//!                    (between step-0 and step-1, a patient with pilots waits for them and takes learn-law)
//!                    each after a proposal of its own, where space mapping finds the next parameters
//!          noop-1 ─► noop-2 ─► noop-3                                                 (noop)
//!          task                                                                       (an element of a sweep)
//! ```
//! `stalled` is a quality of step 1's result and not a state: the chain continues from the best
//! iteration. Steps only go forward; only `Replan` goes back. Done, Failed and Cancelled absorb
//! every observation.

use std::cmp::Ordering;
use std::fmt;
use std::str::FromStr;

use cardiotwin_schemas::failure::Failure;
use cardiotwin_schemas::ids::TaskKey;
use cardiotwin_schemas::status::PatientState;
use serde::{Deserialize, Serialize};

use super::IllegalTransition;

/// A stage of the chain, under the name that people use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Passive state and loads.
    #[serde(rename = "step-0")]
    Step0,
    /// The organ's law from the beats of pilots.
    LearnLaw,
    /// Proposals for step 1's simulations, if they are tasks of their own.
    #[serde(rename = "step-1-proposal")]
    Step1Proposal,
    /// Simulations of the organ with the Tanh model.
    #[serde(rename = "step-1")]
    Step1,
    /// Median traces over the nodes, as targets of the fit.
    Targets,
    /// Differential evolution at the cell.
    #[serde(rename = "step-2")]
    Step2,
    /// Fit of the cell in the organ's law.
    #[serde(rename = "step-2-organ")]
    Step2Organ,
    /// One beat with the fitted cell.
    Verification,
    /// Proposals for step 3's simulations.
    #[serde(rename = "step-3-proposal")]
    Step3Proposal,
    /// Simulations of the organ with changed cells.
    #[serde(rename = "step-3")]
    Step3,
    /// Sampling of the posterior, which measures how certain the twin is.
    Posterior,
    /// Tasks without any effect.
    Noop,
    /// The only task of an element of a sweep.
    Task,
}

impl Stage {
    /// Name of the stage in tables and files.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Step0 => "step-0",
            Self::LearnLaw => "learn-law",
            Self::Step1Proposal => "step-1-proposal",
            Self::Step1 => "step-1",
            Self::Targets => "targets",
            Self::Step2 => "step-2",
            Self::Step2Organ => "step-2-organ",
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

/// A word that is not the name of a stage.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown step `{found}`; expected step0, step1, targets, step2, verification, step3 or \
     posterior"
)]
pub struct UnknownStage {
    /// Text that names no step.
    pub found: String,
}

impl FromStr for Stage {
    type Err = UnknownStage;

    /// Accepts both `step1` and `step-1`.
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

/// A stage with the number of one of its tasks. Iterations of steps 1 and 3, their proposals and
/// no-ops are numbered from 1; any other stage has one task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Step {
    /// Stage of the chain to which the task belongs.
    pub stage: Stage,
    /// Number within the stage, from 1.
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
    /// The order of the chain; proposals and simulations of a step alternate.
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
            Stage::Step2Organ => write!(f, "step-2 in the organ"),
            Stage::Noop => write!(f, "noop-{}", self.number),
            stage => write!(f, "{stage}"),
        }
    }
}

/// State of a patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "kebab-case")]
pub enum Patient {
    /// No task has been requested yet (or again).
    Waiting,
    /// The patient waits for a task.
    Working {
        /// Step of the chain.
        step: Step,
        /// Key of the task.
        task: TaskKey,
    },
    /// The task is settled, and the next decision is still to be made.
    Deciding {
        /// Step of the settled task.
        after: Step,
    },
    /// The whole chain is done.
    Done,
    /// A failure holds the chain.
    Failed {
        /// Step of the failed task.
        step: Step,
        /// Class and message of the failure.
        failure: Failure,
    },
    /// A person cancelled the patient.
    Cancelled {
        /// Step at the time of the cancellation; `None` if there was none.
        at: Option<Step>,
    },
}

/// Event of a patient. All but `TaskSettled` are commands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum PatientEvent {
    /// The chain needs this task next.
    Want {
        /// Step of the chain.
        step: Step,
        /// Key of the task.
        task: TaskKey,
    },
    /// Observation: a task was published or failed for good.
    TaskSettled {
        /// Key of the task.
        task: TaskKey,
    },
    /// Nothing is left to do.
    Finish,
    /// A failure holds the chain.
    Fail {
        /// Step of the failed task.
        step: Step,
        /// Class and message of the failure.
        failure: Failure,
    },
    /// A person cancels the patient.
    Cancel,
    /// Inputs or settings changed, or a person requested a rerun or retry: decide again.
    Replan {
        /// Reason, for the history.
        reason: String,
    },
}

/// Action that follows from a transition.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PatientAction {
    /// The patient does not need the task any more; an attempt at it may end if no other patient
    /// does.
    Release(TaskKey),
}

impl Patient {
    /// Whether the patient is over: done, failed or cancelled.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(
            self,
            Self::Done | Self::Failed { .. } | Self::Cancelled { .. }
        )
    }

    /// State for tables. It does not show whether a wanted task is running.
    #[must_use]
    pub fn shown(&self) -> PatientState {
        match self {
            Self::Waiting | Self::Deciding { .. } => PatientState::Waiting,
            Self::Working { .. } => PatientState::Running,
            Self::Done => PatientState::Done,
            Self::Failed { .. } => PatientState::Failed,
            Self::Cancelled { .. } => PatientState::Cancelled,
        }
    }

    /// Step at which the patient is; `None` before the first and after the last task.
    #[must_use]
    pub fn step(&self) -> Option<Step> {
        match self {
            Self::Working { step, .. } | Self::Failed { step, .. } => Some(*step),
            Self::Deciding { after } => Some(*after),
            Self::Cancelled { at } => *at,
            Self::Waiting | Self::Done => None,
        }
    }

    /// Next state, and the actions that follow.
    ///
    /// # Errors
    /// [`IllegalTransition`] for a command that makes no sense in this state; never for an
    /// observation.
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
                    || state.shown().to_string(),
                    |step| format!("{} ({step})", state.shown()),
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
