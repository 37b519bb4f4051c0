//! The organ's law of a patient: its pressure over volume, the beats that taught, and its errors.

use cardiotwin_schemas::organ_law::{LawBeatFit, LawError, LearnedLaw};
use cardiotwin_schemas::record::PatientRecord;
use maud::{Markup, html};

use super::figures::{figure, legend};
use super::format::{fixed, raw};
use super::plot::{Axis, Chart, Mark, Reading, Scale, Series, SvgText};
use super::tables::scrolling;
use crate::results::{Source, Teacher, learned_law, teachers};

/// Number of parts of a curve between two volumes of the law, so that it ends close to the edge of the
/// plot.
const PARTS: usize = 12;
/// Room for the stresses right of the plot.
const ROOM: f64 = 56.0;
/// Range of pressures \[mmHg\] that is drawn without a beat.
const WITHOUT_BEATS_MMHG: [f64; 2] = [-10.0, 150.0];

/// The part of a patient's section; empty if no law was used.
#[must_use]
pub fn part(patient: &PatientRecord) -> Markup {
    let Some(law) = learned_law(patient) else {
        let used = patient
            .iterations
            .iter()
            .filter_map(|i| i.proposal.as_ref());
        return html! {
            @if used.clone().any(|task| task.result.law_beats.is_some()) {
                h3 { "The organ's law" }
                p.absent {
                    "No picture: the proposals were computed by a version of the program that stored none. "
                    code { "cardiotwin run COHORT --run-dir NEW" } " repeats them and stores one."
                }
            }
        };
    };
    let teachers = teachers(patient, law);
    let mut lines = vec![("law", "law at constant active stress".to_owned())];
    lines.extend(teachers.iter().map(|t| (class(t), t.name.clone())));
    if !teachers.is_empty() {
        lines.push(("of-law", "law at a beat's volume and stress".to_owned()));
    }
    let absent = "No 3D beat has taught yet.";
    html! {
        h3 { "The organ's law" }
        p.quiet { (words(law)) }
        (legend(&lines))
        div.figures {
            (figure("The organ's law", pressure(patient, law, &teachers), absent, &html! { span.quiet { ": grey numbers are active stresses" } }))
            (figure("Error over the beat", errors(patient, law, &teachers), absent, &html! { span.quiet { ": pressure of the law minus that of the beat" } }))
        }
        @if !teachers.is_empty() { (table(law, &teachers)) }
    }
}

/// Plain words about the law.
fn words(law: &LearnedLaw) -> String {
    format!(
        "At a given volume and active stress, this ventricle has one pressure, whichever cell made the stress. The program learns this law from \
         3D beats and searches parameters in it, because a beat in the law takes milliseconds. This law was {}.",
        law.origin_words()
    )
}

/// Class of a beat's line.
fn class(teacher: &Teacher) -> &'static str {
    match (teacher.source, teacher.taken) {
        (Source::Step3, true) => "step3",
        (Source::Step3, false) => "step3 earlier",
        (Source::Step2, _) => "step2",
        (_, true) => "step1",
        (_, false) => "step1 earlier",
    }
}

/// Pressure over volume at constant stress, and the beats' loops.
fn pressure(patient: &PatientRecord, law: &LearnedLaw, teachers: &[Teacher]) -> Option<Chart> {
    let all = |of: fn(&LawBeatFit) -> &[f64]| law.beats.iter().flat_map(of).copied();
    let (x, y) = if law.beats.is_empty() {
        let ends = [*law.volume_ml.first()?, *law.volume_ml.last()?];
        let [low, high] = WITHOUT_BEATS_MMHG;
        (Scale::exact(ends[0], ends[1]), Scale::exact(low, high))
    } else {
        let pressures = all(|beat| &beat.pressure_mmhg).chain(all(|beat| &beat.law_pressure_mmhg));
        (
            Scale::linear(all(|beat| &beat.volume_ml), false)?,
            Scale::linear(pressures, true)?,
        )
    };
    let mut chart = Chart::new(
        format!("organ's law of {}: pressure over volume", patient.plan.id),
        Axis::new("volume (mL)", "mL", x),
        Axis::new("pressure (mmHg)", "mmHg", y),
    );
    chart.margins[1] = ROOM;
    for curve in &law.curves {
        let points = within(&chart, &law.volume_ml, &curve.pressure_mmhg);
        let stress = format!("{} kPa", curve.active_stress_kpa);
        if let Some(mark) = label(&chart, &points, &stress) {
            chart.marks.push(mark);
        }
        chart.series.push(Series {
            class: "law",
            name: format!("law at {stress}"),
            points,
            dots: false,
        });
    }
    for (beat, teacher) in law.beats.iter().zip(teachers) {
        let lines = [
            (
                "of-law",
                format!("law, {}", teacher.name),
                &beat.law_pressure_mmhg,
            ),
            (class(teacher), teacher.name.clone(), &beat.pressure_mmhg),
        ];
        for (class, name, pressure) in lines {
            let points = beat.volume_ml.iter().zip(pressure);
            chart.series.push(Series {
                class,
                name,
                points: points
                    .map(|(volume, pressure)| (*volume, *pressure))
                    .collect(),
                dots: false,
            });
        }
    }
    chart.reading = Reading::Nearest;
    Some(chart)
}

/// The part of a curve inside the plot, without a value outside.
fn within(chart: &Chart, volumes: &[f64], pressures: &[f64]) -> Vec<(f64, f64)> {
    let ([x0, x1], [y0, y1]) = (ends(&chart.x.scale), ends(&chart.y.scale));
    let points: Vec<(f64, f64)> = volumes
        .iter()
        .copied()
        .zip(pressures.iter().copied())
        .collect();
    let between = points.windows(2).flat_map(|pair| {
        let (a, b) = (pair[0], pair[1]);
        (0..PARTS).map(move |k| {
            let share = k as f64 / PARTS as f64;
            (a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1))
        })
    });
    let inside = |(x, y): (f64, f64)| {
        let is_inside = (x0..=x1).contains(&x) && (y0..=y1).contains(&y);
        (x, if is_inside { y } else { f64::NAN })
    };
    between.chain(points.last().copied()).map(inside).collect()
}

fn ends(scale: &Scale) -> [f64; 2] {
    let (low, high, _) = scale.ends();
    [low, high]
}

/// The stress of a curve: right of the plot where the curve ends there, otherwise below its end.
fn label(chart: &Chart, points: &[(f64, f64)], stress: &str) -> Option<Mark> {
    let ([x0, x1], [y0, y1]) = (ends(&chart.x.scale), ends(&chart.y.scale));
    let (x, y) = *points.iter().rev().find(|(_, y)| y.is_finite())?;
    let is_at_the_right = chart.x.scale.fraction(x)? > 0.97;
    let (right, below) = if is_at_the_right {
        (0.065, 0.04)
    } else {
        (-0.05, 0.08)
    };
    let place = (x + right * (x1 - x0), y - below * (y1 - y0));
    Some(Mark::Segment {
        from: place,
        to: place,
        class: "level",
        label: Some(SvgText::from(stress)),
    })
}

/// Difference of law and beat over time; `None` without a beat.
fn errors(patient: &PatientRecord, law: &LearnedLaw, teachers: &[Teacher]) -> Option<Chart> {
    let cycle_ms = patient.plan.step0.cycle_length_ms;
    let differences = |beat: &LawBeatFit| -> Vec<f64> {
        let pairs = beat.law_pressure_mmhg.iter().zip(&beat.pressure_mmhg);
        pairs.map(|(law, beat)| law - beat).collect()
    };
    let y = Scale::linear(law.beats.iter().flat_map(differences), true)?;
    let mut chart = Chart::new(
        format!("error of the organ's law of {} over time", patient.plan.id),
        Axis::new("time (ms)", "ms", Scale::exact(0.0, cycle_ms)),
        Axis::new("law \u{2212} beat (mmHg)", "mmHg", y),
    );
    chart.marks.push(Mark::Across {
        y: 0.0,
        class: "level",
        label: None,
    });
    for (beat, teacher) in law.beats.iter().zip(teachers) {
        let differences = differences(beat);
        let step_ms = cycle_ms / differences.len() as f64;
        let points = differences.into_iter().enumerate();
        chart.series.push(Series {
            class: class(teacher),
            name: teacher.name.clone(),
            points: points
                .map(|(k, error)| (k as f64 * step_ms, error))
                .collect(),
            dots: false,
        });
    }
    Some(chart)
}

/// Errors of the law at each beat, when the beat was new to it and after the last one.
fn table(law: &LearnedLaw, teachers: &[Teacher]) -> Markup {
    let cells = |error: Option<LawError>| {
        let values = [error.map(|e| e.rms_mmhg), error.map(|e| e.worst_mmhg)];
        html! { @for value in values { td.num data-value=(raw(value)) { (fixed(value, 2)) } } }
    };
    let n: usize = law.beats.iter().map(|beat| beat.volume_ml.len()).sum();
    html! {
        (scrolling(&html! {
            table {
                caption { "Error of the law's pressure" }
                thead.long { tr {
                    @for head in ["beat", "samples", "as a new beat: rms, mmHg", "worst, mmHg", "learned law: rms, mmHg", "worst, mmHg"] { th scope="col" { (head) } }
                } }
                tbody {
                    @for (beat, teacher) in law.beats.iter().zip(teachers) {
                        tr { th scope="row" { (teacher.name) } td.num { (beat.volume_ml.len()) } (cells(Some(beat.before))) (cells(Some(beat.after))) }
                    }
                }
                @if law.beats.len() > 1 {
                    tfoot { tr { th scope="row" { "all" } td.num { (n) } (cells(None)) (cells(law.error())) } }
                }
            }
        }))
        p.quiet {
            "The law's pressure at the volumes and active stresses of a beat, against the beat's own pressure. "
            "As a new beat: the law that the beats above it taught, and for the first one the law at the start."
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_ends_at_the_edge_of_the_plot() {
        let chart = Chart::new(
            "a law",
            Axis::new("volume (mL)", "mL", Scale::exact(60.0, 100.0)),
            Axis::new("pressure (mmHg)", "mmHg", Scale::exact(0.0, 50.0)),
        );
        let points = within(&chart, &[40.0, 80.0, 120.0], &[-40.0, 0.0, 120.0]);
        let seen: Vec<(f64, f64)> = points.into_iter().filter(|p| p.1.is_finite()).collect();
        assert_eq!(seen[0], (80.0, 0.0));
        let last = seen[seen.len() - 1];
        assert!(
            last.1 > 38.0 && last.1 <= 50.0 && last.0 <= 100.0,
            "{last:?}"
        );
        assert!(label(&chart, &seen, "40 kPa").is_some());
        assert!(label(&chart, &[(60.0, f64::NAN)], "40 kPa").is_none());
    }
}
