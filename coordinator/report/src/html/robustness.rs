//! The page of a robustness sweep: loops and traces as in Figure 6 of Jung et al. 2022, and tables
//! like its Tables 3 to 10.

use std::collections::HashMap;
use std::path::Path;

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::robustness::{
    Condition, MemberRole, PatientRobustness, RobustnessResult, RobustnessTable, TableKind,
    Uncertainty,
};
use maud::{Markup, html};

use super::figures::{at, figure, legend};
use super::format::{count, significant};
use super::page::{page, write};
use super::plot::{Axis, Chart, Reading, Scale, Series};
use crate::results::tables::robustness;
use crate::results::{SignalKind, Signals, Source, WriteError};
use crate::table::{self, sign_of};

/// Drawing order as in Figure 6: samples below the originals, step 2 below step 1.
const LINES: [(MemberRole, Source, &str); 4] = [
    (MemberRole::Sample, Source::Step2, "step2 sample"),
    (MemberRole::Sample, Source::Step1, "step1 sample"),
    (MemberRole::Original, Source::Step2, "step2 original"),
    (MemberRole::Original, Source::Step1, "step1 original"),
];

/// Function that gives the points of a line from a member's signals and a step.
type PointsOf<'a> = &'a dyn Fn(&Signals, Source) -> Option<Vec<(f64, f64)>>;

/// Writes the page of a sweep.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_robustness(
    result: &RobustnessResult,
    run: &RunRecord,
    out: &Path,
) -> Result<(), WriteError> {
    let records: HashMap<&PatientId, &PatientRecord> =
        run.patients.iter().map(|p| (&p.plan.id, p)).collect();
    let title = format!("{} · robustness · cardiotwin", result.cohort);
    let content = html! {
        h1 { (result.cohort) ": robustness against " (words(result.spec.over)) }
        p.lead { (lead(result)) }
        @for patient in &result.patients { (section(result, patient, &records)) }
    };
    write(out, &page(&title, &nav(result), &content))
}

fn nav(result: &RobustnessResult) -> Markup {
    html! {
        nav aria-label="patients" {
            div.navhead {
                a.home href="#" { (result.cohort) }
                button.theme type="button" title="light or dark" aria-label="switch between light and dark" { "◐" }
            }
            ol { @for p in &result.patients { li { a href={ "#p-" (p.patient) } { (p.patient) } } } }
        }
    }
}

fn words(over: Uncertainty) -> &'static str {
    match over {
        Uncertainty::Data => "uncertain data",
        Uncertainty::Guess => "initial guesses",
    }
}

fn lead(result: &RobustnessResult) -> String {
    let spec = &result.spec;
    let what = match spec.over {
        Uncertainty::Data => "the biomarkers that step 1 aims at",
        Uncertainty::Guess => "the initial guesses of both steps",
    };
    let seeds = match spec.n_seeds {
        0 => String::new(),
        n => format!(
            "; {} that differ only in step 2's seed",
            count(n as usize, "member")
        ),
    };
    format!(
        "{} of whole personalisations from a Latin hypercube over ±{} % of {what}{seeds}. \
         Differences are absolute values relative to the original personalisation.",
        count(spec.n_samples as usize, "sample"),
        significant(100.0 * spec.range, 3)
    )
}

fn section(
    result: &RobustnessResult,
    patient: &PatientRobustness,
    records: &HashMap<&PatientId, &PatientRecord>,
) -> Markup {
    let failed: Vec<_> = patient
        .members
        .iter()
        .filter(|m| m.failure.is_some())
        .collect();
    html! {
        section.patient id={ "p-" (patient.patient) } {
            header { h2 { (patient.patient) } }
            (conditions(&patient.conditions))
            @if !failed.is_empty() {
                ul.notes {
                    @for m in failed {
                        li { span.sign.bad { "✕" } span { b { (m.id) } ": " (m.failure.as_deref().unwrap_or_default()) } }
                    }
                }
            }
            (figure_6(patient, records))
            @for table in &patient.tables { (spread_table(table, result.spec.over, false)) }
            @if !patient.inputs.is_empty() {
                (table::html(&robustness::spreads("Varied inputs", &patient.inputs, false)))
            }
            @if !patient.seed_tables.is_empty() {
                h3 { "With only step 2's seed varied" }
                @for table in &patient.seed_tables { (spread_table(table, result.spec.over, true)) }
            }
            @if !patient.target_errors.is_empty() { (table::html(&robustness::errors(patient))) }
        }
    }
}

fn conditions(conditions: &[Condition]) -> Markup {
    html! {
        ul.notes {
            @for c in conditions {
                @let (word, tone) = robustness::met(c);
                @let (class, sign) = sign_of(tone);
                li { span class={ "sign " (class) } aria-hidden="true" { (sign) } span { b { (word) ": " } (c.name) ": " (c.found) ", limit " (c.limit) } }
            }
        }
    }
}

/// Loops, pressures and volumes of both steps. Samples are drawn light, originals bold.
fn figure_6(patient: &PatientRobustness, records: &HashMap<&PatientId, &PatientRecord>) -> Markup {
    let read = |role: MemberRole| {
        let members = patient.members.iter().filter(move |m| m.role == role);
        members
            .filter_map(|m| {
                records
                    .get(&m.id)
                    .map(|r| (m.id.to_string(), Signals::read(r)))
            })
            .collect::<Vec<_>>()
    };
    let signals: HashMap<&str, Vec<(String, Signals)>> = [MemberRole::Original, MemberRole::Sample]
        .map(|role| (role.word(), read(role)))
        .into();
    let cycle = patient
        .members
        .iter()
        .find_map(|m| Some(records.get(&m.id)?.plan.step0.cycle_length_ms))
        .unwrap_or(1.0);
    let lines = |points: PointsOf<'_>| {
        let mut series = Vec::new();
        for (role, source, class) in LINES {
            for (id, signals) in &signals[role.word()] {
                if let Some(points) = points(signals, source) {
                    series.push(Series {
                        class,
                        name: format!("{id}, {}", source.name()),
                        points,
                        dots: false,
                    });
                }
            }
        }
        series
    };
    let over_time = |kind: SignalKind, title: &str| {
        let series = lines(&|signals, source| signals.get(source, kind).map(<[_]>::to_vec));
        let values: Vec<f64> = series
            .iter()
            .flat_map(|s| s.points.iter().map(|p| p.1))
            .collect();
        let y = Axis::new(
            title,
            kind.unit(),
            Scale::linear(values, kind == SignalKind::Pressure)?,
        );
        let x = Axis::new("time (ms)", "ms", Scale::exact(0.0, cycle));
        let mut chart = Chart::new(
            format!("{} of {} over time", kind.name(), patient.patient),
            x,
            y,
        );
        chart.series = series;
        chart.reading = Reading::Nearest;
        Some(chart)
    };
    let loops = || {
        let series = lines(&|signals, source| {
            let volume = signals.get(source, SignalKind::Volume)?;
            let pressure = signals.get(source, SignalKind::Pressure)?;
            Some(
                pressure
                    .iter()
                    .filter_map(|(t, p)| Some((at(volume, *t)?, *p)))
                    .collect(),
            )
        });
        let all = || series.iter().flat_map(|s| s.points.iter());
        let x = Axis::new(
            "volume (mL)",
            "mL",
            Scale::linear(all().map(|p| p.0), false)?,
        );
        let y = Axis::new(
            "pressure (mmHg)",
            "mmHg",
            Scale::linear(all().map(|p| p.1), true)?,
        );
        let mut chart = Chart::new(
            format!("pressure-volume loops of {}", patient.patient),
            x,
            y,
        );
        chart.series = series;
        chart.reading = Reading::Nearest;
        Some(chart)
    };
    let absent = "No simulation has finished yet.";
    let none = html! {};
    html! {
        h3 { "Pressure and volume (Figure 6)" }
        (legend(&[
            ("step1 original", "step 1, original".to_owned()),
            ("step1 sample", "samples".to_owned()),
            ("step2 original", "step 2, original".to_owned()),
            ("step2 sample", "samples".to_owned()),
        ]))
        div.figures.three {
            (figure("(a) Pressure-volume loops", loops(), absent, &none))
            (figure("(b) Pressure", over_time(SignalKind::Pressure, "pressure (mmHg)"), absent, &none))
            (figure("(c) Volume", over_time(SignalKind::Volume, "volume (mL)"), absent, &none))
        }
    }
}

fn spread_table(found: &RobustnessTable, over: Uncertainty, by_seed: bool) -> Markup {
    let title = match found.table {
        TableKind::Step1Parameters => "Step 1, parameters",
        TableKind::Step1Biomarkers => "Step 1, biomarkers",
        TableKind::Step2Parameters => "Step 2, parameters",
        TableKind::Step2Biomarkers => "Step 2, biomarkers of the verification beat",
    };
    let numbered = format!("{title} (Table {})", found.table.paper(over));
    let title = if by_seed { title } else { &numbered };
    table::html(&robustness::spreads(title, &found.quantities, true))
}
