//! A problem of a user's input: its place, the found and the expected content, and the remedy.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Whether work may continue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Nothing runs before it is mended.
    Error,
    /// Worth a look; work continues.
    Warning,
}

/// Place in a text file, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// Number of the line.
    pub line: usize,
    /// Number of the character in the line.
    pub column: usize,
}

/// A problem of a file, ready to be printed or stored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Problem {
    /// Whether work may continue.
    pub severity: Severity,
    /// File that must be looked at.
    pub file: PathBuf,
    /// Line of the problem, from 1; `None` where it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<usize>,
    /// Character in that line, from 1; `None` where the problem has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<usize>,
    /// Column of a CSV file or key of a TOML file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
    /// Content that was found, in words.
    pub found: String,
    /// Content that was expected, in words.
    pub expected: String,
    /// Advice on the change to make.
    pub remedy: String,
    /// Number of places that it stands for: 1, or the number of further lines like those that were
    /// reported.
    #[serde(skip, default = "one")]
    pub n: usize,
}

fn one() -> usize {
    1
}

impl Problem {
    /// A problem that stops work, of a file as a whole.
    #[must_use]
    pub fn error(
        file: &Path,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            severity: Severity::Error,
            file: file.to_owned(),
            line: None,
            column: None,
            key: None,
            found: found.into(),
            expected: expected.into(),
            remedy: remedy.into(),
            n: 1,
        }
    }

    /// A problem that does not stop work, of a file as a whole.
    #[must_use]
    pub fn warning(
        file: &Path,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            severity: Severity::Warning,
            ..Self::error(file, found, expected, remedy)
        }
    }

    /// The same problem at a line, from 1.
    #[must_use]
    pub fn at_line(mut self, line: usize) -> Self {
        self.line = Some(line);
        self
    }

    /// The same problem at a place, or without one.
    #[must_use]
    pub fn at(mut self, position: Option<Position>) -> Self {
        self.line = position.map(|at| at.line);
        self.column = position.map(|at| at.column);
        self
    }

    /// File, line and column as far as they are known: `cohort.toml:7:1`, which editors and
    /// terminals open.
    #[must_use]
    pub fn place(&self) -> String {
        let mut place = self.file.display().to_string();
        for number in [self.line, self.column].into_iter().flatten() {
            place.push_str(&format!(":{number}"));
        }
        place
    }

    /// The same problem at a column or key.
    #[must_use]
    pub fn at_key(mut self, key: impl Into<String>) -> Self {
        self.key = Some(key.into());
        self
    }

    /// Whether it stops work.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.severity == Severity::Error
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        write!(f, "{severity}: {}", self.place())?;
        if let Some(key) = &self.key {
            write!(f, ": {key}")?;
        }
        write!(
            f,
            ": found {}; expected {}; {}",
            self.found, self.expected, self.remedy
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prints_where_what_and_what_to_do() {
        let p = Problem::error(
            Path::new("a/pressure.csv"),
            "`NaN`",
            "a finite number in mmHg",
            "remove the line",
        )
        .at_line(17)
        .at_key("pressure_mmHg");
        assert_eq!(
            p.to_string(),
            "error: a/pressure.csv:17: pressure_mmHg: found `NaN`; expected a finite number in mmHg; remove the line"
        );
        let json = serde_json::to_string(&p).unwrap();
        assert!(
            json.contains(r#""severity":"error""#) && json.contains(r#""line":17"#),
            "{json}"
        );
        assert_eq!(serde_json::from_str::<Problem>(&json).unwrap(), p);
    }
}
