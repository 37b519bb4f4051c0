//! Cohort part of the report: summary, comparison with the paper, table, small plots.

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::record::{PatientRecord, RunRecord, Step1Quality};
use maud::{Markup, html};

use super::figures::legend;
use super::format::{count, duration, fixed, moment, percent, symbol};
use super::plot::{Axis, Chart, Mark, Reading, Scale, SvgText};
use super::summary;
use super::tables::scrolling;
use crate::results::{
    MeanSd, PAPER_STEP1_PERCENT, PAPER_STEP2_PERCENT, PatientView, Source, Step, mean_error,
};

/// Function that gives the link to a patient: an anchor on the same page, or a page of its own.
pub type Link<'a> = &'a dyn Fn(&PatientRecord) -> String;

/// Summary of the run in one or two sentences.
fn sentence(run: &RunRecord) -> String {
    let of = |f: &dyn Fn(&PatientRecord) -> bool| run.patients.iter().filter(|p| f(p)).count();
    let converged = of(&|p| PatientView(p).step1_converged());
    let stalled: Vec<String> = run
        .patients
        .iter()
        .filter_map(|p| match &p.step1 {
            Some(s) if matches!(s.quality, Step1Quality::Stalled { .. }) => Some(format!(
                "{} (iteration {} selected)",
                p.plan.id, s.best_iteration
            )),
            _ => None,
        })
        .collect();
    let verified = of(&|p| p.verification.is_some());
    let failed = of(&|p| p.failure.is_some());
    let mut text = format!(
        "{}: step 1 converged for {converged}",
        count(run.patients.len(), "patient")
    );
    if !stalled.is_empty() {
        let names = if stalled.len() <= 5 {
            format!(": {}", stalled.join(", "))
        } else {
            String::new()
        };
        text += &format!(", stalled for {}{names}", stalled.len());
    }
    let personalised = of(&|p| {
        p.verdict
            .as_ref()
            .is_some_and(|verdict| verdict.personalised)
    });
    text += &format!(
        "; step 2 is verified in the organ for {verified}, and {personalised} of these are personalised"
    );
    let short_of = of(&|p| {
        p.cell_fit
            .as_ref()
            .is_some_and(|f| !f.result.unreachable_targets.is_empty())
    });
    if short_of > 0 {
        text += &format!(", with targets that the cell cannot reach for {short_of}");
    }
    if failed > 0 {
        text += &format!("; {failed} failed");
    }
    let open = run.patients.len() - of(&|p| p.failure.is_some() || p.status.state.is_over());
    if open > 0 {
        text += &format!("; {open} not finished");
    }
    text + "."
}

/// Title, description, summary, time, versions and total computing time.
#[must_use]
pub fn header(run: &RunRecord) -> Markup {
    let mut versions: Vec<String> = run
        .patients
        .iter()
        .flat_map(|p| PatientView(p).tasks())
        .map(|(_, _, _, p)| match &p.commit {
            Some(commit) => format!(
                "{} ({})",
                p.version,
                commit.chars().take(10).collect::<String>()
            ),
            None => p.version.clone(),
        })
        .collect();
    versions.sort();
    versions.dedup();
    let wall: f64 = run
        .patients
        .iter()
        .filter_map(|p| PatientView(p).wall_s())
        .fold(0.0, |a, b| a + b);
    html! {
        header.top {
            h1 { (run.cohort) button.print type="button" title="print the summary: model, errors, notes and patients" hidden { "Print the summary" } }
            @if !run.description.is_empty() { p.lead { (run.description) } }
            (summary::model(run))
            p.summary { (sentence(run)) }
            @if !run.refused.is_empty() {
                div.refused {
                    p.bad { "Not part of this run, because their files have errors:" }
                    ul {
                        @for refused in &run.refused {
                            li { b { (refused.patient) } ": " (refused.errors.join("; ")) }
                        }
                    }
                }
            }
            p.quiet {
                "State of " (moment(&run.as_of)) " · cardiotwin " (run.version)
                @if !versions.is_empty() { " · computed by worker " (versions.join(", ")) }
                " · " (duration(wall)) " of computing · " code { (run.run_directory.display()) }
            }
        }
    }
}

/// A mean with its deviation. Next to a mean of the paper, a sign says which is larger, compared to
/// the digit that both print.
fn mean_sd(value: Option<MeanSd>, paper: Option<f64>) -> Markup {
    let is_larger = |mean: f64, paper: f64| (10.0 * mean).round() > (10.0 * paper).round();
    html! {
        td.num {
            (fixed(value.map(|v| v.mean), 1))
            @if let Some(v) = value {
                @if let Some(sd) = v.sd { span.quiet { " ± " (fixed(Some(sd), 1)) } }
                @match paper.map(|paper| is_larger(v.mean, paper)) {
                    Some(true) => span.warn title="larger than the paper's mean" { " ▲" },
                    Some(false) => span.good title="not larger than the paper's mean" { " ✓" },
                    None => {},
                }
            }
        }
    }
}

/// Mean errors over the cohort next to the paper's, as a plot with a dot per patient and as a table.
#[must_use]
pub fn against_the_paper(run: &RunRecord) -> Markup {
    let patients = &run.patients;
    let n = |step: Step| {
        patients
            .iter()
            .filter(|p| PatientView(p).beat(step).is_some())
            .count()
    };
    if n(Step::Step1) == 0 {
        return html! { p.absent { "No simulation has succeeded yet: there are no errors to show." } };
    }
    let converged = patients
        .iter()
        .filter(|p| PatientView(p).step1_converged())
        .count();
    html! {
        h2 id="errors" { "Errors" }
        p.quiet { "Absolute differences from the measured biomarkers in percent of the measured value; the paper is Jung et al. 2022, Table 2 (seven patients)." }
        div.figures.wide {
            figure { figcaption { b { "Step 1" } span.quiet { ", selected iterate" } } (strip(patients, Step::Step1, &PAPER_STEP1_PERCENT)) }
            figure { figcaption { b { "Step 2" } span.quiet { ", verification beat" } } (strip(patients, Step::Step2, &PAPER_STEP2_PERCENT)) }
            @if n(Step::Step3) > 0 {
                figure { figcaption { b { "Step 3" } span.quiet { ", selected beat; the paper has no step 3" } } (strip(patients, Step::Step3, &[])) }
            }
        }
        (legend_of_strips())
        (scrolling(&html! {
            table {
                caption { "Mean ± SD of the errors, %" }
                thead { tr {
                    th scope="col" { "" }
                    th scope="col" { "step 1, selected iterate" br; span.quiet { "n = " (n(Step::Step1)) } }
                    th scope="col" { "converged only" br; span.quiet { "n = " (converged) } }
                    th scope="col" { "first within tolerance" br; span.quiet { "n = " (n(Step::Step1FirstConverged)) } }
                    th scope="col" { "paper, step 1" br; span.quiet { "n = 7" } }
                    th scope="col" { "step 2" br; span.quiet { "n = " (n(Step::Step2)) } }
                    th scope="col" { "paper, step 2" br; span.quiet { "n = 7" } }
                    @if n(Step::Step3) > 0 { th scope="col" { "step 3" br; span.quiet { "n = " (n(Step::Step3)) } } }
                } }
                tbody {
                    @for (i, b) in Biomarker::TABLE_2.into_iter().enumerate() {
                        @let (paper1, paper2) = (PAPER_STEP1_PERCENT[i], PAPER_STEP2_PERCENT[i]);
                        tr {
                            th scope="row" { (symbol(b.key())) }
                            (mean_sd(mean_error(patients, Step::Step1, b, false), Some(paper1)))
                            (mean_sd(mean_error(patients, Step::Step1, b, true), Some(paper1)))
                            (mean_sd(mean_error(patients, Step::Step1FirstConverged, b, false), Some(paper1)))
                            td.num { (fixed(Some(paper1), 1)) }
                            (mean_sd(mean_error(patients, Step::Step2, b, false), Some(paper2)))
                            td.num { (fixed(Some(paper2), 1)) }
                            @if n(Step::Step3) > 0 { (mean_sd(mean_error(patients, Step::Step3, b, false), None)) }
                        }
                    }
                    tr {
                        th scope="row" { "end-of-beat gap, mL" }
                        @let gap = |step: Step, only: bool| MeanSd::of(patients.iter().map(PatientView).filter(|v| !only || v.step1_converged())
                            .map(|v| v.simulated(step).and_then(|b| b.end_of_beat_gap_ml)));
                        (mean_sd(gap(Step::Step1, false), None)) (mean_sd(gap(Step::Step1, true), None)) (mean_sd(gap(Step::Step1FirstConverged, false), None))
                        td.num { "\u{2013}" } (mean_sd(gap(Step::Step2, false), None)) td.num { "\u{2013}" }
                        @if n(Step::Step3) > 0 { (mean_sd(gap(Step::Step3, false), None)) }
                    }
                }
            }
        }))
    }
}

fn legend_of_strips() -> Markup {
    html! {
        p.legend {
            span.key { svg viewBox="0 0 14 10" aria-hidden="true" { circle.mark.step1 cx="7" cy="5" r="3.4" {} } "patient" }
            span.key { svg viewBox="0 0 34 10" aria-hidden="true" { path.rule.cohort d="M2 5H32" {} } "this cohort's mean" }
            span.key { svg viewBox="0 0 34 10" aria-hidden="true" { path.rule.paper d="M2 5H32" {} } "the paper's mean" }
        }
    }
}

/// Most dots drawn per biomarker.
const DOTS: usize = 150;

/// At most `n` of the errors: all of them in the order of patients if they fit, otherwise a choice
/// at even ranks, which spreads as all errors would.
fn spread_out<'a>(found: &[(&'a PatientRecord, f64)], n: usize) -> Vec<(&'a PatientRecord, f64)> {
    if found.len() <= n {
        return found.to_vec();
    }
    let mut sorted = found.to_vec();
    sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
    // The stride shares no factor with n, so that neighbours in size are scattered across the
    // width.
    (0..n)
        .map(|i| sorted[(i * 61 % n) * (sorted.len() - 1) / (n - 1)])
        .collect()
}

/// Plot with a dot per patient and biomarker, and the means as bars.
fn strip(patients: &[PatientRecord], step: Step, paper: &[f64]) -> Markup {
    let class = step.key();
    let error = |p: &PatientRecord, b| {
        PatientView(p)
            .relative_difference(step, b)
            .map(|d| 100.0 * d.abs())
    };
    let all = patients.iter().flat_map(|p| {
        Biomarker::TABLE_2
            .into_iter()
            .filter_map(move |b| error(p, b))
    });
    let Some(scale) = Scale::linear(all.chain(paper.iter().copied()), true) else {
        return html! { p.absent { "No simulation of this step has succeeded yet." } };
    };
    let mut x = Axis::new("", "", Scale::exact(0.4, 5.6));
    x.fixed = Some(
        std::iter::zip(["P max", "dP/dt max", "dP/dt min", "PTD90", "SV"], 1..)
            .map(|(n, k)| (f64::from(k), n.to_owned()))
            .collect(),
    );
    let mut chart = Chart::new(
        "errors of each patient by biomarker",
        x,
        Axis::new("error (%)", "%", scale),
    );
    chart.size = (420.0, 240.0);
    chart.margins = [58.0, 8.0, 12.0, 26.0];
    chart.reading = Reading::Off;
    for (k, b) in Biomarker::TABLE_2.into_iter().enumerate() {
        let centre = k as f64 + 1.0;
        let found: Vec<_> = patients
            .iter()
            .filter_map(|p| Some((p, error(p, b)?)))
            .collect();
        let dots = spread_out(&found, DOTS);
        for (i, (p, error)) in dots.iter().enumerate() {
            let spread = if dots.len() > 1 {
                i as f64 / (dots.len() - 1) as f64 - 0.5
            } else {
                0.0
            };
            let title = format!(
                "{}: {} %",
                p.plan.id,
                percent(PatientView(p).relative_difference(step, b))
            );
            chart.marks.push(Mark::Point {
                x: centre + 0.36 * spread,
                y: *error,
                class,
                title,
                label: None,
            });
        }
        let bar = |y: f64, class, label: Option<SvgText>| Mark::Segment {
            from: (centre - 0.34, y),
            to: (centre + 0.34, y),
            class,
            label,
        };
        if let Some(paper) = paper.get(k) {
            chart.marks.push(bar(*paper, "paper", None));
        }
        if let Some(mean) = MeanSd::of(found.iter().map(|f| Some(f.1))) {
            chart.marks.push(bar(mean.mean, "cohort", None));
        }
    }
    chart.render()
}

/// Tiles with small pressure plots: id, link and plot of each patient. `left_out` is the number of
/// patients without a tile.
#[must_use]
pub fn small_multiples(tiles: &[(String, String, Markup)], left_out: usize) -> Markup {
    html! {
        h2 id="pressures" { "Pressure at a glance" }
        (legend(&[(Source::Measured.name(), "measured".into()), (Source::Step1.name(), "step 1".into()), (Source::Step2.name(), "step 2".into()), (Source::Step3.name(), "step 3".into())]))
        p.quiet {
            "Pressure (mmHg) over time (ms), with the same pressure axis for all patients."
            @if left_out > 0 { " Failed patients come first, then those with the largest costs of step 1; " (left_out) " others have only their own pages." }
        }
        div.tiles {
            @for (id, href, plot) in tiles { a.tile href=(href) { b { (id) } (plot) } }
        }
    }
}
