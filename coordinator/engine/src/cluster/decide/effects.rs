//! Effects of committed decisions on the world, and their results. Each may be executed twice.

use std::path::PathBuf;

use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_slurm::answers::Output;
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm::job::JobId;

use crate::dispatch::AttemptFindings;

/// Name of a job and index of an element.
pub type ElementId = (String, usize);

/// An effect that is due. A number is that of the action in the outbox.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Effect {
    /// Remove the files of requests that were applied.
    RemoveRequests(Vec<PathBuf>),
    /// Fence an element that ended.
    Fence(ElementId),
    /// Revoke an attempt that an ended job left unfinished.
    Revoke { attempt: AttemptId, reason: String },
    /// Fence an element by an action.
    FenceByAction { action: i64, element: ElementId },
    /// Revoke an attempt that is not wanted any more.
    Stop { action: i64, attempt: AttemptId },
    /// Write the model overlay of a patient.
    WriteOverlay { action: i64, patient_id: i64 },
    /// Submit a job.
    Submit { action: i64, job: String },
    /// An action that has no effect any more.
    Nothing { action: i64 },
    /// Cancel elements.
    Cancel {
        actions: Vec<i64>,
        commands: Vec<Command>,
    },
    /// Cancel elements that outlived their drivers. One that stays is cancelled again at the next
    /// tick.
    CancelLingering(Vec<JobId>),
}

/// Result of an effect.
#[derive(Debug)]
pub enum EffectResult {
    /// The action was executed.
    Done(i64),
    /// The attempt was stopped, or had published the evidence before.
    Stopped {
        action: i64,
        attempt: AttemptId,
        published: Option<AttemptFindings>,
    },
    /// The job was to be submitted.
    Submitted {
        action: i64,
        job: String,
        answer: SubmissionResult,
    },
    /// Cancellations were requested.
    Cancelled {
        actions: Vec<i64>,
        /// Whether Slurm took all of them.
        accepted: bool,
    },
}

/// Result of a submission.
#[derive(Debug)]
pub enum SubmissionResult {
    /// The answer of sbatch.
    Answered(Output),
    /// An earlier tick had begun the submission.
    BegunBefore,
    /// No script can be written for the job, for this reason.
    NoScript(String),
}

impl EffectResult {
    pub fn is_submission(&self) -> bool {
        matches!(self, Self::Submitted { .. })
    }
}
