//! A finding of `doctor`: the check, its result, and the remedy.

use serde::Serialize;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// The check passed.
    Ok,
    /// Something is absent that may not be needed.
    Note,
    /// Works, but less well than it could, or not for long.
    Warning,
    /// A run on this machine or site would fail.
    Error,
}

impl Level {
    /// The word shown in the table.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// A row of the table of findings.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Name of the check.
    pub check: &'static str,
    /// Severity of the finding.
    pub level: Level,
    /// Description of the result.
    pub found: String,
    /// Advice to the user; empty if there is nothing to do.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub remedy: String,
}

impl Finding {
    /// A finding of level [`Level::Ok`], without a remedy.
    pub fn ok(check: &'static str, found: impl Into<String>) -> Self {
        Self {
            check,
            level: Level::Ok,
            found: found.into(),
            remedy: String::new(),
        }
    }

    /// A finding of the given level, with its remedy.
    pub fn bad(
        check: &'static str,
        level: Level,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            check,
            level,
            found: found.into(),
            remedy: remedy.into(),
        }
    }
}
