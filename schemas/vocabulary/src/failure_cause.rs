//! Causes of which jobs of a scheduler die.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Cause of which a scheduler's job died. It refines a failure of the site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FailureCause {
    /// It used up its walltime.
    Walltime,
    /// It used more memory than it was given.
    OutOfMemory,
    /// A node failed.
    NodeFailure,
    /// It had to make room for another job.
    Preemption,
    /// A person cancelled it.
    Cancelled,
    /// The scheduler will never take it as it is.
    Refused,
    /// A program of ours panicked.
    Defect,
    /// It ended without a word.
    Unexplained,
}

impl FailureCause {
    /// All, with the words that commands take.
    pub const ALL: [(Self, &'static str); 8] = [
        (Self::Walltime, "walltime"),
        (Self::OutOfMemory, "oom"),
        (Self::NodeFailure, "node"),
        (Self::Preemption, "preemption"),
        (Self::Cancelled, "cancelled"),
        (Self::Refused, "refused"),
        (Self::Defect, "defect"),
        (Self::Unexplained, "unexplained"),
    ];
}
