//! Problems of the input as text.

use cardiotwin_schemas::status::RefusedPatient;
use cardiotwin_signals::Problem;

use super::talk::{Talk, Tone, paint};
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

/// Patients with errors, each with all of them, in the order of the first error of each.
#[must_use]
pub fn refused(report: &Report) -> Vec<RefusedPatient> {
    let mut refused: Vec<RefusedPatient> = Vec::new();
    for Finding { patient, problem } in in_order(report) {
        let Some(patient) = patient.filter(|_| problem.is_error()) else {
            continue;
        };
        let known = refused.iter().position(|one| one.patient == patient);
        let at = known.unwrap_or_else(|| {
            refused.push(RefusedPatient {
                patient,
                errors: Vec::new(),
            });
            refused.len() - 1
        });
        let key = problem
            .key
            .as_deref()
            .map_or_else(String::new, |key| format!(" {key}:"));
        refused[at].errors.push(format!(
            "{}:{key} found {}, expected {}",
            problem.place(),
            problem.found,
            problem.expected
        ));
    }
    refused
}

/// Prints all problems on stderr, or only the errors if the program is quiet.
pub fn say(report: &Report, talk: &Talk) {
    eprint!("{}", text(report, talk.colour_err, !talk.quiet));
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
