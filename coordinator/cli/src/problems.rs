//! Problems of the input as text.

use std::collections::BTreeMap;

use cardiotwin_input::{Finding, Report};
use cardiotwin_schemas::status::RefusedPatient;
use cardiotwin_signals::Problem;

use super::talk::{Talk, Tone, paint};

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

/// Patients with errors, each with all of them.
#[must_use]
pub fn refused(report: &Report) -> Vec<RefusedPatient> {
    let mut errors: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for Finding { patient, problem } in in_order(report) {
        if let Some(patient) = patient.filter(|_| problem.is_error()) {
            let error = format!("{}, expected {}", found_at(&problem), problem.expected);
            errors.entry(patient).or_default().push(error);
        }
    }
    let refused = errors.into_iter();
    refused
        .map(|(patient, errors)| RefusedPatient { patient, errors })
        .collect()
}

/// Place, key and description of a problem.
fn found_at(problem: &Problem) -> String {
    let key = problem
        .key
        .as_deref()
        .map(|key| format!(" {key}:"))
        .unwrap_or_default();
    format!("{}:{key} found {}", problem.place(), problem.found)
}

/// Prints all problems on stderr, or only the errors if the program is quiet.
pub fn say(report: &Report, talk: &Talk) {
    let text = text(report, talk.colour_err, !talk.quiet);
    if !text.is_empty() {
        talk.insist(text.trim_end());
    }
}

/// Text with three lines per problem: its place and description, the expectation, and the remedy.
/// Without `with_warnings` the text holds the errors only.
#[must_use]
pub fn text(report: &Report, colour: bool, with_warnings: bool) -> String {
    let mut text = String::new();
    for Finding { problem, .. } in in_order(report) {
        if !problem.is_error() && !with_warnings {
            continue;
        }
        let (tone, word) = if problem.is_error() {
            (Tone::Bad, "error")
        } else {
            (Tone::Doubtful, "warning")
        };
        text.push_str(&format!(
            "{}: {}\n  expected: {}\n  remedy:   {}\n",
            paint(colour, tone, word),
            found_at(&problem),
            problem.expected,
            problem.remedy
        ));
    }
    text
}
