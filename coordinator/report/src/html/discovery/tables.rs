//! Tables of a search's findings.

use cardiotwin_schemas::discover::{DiscoverCase, DiscoverCases, FiniteElementGap, GapAt, Place};
use maud::{Markup, html};

use crate::html::anchor;
use crate::html::format::{fixed, significant, symbol};
use crate::html::tables::scrolling;
use crate::results::discovery::faults;
use crate::results::discovery::finite_element::{change, rms_of};
use crate::results::discovery::pool::{accepted_in, pool};
use crate::results::discovery::words::{missing, plain, probability, split_unit, strength};

/// Number of candidates shown in the ranking.
const SHOWN: usize = 8;

fn number(value: Option<f64>) -> Markup {
    html! { td.num { (fixed(value, 2)) } }
}

/// The findings in a few words.
#[must_use]
pub fn verdict(case: &DiscoverCase) -> String {
    match missing(&case.found, plain).as_str() {
        "none" => "nothing is missing".to_owned(),
        words => words.to_owned(),
    }
}

/// Table of the ranked candidates.
#[must_use]
pub fn ranking(case: &DiscoverCase) -> Markup {
    let found = &case.found;
    scrolling(&html! { table {
        caption { "Candidates" }
        thead { tr { th { "effect" } th { "probability" } th { "ΔBIC" } th { "evidence" } th.unit { "strength (95 %)" } th.unit { "in 3D" } } }
        tbody { @for effect in found.findings.effects.iter().take(SHOWN) {
            @let accepted = found.findings.accepted.contains(&effect.name);
            tr {
                th scope="row" { (plain(&effect.name)) @if accepted { @if case.confirmed == Some(false) { span.warn { " ▲ accepted, not confirmed" } } @else { span.good { " ● accepted" } } } @if effect.artefact { span.quiet { " artefact" } } }
                td.num { (probability(effect.probability, 3)) }
                td.num { (format!("{:.1}", effect.delta_bic)) }
                td.num { (format!("{:.1}", effect.log_evidence)) }
                td { (strength(effect)) @if !effect.plausible { span.quiet { " (too weak, or at the edge of its range)" } } }
                td title=[effect.in_3d.how.as_ref()] { (effect.in_3d.way.replace('-', " ")) }
            }
        } }
    } })
}

/// Table of the gap by signal and phase, before and after, on fitted and on held-out data.
#[must_use]
pub fn gaps(case: &DiscoverCase) -> Markup {
    let found = &case.found;
    scrolling(&html! { table {
        caption { "Gap: rms residual over the noise" }
        thead { tr { th { "" } th { "before" } th { "after" } th { "held out, before" } th { "held out, after" } } }
        tbody { @for gap in &found.findings.gaps { tr {
            th scope="row" { (place_of(gap)) }
            (number(Some(gap.before))) (number(Some(gap.after))) (number(gap.heldout_before)) (number(gap.heldout_after))
        } } }
        tfoot { tr {
            th scope="row" { "all, with scalars" }
            (number(Some(found.findings.gap_before))) (number(Some(found.findings.gap_after)))
            (number(found.findings.gap_heldout_before)) (number(found.findings.gap_heldout_after))
        } }
    } })
}

/// Table of the gap of the finite-element ventricle by signal and phase, before and after.
#[must_use]
pub fn finite_element(gap: &FiniteElementGap) -> Markup {
    let rms = |before: f64, after: f64| html! { td.num { (format!("{before:.1}")) } td.num { (format!("{after:.1}")) } };
    scrolling(&html! { table {
        caption { "Gap of the finite-element ventricle: rms residual over the noise" }
        thead { tr { th { "" } th { "before" } th { "after" } } }
        tbody { @for gap in &gap.gaps { tr {
            th scope="row" { (place_of(gap)) }
            (number(Some(gap.before))) (number(Some(gap.after)))
        } } }
        tfoot {
            tr { th scope="row" { "pressure, rms in mmHg" } (rms(gap.before.pressure_rms_mmhg, gap.after.pressure_rms_mmhg)) }
            tr { th scope="row" { "volume, rms in mL" } (rms(gap.before.volume_rms_ml, gap.after.volume_rms_ml)) }
        }
    } })
}

fn place_of(gap: &GapAt) -> String {
    if gap.phase == "beat" {
        format!("{}, whole beat", gap.signal)
    } else {
        format!("{}, {}", gap.signal, plain(&gap.phase))
    }
}

/// Table of the places where the base model and the data disagree.
#[must_use]
pub fn places(case: &DiscoverCase) -> Markup {
    let found = &case.found;
    let after = |place: &Place| {
        found
            .findings
            .where_after
            .iter()
            .find(|p| p.signal == place.signal && p.phase == place.phase)
    };
    scrolling(&html! { table {
        caption { "Where the base model and the data disagree" }
        thead { tr { th { "" } th { "data − model" } th { "z" } th { "share" } th { "z after" } th.unit { "moves" } } }
        tbody { @for place in &found.findings.places { tr {
            th scope="row" { (plain(&place.signal)) @if place.phase != "beat" { ", " (plain(&place.phase)) } }
            td.num { (format!("{:+.2}", place.size)) " " span.quiet { (place.unit) } }
            td.num { (format!("{:+.1}", place.z)) }
            td.num { @if place.share > 0.0 { (format!("{:.0}", 100.0 * place.share)) " %" } }
            td.num { @if let Some(after) = after(place) { (format!("{:+.1}", after.z)) } }
            td { @for (i, name) in place.biomarkers.iter().enumerate() { @if i > 0 { ", " } (name) } }
        } } }
    } })
}

/// Table of measured biomarkers and those before and after.
#[must_use]
pub fn biomarkers(case: &DiscoverCase) -> Markup {
    let value =
        |value: Option<f64>| value.map_or("\u{2013}".to_owned(), |value| significant(value, 4));
    scrolling(&html! { table {
        caption { "Biomarkers" }
        thead { tr { th { "" } th { "measured" } th { "before" } th { "after" } } }
        tbody { @for row in &case.found.biomarkers { tr {
            th scope="row" { (symbol(&row.name)) }
            td.num { (value(Some(row.measured))) } td.num { (value(row.before)) } td.num { (value(row.after)) }
        } } }
    } })
}

/// Table of indices of heart and vessels before and after; empty without accepted effects.
#[must_use]
pub fn indices(case: &DiscoverCase) -> Markup {
    let rows = &case.found.indices;
    if rows.is_empty() || case.found.findings.none {
        return html! {};
    }
    scrolling(&html! { table {
        caption { "Indices of the fitted heart" }
        thead { tr { th { "" } th { "before" } th { "after" } } }
        tbody { @for row in rows {
            @let (label, unit) = split_unit(&row.name);
            tr {
                th scope="row" { (plain(label)) @if !unit.is_empty() { " (" (unit) ")" } }
                td.num { (significant(row.before, 3)) } td.num { (significant(row.after, 3)) }
            }
        } }
    } })
}

/// List of effects that cannot be told apart, measurements that would decide, effects that these
/// data cannot show, and variables on which an unexplained gap depends.
#[must_use]
pub fn lists(case: &DiscoverCase) -> Markup {
    let found = &case.found;
    let names = |list: &[String]| {
        list.iter()
            .map(|name| plain(name))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let without = |name: &String| {
        let entry = found
            .findings
            .not_identifiable_without
            .iter()
            .find(|n| n.name == *name);
        let data = entry.map_or(String::new(), |n| n.would_show.join("; "));
        if data.is_empty() {
            plain(name)
        } else {
            format!("{} ({data})", plain(name))
        }
    };
    let mut rows = vec![
        ("Indistinguishable from", names(&found.findings.confusable)),
        (
            "Deciding measurement",
            found.findings.deciding_measurement.join("; "),
        ),
        (
            "Not identifiable from these data",
            found
                .findings
                .not_identifiable
                .iter()
                .map(without)
                .collect::<Vec<_>>()
                .join(", "),
        ),
    ];
    for class in &found.findings.classes {
        rows.push(("Not told apart by these data", names(&class.effects)));
    }
    if let Some(gap) = (found.findings.unexplained.as_ref()).or(found.findings.remaining.as_ref()) {
        let depends = gap.depends_on.iter().map(|d| {
            format!(
                "{} on {} ({:.0} %)",
                d.signal,
                plain(&d.variable),
                100.0 * d.share
            )
        });
        rows.push((
            "Dependence of the gap that no effect explains",
            depends.collect::<Vec<_>>().join(", "),
        ));
    }
    for effect in found
        .findings
        .effects
        .iter()
        .filter(|effect| found.findings.accepted.contains(&effect.name))
    {
        rows.extend(effect.remedy.clone().map(|remedy| ("To do", remedy)));
    }
    rows.retain(|(_, text)| !text.is_empty());
    html! { @if !rows.is_empty() { ul.notes { @for (label, text) in &rows { li { span { b { (label) ": " } (text) } } } } } }
}

/// Table with a row for each patient.
#[must_use]
pub fn patients(cases: &DiscoverCases) -> Markup {
    scrolling(&html! { table {
        caption { "Patients" }
        thead { tr {
            th { "patient" } th.unit { "missing" } th { "gap before" } th { "after" } th { "held out, before" } th { "after" } th.unit { "indistinguishable from" }
        } }
        tbody { @for case in cases.values() {
            @let found = &case.found;
            tr {
                th scope="row" { a href={ "#" (anchor::missing(&case.case)) } { (case.case) } }
                td { (verdict(case)) }
                (number(Some(found.findings.gap_before))) (number(Some(found.findings.gap_after)))
                (number(found.findings.gap_heldout_before)) (number(found.findings.gap_heldout_after))
                td { (found.findings.confusable.iter().map(|name| plain(name)).collect::<Vec<_>>().join(", ")) }
            }
        } }
    } })
}

/// Table of the whole beat's misfit on the finite-element ventricle, with a row for each patient and
/// signal.
#[must_use]
pub fn finite_elements(cases: &DiscoverCases) -> Markup {
    let simulated = cases
        .values()
        .filter_map(|case| Some((case, case.finite_element.as_ref()?)));
    scrolling(&html! { table {
        caption { "Misfit of the finite-element ventricle over the whole beat, rms" }
        thead { tr { th { "patient" } th.unit { "effects" } th.unit { "trace" } th { "before" } th { "after" } th { "change" } } }
        tbody { @for (case, gap) in simulated { @for (name, before, after) in rms_of(gap) { tr {
            th scope="row" { a href={ "#" (anchor::missing(&case.case)) } { (case.case) } }
            td { (verdict(case)) } td { (name) }
            (number_of(before, 1)) (number_of(after, 1)) td.num { (change(before, after)) }
        } } } }
    } })
}

/// Table of the misses of the cohort's run, and whether the organ's model or the cell causes them.
#[must_use]
pub fn run_misses(cases: &DiscoverCases) -> Markup {
    let rms = |value: f64| number_of(value, 1);
    scrolling(&html! { table {
        caption { "Misfit of the run's beats to the measured traces, rms" }
        thead { tr {
            th { "patient" } th.unit { "trace" } th { "step 1" } th { "verification" } th { "twin" } th { "organ's model" } th { "cell" } th.unit { "mostly a fault of" }
        } }
        tbody { @for case in cases.values() { @if let Some(run) = &case.run { @for (name, unit, misses) in faults::traces(run) { tr {
            th scope="row" { (case.case) }
            td { (name) ", " (unit) }
            (rms(misses.step1)) (rms(misses.verification)) (rms(misses.twin)) (rms(misses.of_organ())) (rms(misses.of_cell()))
            td { (faults::whose(&misses)) }
        } } } } }
    } })
}

fn number_of(value: f64, digits: usize) -> Markup {
    html! { td.num { (format!("{value:.digits$}")) } }
}

/// Table of the evidence pooled over all patients.
#[must_use]
pub fn pooled(cases: &DiscoverCases) -> Markup {
    scrolling(&html! { table {
        caption { "All patients together" }
        thead { tr { th { "effect" } th { "accepted in" } th { "pooled evidence" } th.unit { "a fault of" } th.unit { "dominated by" } } }
        tbody { @for effect in pool(cases.values().map(|c| (c.case.as_str(), &c.found))) { tr {
            th scope="row" { (plain(&effect.name)) }
            td.num { (accepted_in(&effect, cases.len())) }
            td.num { (format!("{:.1}", effect.log_evidence)) }
            td { @if effect.of_the_model { "the organ's model" } @else if effect.accepted_in > 0 { "single patients" } }
            td { (effect.dominated_by.as_deref().unwrap_or_default()) }
        } } }
    } })
}

/// Table of the periodic beat at the filling pressure in the patient's file.
#[must_use]
pub fn filling(cases: &DiscoverCases) -> Markup {
    let one = |value: Option<f64>| html! { td.num { (fixed(value, 1)) } };
    scrolling(&html! { table {
        caption { "End-diastolic volume and late filling of the periodic beat with the file's filling pressure (mL)" }
        thead { tr {
            th { "patient" } th { "measured" } th { "before" } th { "after" } th { "error before" } th { "error after" }
            th { "late filling, rms before" } th { "rms after" }
        } }
        tbody { @for case in cases.values() { @if let Some(f) = &case.found.stated_filling { tr {
            th scope="row" { (case.case) }
            (one(Some(f.measured_ml))) (one(f.before_ml)) (one(f.after_ml))
            (one(f.before_ml.map(|v| v - f.measured_ml))) (one(f.after_ml.map(|v| v - f.measured_ml)))
            (one(f.late_filling_before_ml)) (one(f.late_filling_after_ml))
        } } } }
    } })
}
