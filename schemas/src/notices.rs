//! Notices to operators: events, recipients, and the JSON that a hook reads.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;

/// What there is to tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoticeKind {
    /// Every patient of the cohort is over.
    Done,
    /// Step 1 of a patient ended with its best iteration, not within the tolerance.
    Stalled,
    /// A patient is held by a failure.
    Failed,
    /// Little room is left where the run lies.
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

    /// Meaning for reports.
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

/// Who is told, and of what. Never part of a task's key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NoticeSettings {
    /// Program with arguments that reads one [`Notice`] as JSON from its input; none where empty.
    pub command: Vec<String>,
    /// Addresses that are written to; none where empty.
    pub mail: Vec<String>,
    /// Program with arguments that sends what it reads, as sendmail does.
    pub sendmail: Vec<String>,
    /// Of what.
    pub events: Vec<NoticeKind>,
    /// How long a command may take before it is killed, s.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 3600.0))]
    pub time_limit_s: f64,
    /// Less room than this where the run lies is `quota-low`.
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

/// What a hook reads: pseudonyms, steps and classes, never data, paths or messages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Notice {
    /// Format version.
    pub schema_version: u32,
    /// What happened.
    pub event: NoticeKind,
    /// The cohort's name.
    pub cohort: String,
    /// UTC, RFC 3339: when it was noticed.
    pub at: String,
    /// Pseudonym, where it is about one patient.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patient: Option<String>,
    /// Where the patient stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<String>,
    /// Class of the failure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<FailureClass>,
    /// Patients by state.
    pub counts: BTreeMap<String, u64>,
    /// Room where the run lies, for `quota-low`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_bytes: Option<u64>,
}
