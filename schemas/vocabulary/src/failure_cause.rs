//! Reasons why jobs of a scheduler end early.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Reason why a scheduler's job ended. It refines a failure of the site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FailureCause {
    /// The job used up its walltime.
    Walltime,
    /// The job used more memory than it was given.
    OutOfMemory,
    /// A node failed.
    NodeFailure,
    /// The job was preempted by another one.
    Preemption,
    /// A person cancelled the job.
    Cancelled,
    /// The scheduler will never accept the job as it is.
    Refused,
    /// One of our programs panicked.
    Defect,
    /// The scheduler itself ended or lost the job, for example because one of its daemons died.
    Lost,
    /// The job ended without any trace of the reason.
    Unexplained,
}

impl FailureCause {
    /// All, with the words that commands take.
    pub const ALL: [(Self, &'static str); 9] = [
        (Self::Walltime, "walltime"),
        (Self::OutOfMemory, "oom"),
        (Self::NodeFailure, "node"),
        (Self::Preemption, "preemption"),
        (Self::Cancelled, "cancelled"),
        (Self::Refused, "refused"),
        (Self::Defect, "defect"),
        (Self::Lost, "lost"),
        (Self::Unexplained, "unexplained"),
    ];
}
