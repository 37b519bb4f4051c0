//! Findings of searches for missing effects: a section per patient, the cohort's tables, a page,
//! and a picture.

mod figures;
mod tables;

use std::path::Path;

use cardiotwin_schemas::discover::{DiscoverCase, DiscoverCases};
use maud::{Markup, html};

use super::anchor;
use super::figures::{figure, legend};
use super::page::{page, write};
use super::plot::stacked;
use crate::results::WriteError;
use crate::results::discovery::finite_element::rms_of;
use crate::results::discovery::paragraph::p_in_words;
use crate::results::discovery::words;
use crate::results::tables::{discovery, discovery_cohort};
use crate::table;
use tables::verdict;

/// Number of candidates shown in the ranking.
const SHOWN: usize = 8;

/// Writes the page of a run of searches.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_discovery(name: &str, cases: &DiscoverCases, out: &Path) -> Result<(), WriteError> {
    let content = html! {
        header.top { h1 { (name) } }
        (part(cases))
    };
    write(
        out,
        &page(
            &format!("{name} · missing effects · cardiotwin"),
            &nav(name, cases),
            &content,
        ),
    )
}

fn nav(name: &str, cases: &DiscoverCases) -> Markup {
    html! {
        nav aria-label="patients" {
            div.navhead {
                a.home href="#" { (name) }
                button.theme type="button" title="light or dark" aria-label="switch between light and dark" { "◐" }
            }
            ol { @for id in cases.keys() { li { a href={ "#" (anchor::missing(id)) } { (id) } } } }
        }
    }
}

/// The cohort's tables and a section for each patient.
#[must_use]
pub fn part(cases: &DiscoverCases) -> Markup {
    let title = html! { h2 { "Missing effects of the model" } };
    if let [case] = cases.values().collect::<Vec<_>>()[..] {
        return html! { div.view.beyond id="missing" { (title) (section(case, "patient")) } };
    }
    html! {
        div.view.beyond id="missing" { (title) (cohort(cases)) }
        @for case in cases.values() { (section(case, "patient beyond view")) }
    }
}

/// Tables of the effects missing in the patients and of the gaps with and without them; empty for a
/// single patient.
#[must_use]
pub fn cohort(cases: &DiscoverCases) -> Markup {
    let to_patient = |_: usize, id: &str| format!("#{}", anchor::missing(id));
    html! {
        @if cases.len() > 1 {
            p { "An effect that is missing in most patients indicates a fault of the organ's model; one that is missing in a single patient is specific to that patient." }
            (table::html(&discovery_cohort::patients(cases).linked(to_patient)))
            (table::html(&discovery_cohort::pooled(cases)))
            @for table in [
                discovery_cohort::run_misses(cases).linked(to_patient),
                discovery_cohort::finite_elements(cases).linked(to_patient),
                discovery_cohort::filling(cases).linked(to_patient),
            ].iter().filter(|table| !table.rows.is_empty()) { (table::html(table)) }
        }
    }
}

/// - `class`: classes of the section, among them `view` if it is a view of its own
fn section(case: &DiscoverCase, class: &str) -> Markup {
    let found = &case.found;
    let reduced = figures::Compared::reduced(case);
    let with = if found.findings.none {
        "base model".to_owned()
    } else {
        format!("with {}", verdict(case))
    };
    let mut keys = vec![
        ("measured", "measured".to_owned()),
        ("before", "base model".to_owned()),
    ];
    if !found.findings.none {
        keys.push(("after", with));
    }
    html! {
        section class=(class) id=(anchor::missing(&case.case)) {
            header { h2 { (case.case) } span.badge { (verdict(case)) } }
            p.summary { (case.summary) }
            (legend(&keys))
            (traces_and_residuals(&reduced, ""))
            div.tables {
                @for table in [
                    discovery::ranking(case, SHOWN),
                    discovery::gaps(case),
                    discovery::places(case),
                    tables::biomarkers(case),
                    tables::indices(case),
                ].iter().filter(|table| !table.rows.is_empty()) { (table::html(table)) }
            }
            (tables::lists(case))
            (in_3d(case))
            p.quiet {
                "seed " (found.seed) " · an effect is named if its evidence, prior odds included, exceeds " (format!("{:.1}", found.findings.threshold))
                " · " (p_in_words(found.findings.p_value)) " · " (found.n_evaluations) " parameter sets · data "
                @for (role, hash) in &found.data { (role) " " code { (hash.chars().take(12).collect::<String>()) } " " }
            }
        }
    }
}

/// Traces of both signals and their residuals.
///
/// - `place`: end of each title
fn traces_and_residuals(compared: &figures::Compared<'_>, place: &str) -> Markup {
    let band = html! { ", data minus model; the band is twice the noise" };
    let both = [
        ("Pressure", "pressure", figures::Which::Pressure),
        ("Volume", "volume", figures::Which::Volume),
    ];
    html! {
        div.figures.dotted {
            @for (title, _, which) in both {
                (figure(&format!("{title}{place}"), figures::signal(compared, which), "", &html! {}))
            }
            @for (_, name, which) in both {
                (figure(&format!("Residual of the {name}{place}"), figures::residual(compared, which), "", &band))
            }
        }
    }
}

/// Traces, residuals and gap of the finite-element ventricle; empty if it was not simulated.
fn in_3d(case: &DiscoverCase) -> Markup {
    let (Some(gap), Some(compared)) = (
        &case.finite_element,
        figures::Compared::finite_element(case),
    ) else {
        return Markup::default();
    };
    let keys = [
        ("measured", "measured".to_owned()),
        ("before", "without".to_owned()),
        ("after", format!("with {}", verdict(case))),
    ];
    html! {
        h3 { "On the finite-element ventricle" }
        p.quiet { "The same patient on a mesh of " (gap.nodes) " nodes, personalised without and with the accepted effects; the beats of both twins." }
        (legend(&keys))
        (traces_and_residuals(&compared, " in 3D"))
        div.tables { (table::html(&discovery::finite_element(gap))) }
    }
}

/// Text of an SVG file that shows the gap, the accepted effects and the remaining gap, on the
/// finite-element ventricle where it was simulated. `None` if there is nothing to draw.
#[must_use]
pub fn discovery_svg(case: &DiscoverCase) -> Option<String> {
    let found = &case.found;
    let shares = |signal: &str| -> f64 {
        found
            .findings
            .places
            .iter()
            .filter(|p| p.signal == signal)
            .map(|p| p.z.powi(2))
            .sum()
    };
    let which = if shares("volume") >= shares("pressure") {
        figures::Which::Volume
    } else {
        figures::Which::Pressure
    };
    let compared =
        figures::Compared::finite_element(case).unwrap_or(figures::Compared::reduced(case));
    let mut charts = vec![
        figures::signal(&compared, which)?,
        figures::residual(&compared, which)?,
    ];
    charts[1].size.1 = 210.0;
    for chart in &mut charts {
        chart.size.0 = 640.0;
    }
    let held = match (
        found.findings.gap_heldout_before,
        found.findings.gap_heldout_after,
    ) {
        (Some(before), Some(after)) => format!("; on held-out data {before:.2} to {after:.2}"),
        _ => String::new(),
    };
    let mut lines = vec![format!(
        "gap {:.2} to {:.2} times the noise{held}",
        found.findings.gap_before, found.findings.gap_after
    )];
    lines.extend(case.finite_element.as_ref().map(|gap| {
        let of = |(name, before, after)| format!("{name} {before:.1} to {after:.1}");
        let both = rms_of(gap).map(of).join("; ");
        format!("finite elements, {} nodes, rms: {both}", gap.nodes)
    }));
    lines.extend(
        found
            .findings
            .effects
            .iter()
            .filter(|e| found.findings.accepted.contains(&e.name))
            .map(words::strength),
    );
    Some(stacked(
        &format!("{}: {}", case.case, verdict(case)),
        &lines,
        &charts,
    ))
}

#[cfg(test)]
mod tests {
    use cardiotwin_findings::{
        finite_element, gap, kick, likely, nothing, one_of_two, unexplained,
    };
    use cardiotwin_schemas::discover::Discovered;

    use super::*;
    use crate::results::discovery::paragraph;

    fn case(id: &str, found: Discovered) -> DiscoverCase {
        DiscoverCase {
            schema_version: cardiotwin_schemas::formats::DISCOVER_CASE.version,
            case: id.into(),
            summary: paragraph::summary(&found),
            confirmed: found.findings.confirmed(),
            task: "t".into(),
            run: None,
            finite_element: None,
            found,
        }
    }

    #[test]
    fn a_section_shows_ranking_gap_places_and_both_models() {
        let html = section(&case("P<1>", kick()), "patient").into_string();
        for part in [
            "P&lt;1&gt;",
            "●</span> named",
            "whole beat",
            "whole heart volume",
            "with atrial kick",
            "class=\"line after\"",
            "Hard to tell from",
        ] {
            assert!(html.contains(part), "{part} is not in {html}");
        }
        assert_eq!(html.matches("class=\"band noise\"").count(), 2);
        let html = section(&case("P2", nothing()), "patient").into_string();
        assert!(html.contains("nothing is missing") && !html.contains("class=\"line after\""));
        assert!(
            section(&case("P3", unexplained()), "patient")
                .into_string()
                .contains("Dependence of the gap that no effect explains")
        );
        for (found, badge) in [
            (gap(), "a gap that no effect explains"),
            (likely(), "undecided"),
            (one_of_two(), "delayed relaxation or dyssynchrony"),
        ] {
            let html = section(&case("P4", found), "patient").into_string();
            assert!(
                html.contains(&format!("<span class=\"badge\">{badge}</span>"))
                    && !html.contains("nothing is missing"),
                "{html}"
            );
        }
    }

    #[test]
    fn a_cohort_shows_pooled_evidence_and_a_page_holds_all() {
        let cases: DiscoverCases = [("P1", kick()), ("P2", nothing())]
            .map(|(id, found)| (id.to_owned(), case(id, found)))
            .into();
        let html = cohort(&cases).into_string();
        assert!(
            html.contains("1 of 2") && html.contains("filling pressure") && html.contains("−20.0"),
            "{html}"
        );
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("report.html");
        write_discovery("made up", &cases, &out).unwrap();
        // The name space of SVG is not an address that a browser would load.
        let page = std::fs::read_to_string(out)
            .unwrap()
            .replace("http://www.w3.org/2000/svg", "");
        assert!(page.contains("href=\"#missing-P2\"") && page.contains("id=\"missing-P2\""));
        assert!(!page.contains("http://") && !page.contains("https://"));
    }

    #[test]
    fn the_finite_element_ventricle_is_drawn_where_it_was_simulated() {
        let mut case = case("P1", kick());
        assert!(
            !section(&case, "patient")
                .into_string()
                .contains("finite-element")
        );
        case.finite_element = Some(finite_element(&case.found));
        let html = section(&case, "patient").into_string();
        for part in [
            "On the finite-element ventricle",
            "1043 nodes",
            "6.6",
            "1.3",
        ] {
            assert!(html.contains(part), "{part} is not in {html}");
        }
        assert_eq!(html.matches("class=\"band noise\"").count(), 4);
        let svg = discovery_svg(&case).unwrap();
        assert!(
            svg.contains("1043 nodes, rms: pressure, mmHg 6.6 to 4.1; volume, mL 4.4 to 1.3"),
            "{svg}"
        );
        let cases: DiscoverCases =
            [("P1".to_owned(), case.clone()), ("P2".to_owned(), case)].into();
        let html = cohort(&cases).into_string();
        assert!(
            html.contains("Misfit of the finite-element ventricle")
                && html.contains("\u{2212}70 %"),
            "{html}"
        );
    }

    #[test]
    fn the_picture_says_gap_name_and_shrink() {
        let svg = discovery_svg(&case("P1", kick())).unwrap();
        for part in [
            "P1: atrial kick",
            "gap 1.61 to 0.94 times the noise; on held-out data 1.72 to 1.10",
            "amplitude 7.90 mmHg",
            "atrial",
        ] {
            assert!(svg.contains(part), "{part} is not in {svg}");
        }
        assert!(svg.starts_with("<svg xmlns") && !svg.contains("var("));
        let mut unconfirmed = case("P1", kick());
        let found = unconfirmed.found.findings.gap_heldout_before;
        unconfirmed.found.findings.gap_heldout_after = found;
        let svg = discovery_svg(&unconfirmed).unwrap();
        for part in [
            "P1: atrial kick (not confirmed on held-out data)",
            "on held-out data 1.72 to 1.72",
        ] {
            assert!(svg.contains(part), "{part} is not in {svg}");
        }
    }

    #[test]
    fn an_effect_that_held_out_data_do_not_confirm_is_marked_in_every_table() {
        let mut idle = kick();
        for after in [idle.findings.gap_heldout_before, None] {
            idle.findings.gap_heldout_after = after;
            let cases: DiscoverCases = [("P1", idle.clone()), ("P2", kick())]
                .map(|(id, found)| (id.to_owned(), case(id, found)))
                .into();
            let html = section(&cases["P1"], "patient").into_string();
            for part in [
                "▲</span> named, not confirmed",
                "<span class=\"badge\">atrial kick (not confirmed on held-out data)</span>",
                "with atrial kick (not confirmed on held-out data)",
                "held-out pressure and volume",
            ] {
                assert!(html.contains(part), "{part} is not in {html}");
            }
            assert!(!html.contains("●</span> named"), "{html}");
            let html = cohort(&cases).into_string();
            assert!(
                html.contains("2 of 2, 1 not confirmed")
                    && html.contains("<td>atrial kick (not confirmed on held-out data)</td>"),
                "{html}"
            );
        }
    }
}
