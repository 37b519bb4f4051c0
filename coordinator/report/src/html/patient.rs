//! The section of a patient.

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::record::{PatientRecord, Step1Quality, Step3Ending};
use maud::{Markup, html};

use super::anchor;
use super::cell_parameters;
use super::convergence;
use super::figures::{self, figure, legend, line_name};
use super::format::{duration, fixed, percent, significant, symbol};
use super::organ_3d;
use super::organ_law;
use super::posterior;
use super::provenance;
use super::tables;
use crate::results::standing::standing;
use crate::results::tables::{biomarkers, motion};
use crate::results::{PatientView, SignalKind, Signals, Source, Step, twin};
use crate::table::{self, sign_of};

/// State of a patient for a badge: a class of the style sheet, a sign, and words, so that colour is
/// not needed.
#[must_use]
pub fn badge(patient: &PatientRecord) -> (&'static str, &'static str, String) {
    let (tone, words) = standing(patient);
    let (class, sign) = sign_of(tone);
    (class, sign, words)
}

/// Summary of the steps in a few sentences.
fn summary(patient: &PatientRecord) -> Markup {
    let view = PatientView(patient);
    let errors = |step| {
        let (pressure, stroke) = (
            view.relative_difference(step, Biomarker::PMax),
            view.relative_difference(step, Biomarker::Sv),
        );
        html! {
            @if pressure.is_some() { "P" sub { "max" } " " (percent(pressure)) " %" }
            @if pressure.is_some() && stroke.is_some() { ", " }
            @if stroke.is_some() { "SV " (percent(stroke)) " %" }
        }
    };
    html! {
        p.summary {
            @match &patient.step1 {
                Some(s) => {
                    "Step 1 " (match s.quality {
                        Step1Quality::Converged => format!("converged (cost {} at iteration {} of {}", significant(s.cost, 3), s.best_iteration, patient.iterations.len()),
                        Step1Quality::Stalled { reason } => format!("stalled, because {}; iteration {} of {} was selected (cost {}", reason.words(), s.best_iteration, patient.iterations.len(), significant(s.cost, 3)),
                    })
                    @if let Some(first) = s.first_converged { @if first != s.best_iteration { ", within the tolerance from iteration " (first) } }
                    "): " (errors(Step::Step1)) ". "
                }
                None if patient.iterations.is_empty() => { "Step 1 has not started. " }
                None => { "Step 1 has not finished. " }
            }
            @if let Some(start) = patient.start_of_the_law() {
                "Organ's law at the start: " (start) ". "
            }
            @if let Some(fit) = &patient.cell_fit {
                "Step 2 " (if fit.result.converged { "converged" } else { "ended without convergence" })
                " after " (fit.result.evaluations) " cell evaluations in " (fit.result.generations) " generations (cost " (significant(fit.result.cost, 3))
                @if !fit.result.unreachable_targets.is_empty() { ", not all targets are reachable" } ")"
                @if patient.verification.is_some() {
                    "; in the organ: " (errors(Step::Step2))
                    @if let Some(cost) = patient.verification_cost { ", cost " (significant(cost, 3)) }
                }
                "."
            }
            @if let Some(step3) = &patient.step3 {
                " Step 3 " (match step3.best_iteration {
                    0 => "kept the verification beat".to_owned(),
                    best => format!("took beat {best} of {}", patient.step3_iterations.len()),
                }) ", since " (match step3.ending {
                    Step3Ending::WithinUncertainty => "it meets the measurements within their uncertainty: its cost is at most the number of measured values",
                    Step3Ending::NoPromise => "no other cell promised a sufficient improvement",
                    Step3Ending::IterationLimit => "the limit of beats was reached",
                }) ": " (errors(Step::Step3)) "."
            }
        }
    }
}

/// Explanation of why a simulated trace is missing.
fn why_no_beat(patient: &PatientRecord) -> String {
    match (&patient.failure, patient.iterations.is_empty()) {
        (Some(failure), true) => {
            format!(
                "No simulation: {} failed before step 1 ({}).",
                patient.plan.id, failure.message
            )
        }
        (Some(failure), false) => format!(
            "No simulation of this patient succeeded: {}.",
            failure.message
        ),
        (None, _) => "No simulation has finished yet.".to_owned(),
    }
}

/// Sentences about traces that are not drawn, with the reason.
fn missing(patient: &PatientRecord, signals: &Signals) -> Vec<String> {
    let mut sentences = Vec::new();
    let has = |source, kind| signals.get(source, kind).is_some();
    let step0 = &patient.plan.step0;
    if step0.pressure.is_none() {
        sentences.push(
            "No measured pressure trace: biomarkers were given directly, so only simulated traces are drawn."
                .to_owned(),
        );
    }
    if step0.volume.is_none() {
        sentences.push(
            "Only pressure was measured: without a measured volume the valves stay at their first guess, and volume biomarkers cannot be compared."
                .to_owned(),
        );
    }
    if !has(Source::Step1, SignalKind::Pressure) {
        sentences.push(why_no_beat(patient));
    } else if !has(Source::Step2, SignalKind::Pressure) {
        sentences.push(match (&patient.verification, &patient.failure) {
            (Some(_), _) => "The verification beat wrote no traces.".to_owned(),
            (None, Some(failure)) => format!("No verification beat: {}.", failure.message),
            (None, None) if !patient.plan.settings.verification.enabled => {
                "The verification beat is disabled.".to_owned()
            }
            (None, None) => "The verification beat has not run yet.".to_owned(),
        });
    }
    sentences
}

fn flags(patient: &PatientRecord, signals: &Signals) -> Markup {
    let view = PatientView(patient);
    let mut notes: Vec<(&str, Markup)> = Vec::new();
    if let Some(failure) = &patient.failure {
        notes.push((
            "bad",
            html! {
                b { (failure.class.as_str()) " failure: " } (failure.message) "."
                @if let Some(remedy) = &failure.remedy { " Remedy: " (remedy) "." }
            },
        ));
    }
    if let Some(off) = PatientView(patient).off_outside_the_verdict() {
        notes.push(("warn", html! { (off) "." }));
    }
    if let Some(verdict) = patient.off() {
        notes.push(("warn", html! { (verdict) ": outside of its tolerances." }));
    }
    if let Some(why) = patient.without_intervals() {
        notes.push(("warn", html! { (why) "." }));
    }
    for iteration in &patient.iterations {
        if let Some(failure) = &iteration.failure {
            notes.push((
                "warn",
                html! {
                    b { "step 1, iteration " (iteration.number) " failed: " } (failure.message) "."
                    @if let Some(remedy) = &failure.remedy { " Remedy: " (remedy) "." }
                },
            ));
        }
    }
    let beats = [
        ("step 1", view.beat(Step::Step1)),
        ("verification", view.beat(Step::Step2)),
        ("step 3", view.step3_beat()),
    ];
    for (what, beat) in beats {
        if let Some(beat) = beat {
            notes.extend(
                tables::failed_checks(what, &beat.result)
                    .into_iter()
                    .map(|m| ("bad", m)),
            );
            notes.extend(
                beat.result
                    .remarks
                    .iter()
                    .map(|r| ("quiet", html! { b { (what) ": " } (r) })),
            );
        }
    }
    if let Some(step0) = &patient.step0 {
        notes.extend(step0.result.estimates.iter().map(|e| {
            let text = html! { b { "estimated: " } code { (e.key) } " = " (significant(e.value, 4)) @if let Some(sd) = e.sd { " ± " (significant(sd, 2)) } ", " (e.method) };
            ("warn", text)
        }));
        if let Some(error) = step0.result.diastasis_volume_error_ml {
            let text = html! { b { "step 0: " } "volume at the diastasis pressure minus measured diastasis volume: " (fixed(Some(error), 1)) " mL" };
            notes.push(("quiet", text));
        }
        notes.extend(
            step0
                .result
                .remarks
                .iter()
                .map(|r| ("quiet", html! { b { "step 0: " } (r) })),
        );
    }
    if let Some(fit) = &patient.cell_fit {
        notes.extend(
            fit.result
                .unreachable_targets
                .iter()
                .map(|t| ("warn", html! { b { "step 2, target not reachable: " } (t) })),
        );
    }
    notes.extend(
        signals
            .problems
            .iter()
            .map(|p| ("warn", html! { b { "file: " } (p) })),
    );
    html! {
        @if !notes.is_empty() {
            ul.notes {
                @for (class, text) in notes {
                    li class=(class) { span.sign aria-hidden="true" { (match class { "bad" => "✕", "warn" => "▲", _ => "·" }) } span { (text) } }
                }
            }
        }
    }
}

fn beat(patient: &PatientRecord, signals: &Signals, drawn: &organ_3d::Drawn) -> Markup {
    let lines: Vec<_> = [
        Source::Measured,
        Source::Step1,
        Source::Step2,
        Source::Step3,
    ]
    .into_iter()
    .filter(|s| {
        signals
            .get(*s, SignalKind::Pressure)
            .or(signals.get(*s, SignalKind::Volume))
            .is_some()
    })
    .map(|s| (s.name(), line_name(s, patient)))
    .chain(
        signals
            .get(Source::Step1, SignalKind::AorticPressure)
            .map(|_| ("aortic", "aortic pressure, step 1".to_owned())),
    )
    .collect();
    let none = Markup::default();
    let no_volume = "No volume to draw: none was measured, and no simulation wrote one.";
    html! {
        h3 { "Beat" }
        @if !lines.is_empty() { (legend(&lines)) }
        @for sentence in missing(patient, signals) { p.absent { (sentence) } }
        div.beat {
        div.player data-length=(patient.plan.step0.cycle_length_ms) hidden {}
        (organ_3d::moving(drawn))
        div.figures {
            (figure("Pressure", figures::pressure(patient, signals), "No pressure trace to draw.", &none))
            (figure("Volume", figures::volume(patient, signals), no_volume, &html! { span.quiet { (figures::gap_words(patient).unwrap_or_default()) } }))
            (figure("Pressure-volume loop", figures::pv_loop(patient, signals), no_volume, &html! { span.quiet { ": ● begins, × ends" } }))
            @if let Some(chart) = figures::flows(patient, signals) {
                (figure("Valve flows", Some(chart), "", &none))
            }
        }
        }
    }
}

fn step1(patient: &PatientRecord) -> Markup {
    let parameters = convergence::parameters(patient);
    html! {
        @if !parameters.is_empty() {
            h3 { "Step 1: convergence" }
            p.quiet {
                "Parameters of each simulation relative to the first guess, on the same logarithmic axis; the band marks the selected iterate"
                @if patient.iterations.iter().any(|i| i.failure.is_some()) { ", × a simulation that failed" } "."
                @if patient.iterations.iter().any(|i| i.proposal.is_some()) {
                    " They were proposed by a reduced ventricle, the one-fibre ventricle or the organ's law, corrected by the earlier simulations; the grey line is its predicted cost."
                }
            }
            div.figures.small {
                (figure("Cost", convergence::cost(patient), "No simulation has a cost yet.", &Markup::default()))
                @for (key, chart) in parameters {
                    figure { figcaption { b { (symbol(key)) } } (chart.render()) }
                }
            }
        }
    }
}

fn cell(patient: &PatientRecord, signals: &Signals) -> Markup {
    if patient.targets.is_none() && patient.cell_fit.is_none() {
        return html! {
            h3 { "Step 2: cell" }
            p.absent {
                @if patient.failure.is_some() { "Step 2 did not run because the patient failed earlier." } @else { "Step 2 has not run yet." }
            }
        };
    }
    let evolution = convergence::evolution(patient);
    let absent = evolution.as_ref().err().cloned().unwrap_or_default();
    let median_calcium = signals.get(Source::Step1, SignalKind::Calcium).is_some();
    let has_twin = twin::calcium(patient).is_some();
    let note = html! {
        @if has_twin { span.quiet { ": the twin has the solid line" } }
        @else if !median_calcium { span.quiet { ": only of the fitted cell, since the Tanh model has none" } }
    };
    let mut lines = vec![
        (
            Source::Step1.name(),
            figures::cell_line_name(true).to_owned(),
        ),
        (
            Source::Step2.name(),
            figures::cell_line_name(false).to_owned(),
        ),
    ];
    if has_twin {
        lines.push((Source::Step3.name(), figures::TWIN.to_owned()));
    }
    html! {
        h3 { "Step 2: cell" }
        (legend(&lines))
        @if has_twin { p.quiet { "The cell was fitted against a spring. In the organ it was changed until the beat met the measurements: the twin has that cell, and its own calcium." } }
        div.figures {
            (figure("Active stress", figures::cell(patient, signals, SignalKind::ActiveStress), "No active stress was recorded.", &Markup::default()))
            (figure("Calcium", figures::cell(patient, signals, SignalKind::Calcium), "No calcium was recorded: step 2 has not finished.", &note))
            (figure("Fibre stretch", figures::cell(patient, signals, SignalKind::Stretch), "No stretch was recorded.", &Markup::default()))
            (figure("Differential evolution", evolution.ok(), &absent, &html! { span.quiet { ": best cost, and population mean (thin)" } }))
        }
    }
}

/// Links around a patient's view.
#[derive(Debug, Clone, Default)]
pub struct Around {
    /// Link and name of the patient before and of the one after.
    pub neighbours: [Option<(String, String)>; 2],
    /// Link to what a search for missing effects found for the patient.
    pub missing: Option<String>,
}

/// A part of the view, which has an anchor of its own.
struct Part {
    key: &'static str,
    title: &'static str,
    content: Markup,
}

/// The parts that have something to show, in the order of the workflow.
fn parts(patient: &PatientRecord, signals: &Signals) -> Vec<Part> {
    let drawn = organ_3d::Drawn::of(patient);
    let first = html! {
        (summary(patient))
        (flags(patient, signals))
        (beat(patient, signals, &drawn))
        div.tables { (table::html(&biomarkers::shown(patient))) }
    };
    let numbers = html! {
        h3 { "Numbers" }
        div.tables {
            @if let Some(motion) = motion::by_step(patient) { (table::html(&motion)) }
            @if let Some(table) = tables::step1_parameters(patient) { (table) }
            @if let Some(fit) = &patient.cell_fit {
                (cell_parameters::table(patient, &fit.result))
                (tables::cell_fit(&fit.result))
            }
            @if let Some(table) = tables::passive_and_loads(patient) { (table) }
        }
        (provenance::details(patient))
    };
    let all = [
        ("beat", "Beat", first),
        ("step-1", "Step 1", step1(patient)),
        ("step-2", "Step 2", cell(patient, signals)),
        ("law", "Organ's law", organ_law::part(patient)),
        (
            "uncertainty",
            "Uncertainty",
            posterior::part(patient, signals),
        ),
        (
            "ventricle",
            "3D ventricle",
            organ_3d::part(patient, signals, &drawn),
        ),
        ("numbers", "Numbers", numbers),
    ];
    let part = |(key, title, content)| Part {
        key,
        title,
        content,
    };
    let shown = all.map(part).into_iter();
    shown.filter(|part| !part.content.0.is_empty()).collect()
}

/// The section of a patient: summary, notes, figures and tables.
///
/// - `around`: links to other views and to the parts of this one; without it there are none
#[must_use]
pub fn section(patient: &PatientRecord, signals: &Signals, around: Option<&Around>) -> Markup {
    let (class, sign, words) = badge(patient);
    let anchor = anchor::of(patient.plan.id.as_str());
    let parts = parts(patient, signals);
    html! {
        section.patient.view id=(anchor) {
            header {
                h2 { (patient.plan.id) }
                span class={ "badge " (class) } { (sign) " " (words) }
                span.quiet { "cycle " (significant(patient.plan.step0.cycle_length_ms, 4)) " ms" }
                @if let Some(seconds) = PatientView(patient).wall_s() { span.quiet { "computed in " (duration(seconds)) } }
                @if let Some(around) = around { (neighbours(around)) }
            }
            @if let Some(around) = around {
                div.parts role="navigation" aria-label={ "parts of " (patient.plan.id) } {
                    @for (k, part) in parts.iter().enumerate() {
                        @let to = if k == 0 { anchor.clone() } else { anchor::part(&anchor, part.key) };
                        a href={ "#" (to) } data-part=(part.key) { (part.title) }
                    }
                    @if let Some(missing) = &around.missing { a href=(missing) { "Missing effects" } }
                }
            }
            @for part in &parts { div.part id=(anchor::part(&anchor, part.key)) data-part=(part.key) { (part.content) } }
        }
    }
}

fn neighbours(around: &Around) -> Markup {
    let ways = [("prev", "←", "before"), ("next", "→", "after")];
    html! {
        span.neighbours {
            @for ((rel, sign, place), neighbour) in std::iter::zip(ways, &around.neighbours) {
                @if let Some((link, name)) = neighbour {
                    a rel=(rel) href=(link) title={ "the patient " (place) " this one" } {
                        @if rel == "prev" { (sign) " " (name) } @else { (name) " " (sign) }
                    }
                }
            }
        }
    }
}
