//! The model in the report's head, and the cohort's notes: what a reader must know before the
//! numbers.

use cardiotwin_schemas::record::{PatientRecord, RunRecord, Step1Quality};
use maud::{Markup, html};

use super::format::count;
use crate::results::model::{models, nodes};
use crate::results::{PatientView, Step};

/// Function that gives the link to a patient.
type Link<'a> = &'a dyn Fn(&PatientRecord) -> String;

/// Most patients that the notes name one by one, so that the summary keeps to two sheets.
const NAMED: usize = 12;

/// The model of the patients, in a line for each different one.
#[must_use]
pub fn model(run: &RunRecord) -> Markup {
    let all = models(&run.patients);
    html! {
        @for (words, of) in all.iter().take(4) {
            p.model {
                b { @if all.len() == 1 { "Model" } @else { "Model of " (count(of.len(), "patient")) } }
                ": " (words)
                @if let Some((least, most)) = nodes(of) {
                    "; mesh of " @if least == most { (least) } @else { (least) " to " (most) } " nodes"
                }
                "; cardiotwin " (run.version) "."
            }
        }
        @if all.len() > 4 { p.quiet { (all.len() - 4) " further models are named with their patients." } }
    }
}

/// Reasons for caution about a patient, in words.
fn reasons(patient: &PatientRecord) -> Vec<String> {
    let mut found = Vec::new();
    if let Some(failure) = &patient.failure {
        found.push(format!("failed: {}", failure.message));
    }
    // Done, but off: what the twin is for does not hold.
    if let Some(verdict) = patient.off() {
        found.push(verdict.to_string());
    }
    found.extend(patient.without_intervals());
    if let Some(summary) = &patient.step1
        && let Step1Quality::Stalled { reason } = summary.quality
    {
        found.push(format!("step 1 stalled, because {}", reason.words()));
    }
    let lost = patient
        .iterations
        .iter()
        .filter(|i| i.failure.is_some())
        .count();
    if lost > 0 {
        found.push(format!("{} of step 1 failed", count(lost, "simulation")));
    }
    if let Some(fit) = &patient.cell_fit {
        let unreachable = fit.result.unreachable_targets.len();
        if unreachable > 0 {
            found.push(format!(
                "{} of step 2 not reachable",
                count(unreachable, "target")
            ));
        }
    }
    let view = PatientView(patient);
    let beats = [
        view.beat(Step::Step1),
        view.beat(Step::Step2),
        view.step3_beat(),
    ];
    let unmet = beats
        .into_iter()
        .flatten()
        .flat_map(|beat| &beat.result.checks)
        .filter(|check| !check.passed)
        .count();
    if unmet > 0 {
        found.push(format!("{} of the science not met", count(unmet, "check")));
    }
    if let Some(step0) = &patient.step0 {
        let keys: Vec<&str> = step0
            .result
            .estimates
            .iter()
            .map(|e| e.key.as_str())
            .collect();
        if !keys.is_empty() {
            found.push(format!("estimated: {}", keys.join(", ")));
        }
    }
    found
}

/// A line for each patient that needs attention; empty if none does.
#[must_use]
pub fn notes(run: &RunRecord, link: Link) -> Markup {
    let all: Vec<(&PatientRecord, Vec<String>)> = run
        .patients
        .iter()
        .map(|patient| (patient, reasons(patient)))
        .filter(|(_, reasons)| !reasons.is_empty())
        .collect();
    html! {
        @if !all.is_empty() {
            h2 id="notes" { "Notes" }
            ul.notes.cohort-notes {
                @for (patient, reasons) in all.iter().take(NAMED) {
                    li class=(if patient.failure.is_some() { "bad" } else { "warn" }) {
                        span.sign aria-hidden="true" { @if patient.failure.is_some() { "✕" } @else { "▲" } }
                        span { a href=(link(patient)) { (patient.plan.id) } ": " (reasons.join("; ")) }
                    }
                }
                @if all.len() > NAMED {
                    li { span.sign aria-hidden="true" { "·" } span { (count(all.len() - NAMED, "further patient")) " with notes of their own." } }
                }
            }
        }
    }
}
