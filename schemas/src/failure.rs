//! Failures, with the class that determines the reaction.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a failure asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FailureClass {
    /// The data or settings are wrong: fix them; never retried as it is.
    Input,
    /// The machine or site failed (process killed, disk full): the same task may be retried.
    Site,
    /// The simulation diverged or broke a check of the science: other settings may help.
    Numerics,
    /// A defect of ours (panic, impossible state): stop and report.
    Bug,
}

impl FailureClass {
    /// Name of the class in tables.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Site => "site",
            Self::Numerics => "numerics",
            Self::Bug => "bug",
        }
    }
}

/// What a scheduler's job died of: the finer side of [`FailureClass::Site`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SiteCause {
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

impl SiteCause {
    /// All causes, with their names in commands.
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

/// What went wrong, in words for a person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Failure {
    /// Decides what follows.
    pub class: FailureClass,
    /// What was tried, with which values; lower case, no full stop.
    pub message: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
    /// What a scheduler's job died of, where it was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<SiteCause>,
}

impl Failure {
    /// A failure without a remedy.
    #[must_use]
    pub fn new(class: FailureClass, message: impl Into<String>) -> Self {
        Self {
            class,
            message: message.into(),
            remedy: None,
            cause: None,
        }
    }
}
