//! Failures with the class that decides what follows.

pub use cardiotwin_vocabulary::failure_cause::FailureCause;
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
    /// The class as printed in tables.
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
    pub cause: Option<FailureCause>,
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
