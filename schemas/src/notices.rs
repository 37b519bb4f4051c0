//! Notices to operators: events, recipients, and the JSON that a hook reads.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;
use crate::status::PatientState;

/// Event that is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoticeKind {
    /// Every patient of the cohort has ended.
    Done,
    /// Step 1 of a patient ended with its best iteration without meeting the tolerance.
    Stalled,
    /// A failure holds a patient.
    Failed,
    /// The file system of the run has little free space left.
    QuotaLow,
}

impl NoticeKind {
    /// Name in files and subjects.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Stalled => "stalled",
            Self::Failed => "failed",
            Self::QuotaLow => "quota-low",
        }
    }

    /// Explanation of the event for reports.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Done => "every patient is over",
            Self::Stalled => "step 1 stalled: the best iteration is taken",
            Self::Failed => "a patient is held by a failure",
            Self::QuotaLow => "little room is left where the run lies",
        }
    }
}

/// Recipients and events of notices. These settings never enter a task's key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NoticeSettings {
    /// Program with arguments that reads one notice as JSON from its standard input; empty for
    /// none.
    pub command: Vec<String>,
    /// E-mail addresses to which notices are sent; empty for none.
    pub mail: Vec<String>,
    /// Program with arguments that sends a message from its standard input, as sendmail does.
    pub sendmail: Vec<String>,
    /// Events that are reported.
    pub events: Vec<NoticeKind>,
    /// Time after which a command is killed, s.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 3600.0))]
    pub time_limit_s: f64,
    /// Free space on the file system of the run, GB, below which `quota-low` is sent.
    #[serde(rename = "least_free_GB")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e9))]
    pub least_free_gb: f64,
}

impl Default for NoticeSettings {
    fn default() -> Self {
        Self {
            command: vec![],
            mail: vec![],
            sendmail: vec!["/usr/sbin/sendmail".into(), "-t".into(), "-i".into()],
            events: vec![
                NoticeKind::Done,
                NoticeKind::Stalled,
                NoticeKind::Failed,
                NoticeKind::QuotaLow,
            ],
            time_limit_s: 30.0,
            least_free_gb: 1.0,
        }
    }
}

impl NoticeSettings {
    /// Whether the settings equal the defaults.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Whether no notices are sent.
    #[must_use]
    pub fn is_silent(&self) -> bool {
        self.commands().is_empty() || self.events.is_empty()
    }

    /// Commands started for each notice, with a short name for each.
    #[must_use]
    pub fn commands(&self) -> Vec<(&'static str, Vec<String>)> {
        let mut commands = Vec::new();
        if !self.command.is_empty() {
            commands.push(("command", self.command.clone()));
        }
        if !self.mail.is_empty() && !self.sendmail.is_empty() {
            commands.push(("mail", self.sendmail.clone()));
        }
        commands
    }
}

/// A notice as a hook reads it. It contains pseudonyms, steps and classes, but never data, paths or
/// messages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Notice {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Event of the notice.
    pub event: NoticeKind,
    /// Name of the cohort.
    pub cohort: String,
    /// Time at which the event was noticed, UTC, RFC 3339.
    pub at: String,
    /// Pseudonym of the patient, if the event concerns one patient.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patient: Option<String>,
    /// Step that the patient has reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<String>,
    /// Class of the failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<FailureClass>,
    /// Number of patients by state.
    pub counts: BTreeMap<PatientState, u64>,
    /// Free space on the file system of the run, for `quota-low`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_bytes: Option<u64>,
}
