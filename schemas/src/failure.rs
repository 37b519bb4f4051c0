//! Failures, with the class that determines the reaction.

pub use cardiotwin_vocabulary::failure_cause::FailureCause;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Class of a failure. It determines what follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FailureClass {
    /// Wrong data or settings. They must be corrected; the task is not repeated unchanged.
    Input,
    /// Failure of the machine or the site (process killed, disk full). The same task may be
    /// repeated.
    Site,
    /// The simulation diverged or violated a scientific check. Other settings may help.
    Numerics,
    /// Defect of the program (panic, impossible state). It must be reported; nothing is repeated.
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

/// A failure of a task with an explanation for people.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Failure {
    /// Class, which determines what follows.
    pub class: FailureClass,
    /// What was attempted, with values; lower case without full stop.
    pub message: String,
    /// Action that may remove the failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
    /// Reason why a scheduler's job ended, if the task ran in one.
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
