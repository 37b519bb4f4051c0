//! Uncertainty of a twin: bands of pressure, volume and loop, and intervals of biomarkers and
//! parameters.

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::outcome::Determination;
use cardiotwin_schemas::posterior::{Band, ParameterSpread, PosteriorResult, Spread};
use cardiotwin_schemas::record::PatientRecord;
use maud::{Markup, html};

use super::figures::figure;
use super::format::{significant, symbol};
use super::plot::{Axis, Chart, Mark, Reading, Scale, Series};
use super::tables::scrolling;
use crate::results::{PatientView, SignalKind, Signals, Source, Step};

/// Width and height of the picture of an interval.
const PICTURE: (f64, f64) = (160.0, 14.0);
/// Absolute correlation from which a pair of parameters is listed.
const STRONG: f64 = 0.7;

/// The part of a patient's section; empty if no posterior was asked for.
#[must_use]
pub fn part(patient: &PatientRecord, signals: &Signals) -> Markup {
    let Some(task) = &patient.posterior else {
        return html! {
            @if let Some(why) = patient.without_intervals() {
                h3 { "Uncertainty" }
                p.absent { "No intervals: " (why) "." }
            }
        };
    };
    let result = &task.result;
    let none = Markup::default();
    html! {
        h3 { "Uncertainty" }
        p.quiet { (words(result)) }
        div.figures {
            (figure("Pressure", band(patient, signals, SignalKind::Pressure, &result.pressure_mmhg), "No pressure was sampled.", &none))
            (figure("Volume", band(patient, signals, SignalKind::Volume, &result.volume_ml), "No volume was sampled.", &none))
            (figure("Pressure-volume loop", pv_loop(patient, result), "No loop was sampled.", &none))
        }
        div.tables {
            (biomarkers(patient, result))
            (parameters(result))
        }
        @let pairs = strong_pairs(result);
        @if !pairs.is_empty() {
            p.quiet { "Strongly correlated: " (pairs.join(", ")) "." }
        }
    }
}

/// Sentences about the assumed noise, the sampling, and doubts about it.
fn words(result: &PosteriorResult) -> String {
    let (noise, deviations, sampling) = (
        &result.deviations.noise,
        &result.deviations,
        &result.sampling,
    );
    let mut text = format!(
        "The shaded bands are 90 % posterior bands. Noise of the traces: {} mmHg, and {} mL per frame",
        significant(noise.pressure_rms_mmhg, 2),
        significant(noise.volume_rms_ml, 2),
    );
    let beyond = [
        (deviations.pressure_discrepancy_mmhg, "mmHg"),
        (deviations.volume_discrepancy_ml, "mL"),
    ];
    let beyond: Vec<String> = beyond
        .iter()
        .filter(|(rms, _)| *rms > 0.0)
        .map(|(rms, unit)| format!("{} {unit}", significant(*rms, 2)))
        .collect();
    if !beyond.is_empty() {
        text += &format!(
            "; the twin's misfit beyond this noise is {}, which counts as an error of the model",
            beyond.join(" and ")
        );
    }
    text += &format!(
        ". {} draws, {} beats of the reduced ventricle",
        result.draws.len(),
        sampling.evaluations
    );
    if let Some(doubt) = sampling.doubt() {
        text += &format!("; the bands are only a rough estimate: {doubt}");
    }
    text += ".";
    if let Some(outside) = result.outside_words() {
        text += &format!(" {outside}");
    }
    text
}

fn timed(patient: &PatientRecord, values: &[f64]) -> Vec<(f64, f64)> {
    let cycle = patient.plan.step0.cycle_length_ms;
    values
        .iter()
        .enumerate()
        .map(|(k, value)| (k as f64 * cycle / values.len() as f64, *value))
        .collect()
}

/// Band of a trace, with the measured trace and the twin's.
fn band(
    patient: &PatientRecord,
    signals: &Signals,
    kind: SignalKind,
    band: &Band,
) -> Option<Chart> {
    let twin = if patient.step3.as_ref().is_some_and(|s| s.best_iteration > 0) {
        Source::Step3
    } else {
        Source::Step2
    };
    let lines = [(Source::Measured, "measured"), (twin, "twin")];
    let drawn = || {
        lines
            .iter()
            .filter_map(|(source, name)| Some((*source, *name, signals.get(*source, kind)?)))
    };
    let values = band.p5.iter().chain(&band.p95).copied();
    let all = values.chain(drawn().flat_map(|(_, _, points)| points.iter().map(|p| p.1)));
    let title = format!("{} ({})", kind.name(), kind.unit());
    let y = Axis::new(
        title.as_str(),
        kind.unit(),
        Scale::linear(all, kind == SignalKind::Pressure)?,
    );
    let x = Axis::new(
        "time (ms)",
        "ms",
        Scale::exact(0.0, patient.plan.step0.cycle_length_ms),
    );
    let mut chart = Chart::new(
        format!("{} of {}, its 90 % band", kind.name(), patient.plan.id),
        x,
        y,
    );
    if band.p5.is_empty() {
        return None;
    }
    chart.marks.push(Mark::Between {
        lower: timed(patient, &band.p5),
        upper: timed(patient, &band.p95),
        class: "most",
    });
    for (source, name, points) in drawn() {
        let within = |p: &&(f64, f64)| p.0 <= patient.plan.step0.cycle_length_ms;
        let points = points.iter().filter(within).copied().collect();
        chart.series.push(Series {
            class: source.name(),
            name: name.to_owned(),
            points,
            dots: false,
        });
    }
    Some(chart)
}

/// The median loop with the intervals of pressure and volume at each sample.
fn pv_loop(patient: &PatientRecord, result: &PosteriorResult) -> Option<Chart> {
    let (p, v) = (&result.pressure_mmhg, &result.volume_ml);
    let n = p.p50.len().min(v.p50.len());
    let x = Axis::new(
        "volume (mL)",
        "mL",
        Scale::linear(v.p5.iter().chain(&v.p95).copied(), false)?,
    );
    let y = Axis::new(
        "pressure (mmHg)",
        "mmHg",
        Scale::linear(p.p5.iter().chain(&p.p95).copied(), true)?,
    );
    let mut chart = Chart::new(
        format!(
            "pressure-volume loop of {} with its 90 % intervals",
            patient.plan.id
        ),
        x,
        y,
    );
    for k in 0..n {
        let (from, to) = ((v.p5[k], p.p50[k]), (v.p95[k], p.p50[k]));
        chart.marks.push(Mark::Segment {
            from,
            to,
            class: "spread",
            label: None,
        });
        let (from, to) = ((v.p50[k], p.p5[k]), (v.p50[k], p.p95[k]));
        chart.marks.push(Mark::Segment {
            from,
            to,
            class: "spread",
            label: None,
        });
    }
    let points = (0..n).map(|k| (v.p50[k], p.p50[k])).collect();
    chart.series.push(Series {
        class: "step3",
        name: "median".to_owned(),
        points,
        dots: false,
    });
    chart.reading = Reading::Nearest;
    Some(chart)
}

fn interval(spread: &Spread) -> Markup {
    html! { td.num { (significant(spread.p5, 3)) " to " (significant(spread.p95, 3)) } }
}

fn biomarkers(patient: &PatientRecord, result: &PosteriorResult) -> Markup {
    let view = PatientView(patient);
    let twin = view
        .simulated(Step::Step3)
        .or_else(|| view.simulated(Step::Step2));
    let rows = Biomarker::ALL
        .into_iter()
        .filter_map(|b| Some((b, result.biomarkers.get(b.key())?)));
    scrolling(&html! {
        table {
            caption { "Biomarkers, 90 % intervals" }
            thead { tr {
                th scope="col" { "" } th.unit scope="col" { "unit" } th.num scope="col" { "measured" } th.num scope="col" { "twin" }
                th.num scope="col" { "5 to 95 %" }
            } }
            tbody {
                @for (b, spread) in rows {
                    tr {
                        th scope="row" { (symbol(b.key())) }
                        td.unit { (b.unit()) }
                        td.num { (view.measured().get(b).map_or_else(|| "–".to_owned(), |v| significant(v, 4))) }
                        td.num { (twin.and_then(|t| t.get(b)).map_or_else(|| "–".to_owned(), |v| significant(v, 4))) }
                        (interval(spread))
                    }
                }
            }
        }
    })
}

fn parameters(result: &PosteriorResult) -> Markup {
    scrolling(&html! {
        table {
            caption { "Parameters, 90 % intervals" }
            thead { tr {
                th scope="col" { "" } th.num scope="col" { "twin" } th.num scope="col" { "5 to 95 %" }
                th scope="col" { "of the prior's (grey)" } th scope="col" { "data say" }
            } }
            tbody {
                @for (name, spread) in &result.parameters {
                    tr {
                        th scope="row" { (symbol(name)) }
                        td.num { (significant(spread.twin, 3)) }
                        (interval(&spread.posterior))
                        td { (picture(spread)) }
                        td { (spread.mark.as_str()) @if spread.excludes_twin() { "; outside its 90 % interval" } }
                    }
                }
            }
        }
    })
}

/// Picture of prior, posterior and twin on one logarithmic axis.
fn picture(spread: &ParameterSpread) -> Markup {
    let (width, height) = PICTURE;
    let log = |value: f64| value.abs().ln();
    let all = [
        spread.prior.p5,
        spread.prior.p95,
        spread.posterior.p5,
        spread.posterior.p95,
        spread.twin,
    ]
    .map(log);
    let low = all.into_iter().fold(f64::INFINITY, f64::min);
    let high = all.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let place = |value: f64| 4.0 + (width - 8.0) * (log(value) - low) / (high - low).max(1e-9);
    let bar = |spread: &Spread| {
        let (a, b) = (place(spread.p5), place(spread.p95));
        (a.min(b), (a - b).abs().max(1.0))
    };
    let ((prior, prior_width), (own, own_width)) = (bar(&spread.prior), bar(&spread.posterior));
    html! {
        svg.of-prior viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height) aria-hidden="true" {
            rect.prior x=(round(prior)) y="3" width=(round(prior_width)) height="8" {}
            rect class={ "own " (class(spread.mark)) } x=(round(own)) y="3" width=(round(own_width)) height="8" {}
            circle.twin cx=(round(place(spread.twin))) cy="7" r="3" {}
        }
    }
}

fn round(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}

fn class(mark: Determination) -> &'static str {
    if mark == Determination::Determined {
        "determined"
    } else {
        "loose"
    }
}

/// Pairs of strongly correlated parameters, the strongest first.
fn strong_pairs(result: &PosteriorResult) -> Vec<String> {
    let names: Vec<&String> = result.parameters.keys().collect();
    let mut pairs: Vec<(f64, String)> = Vec::new();
    for (i, row) in result.correlations.iter().enumerate() {
        for (j, value) in row
            .iter()
            .enumerate()
            .take(i)
            .filter(|(_, value)| value.abs() >= STRONG)
        {
            pairs.push((
                *value,
                format!("{} and {} ({})", names[j], names[i], significant(*value, 2)),
            ));
        }
    }
    pairs.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    pairs.into_iter().map(|(_, text)| text).collect()
}
