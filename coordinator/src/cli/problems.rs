//! Problems of the input as text.

use cardiotwin_signals::Problem;

use super::talk::{Tone, paint};
use crate::input::{Finding, Report};

/// Findings with errors first, then by file and line.
#[must_use]
pub fn in_order(report: &Report) -> Vec<Finding> {
    let mut findings = report.findings().to_vec();
    findings.sort_by(|a, b| {
        let place = |p: &Problem| (p.severity, p.file.clone(), p.line, p.column);
        place(&a.problem).cmp(&place(&b.problem))
    });
    findings
}

/// Text with three lines per problem: its place and description, the expectation, and the remedy.
#[must_use]
pub fn text(report: &Report, colour: bool) -> String {
    let mut text = String::new();
    for Finding { problem, .. } in in_order(report) {
        let (tone, word) = if problem.is_error() {
            (Tone::Bad, "error")
        } else {
            (Tone::Doubtful, "warning")
        };
        let key = problem
            .key
            .as_deref()
            .map(|key| format!(" {key}:"))
            .unwrap_or_default();
        text.push_str(&format!(
            "{}: {}:{key} found {}\n  expected: {}\n  remedy:   {}\n",
            paint(colour, tone, word),
            problem.place(),
            problem.found,
            problem.expected,
            problem.remedy
        ));
    }
    text
}
