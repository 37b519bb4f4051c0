//! Comparison of a patient's simulated ventricle before and after effects were accepted.

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::outcome::OrganBeatResult;
use cardiotwin_schemas::record::{PatientRecord, TaskRecord};
use maud::{Markup, html};

use crate::html::figures::{at, figure, legend};
use crate::html::format::fixed;
use crate::html::plot::{Axis, Chart, Scale, Series};
use crate::html::tables::scrolling;
use crate::results::columns::Columns;
use crate::results::{PatientView, SignalKind, Signals, Source, Step};

type Trace = Vec<(f64, f64)>;

/// The comparison; empty if no effect was accepted.
pub fn part(patient: &PatientRecord, signals: &Signals) -> Markup {
    if patient.plan.effects.is_empty() {
        return Markup::default();
    }
    let names: Vec<String> = patient
        .plan
        .effects
        .iter()
        .map(|effect| effect.name.replace('_', " "))
        .collect();
    let names = names.join(", ");
    let Some(before) = &patient.before else {
        return html! {
            p.absent { "Accepted: " (names) ". This run has not simulated this ventricle without them, so there is no comparison." }
        };
    };
    let view = PatientView(patient);
    // Late filling (diastasis and atrial systole) begins where 80 % of the measured volume is
    // recovered.
    let late = patient
        .step0
        .as_ref()
        .and_then(|step0| step0.result.time_points.t7_ms);
    let pairs = [
        (
            "step 1",
            Source::Step1,
            before.step1.as_ref(),
            view.beat(Step::Step1),
        ),
        (
            "step 2",
            Source::Step2,
            before.verification.as_ref(),
            view.beat(Step::Step2),
        ),
    ];
    let compared: Vec<Compared> = pairs
        .into_iter()
        .filter_map(|(name, source, was, is)| {
            Some(Compared::of(name, source, was?, is?, signals, late))
        })
        .collect();
    html! {
        h4 { "Before and after: " (names) }
        p.quiet { "The same ventricle, personalised without and with the accepted effects; misfits are rms over the measured samples." }
        @if let Some(first) = compared.first() {
            (legend(&[("measured", "measured".to_owned()), ("before", "before".to_owned()), ("after", format!("with {names}"))]))
            div.figures.wide {
                (figure("Volume", chart(patient, first, signals, SignalKind::Volume), "No volume trace to compare with.", &html! { span.quiet { ", " (first.name) } }))
                (figure("Pressure", chart(patient, first, signals, SignalKind::Pressure), "No pressure trace to compare with.", &html! { span.quiet { ", " (first.name) } }))
            }
        }
        (table(&compared))
    }
}

/// A step's beat before and after the acceptance.
struct Compared<'a> {
    name: &'static str,
    source: Source,
    was: &'a TaskRecord<OrganBeatResult>,
    is: &'a TaskRecord<OrganBeatResult>,
    /// Pressure and volume before the acceptance; `None` if they cannot be read.
    traces: [Option<Trace>; 2],
    /// Root mean square distance to the measured samples, before and after: pressure (mmHg), volume
    /// (mL), volume in late filling (mL).
    misfits: [[Option<f64>; 2]; 3],
}

const KINDS: [SignalKind; 2] = [SignalKind::Pressure, SignalKind::Volume];

impl<'a> Compared<'a> {
    fn of(
        name: &'static str,
        source: Source,
        was: &'a TaskRecord<OrganBeatResult>,
        is: &'a TaskRecord<OrganBeatResult>,
        signals: &Signals,
        late_filling_ms: Option<f64>,
    ) -> Self {
        let columns = was
            .artefact("traces")
            .and_then(|file| Columns::read(&file).ok());
        let traces = KINDS.map(|kind| {
            columns
                .as_ref()
                .and_then(|c| c.pairs("time_ms", kind.column()))
        });
        let misfit = |k: usize, from_ms: f64| {
            let measured = signals
                .get(Source::Measured, KINDS[k])
                .map(|all| all.iter().filter(|p| p.0 >= from_ms).copied());
            let measured: Option<Trace> = measured.map(Iterator::collect);
            let of = |trace: Option<&[(f64, f64)]>| rms(measured.as_deref()?, trace?);
            [of(traces[k].as_deref()), of(signals.get(source, KINDS[k]))]
        };
        let late = late_filling_ms.map_or([None; 2], |from_ms| misfit(1, from_ms));
        let misfits = [misfit(0, 0.0), misfit(1, 0.0), late];
        Self {
            name,
            source,
            was,
            is,
            traces,
            misfits,
        }
    }
}

fn rms(measured: &[(f64, f64)], simulated: &[(f64, f64)]) -> Option<f64> {
    let last = simulated.last()?.0;
    let squares: Vec<f64> = measured
        .iter()
        .filter(|p| p.0 <= last)
        .filter_map(|p| Some((at(simulated, p.0)? - p.1).powi(2)))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

fn chart(
    patient: &PatientRecord,
    compared: &Compared<'_>,
    signals: &Signals,
    kind: SignalKind,
) -> Option<Chart> {
    let k = KINDS.iter().position(|other| *other == kind)?;
    let (measured, after) = (
        signals.get(Source::Measured, kind)?,
        signals.get(compared.source, kind)?,
    );
    let before = compared.traces[k].as_deref()?;
    let (title, unit) = if kind == SignalKind::Volume {
        ("volume (mL)", "mL")
    } else {
        ("pressure (mmHg)", "mmHg")
    };
    let values = [measured, before, after].into_iter().flatten().map(|p| p.1);
    let y = Axis::new(
        title,
        unit,
        Scale::linear(values, kind == SignalKind::Pressure)?,
    );
    let x = Axis::new(
        "time (ms)",
        "ms",
        Scale::exact(0.0, patient.plan.step0.cycle_length_ms),
    );
    let alt = format!(
        "{} of {}: measured, before and after",
        kind.name(),
        patient.plan.id
    );
    let mut chart = Chart::new(alt, x, y);
    for (class, name, points) in [
        ("measured", "measured", measured),
        ("before", "before", before),
        ("after", "after", after),
    ] {
        let points = points
            .iter()
            .copied()
            .filter(|p| p.0 <= patient.plan.step0.cycle_length_ms)
            .collect();
        chart.series.push(Series {
            class,
            name: name.into(),
            points,
            dots: false,
        });
    }
    Some(chart)
}

fn table(compared: &[Compared<'_>]) -> Markup {
    let gap =
        |run: &TaskRecord<OrganBeatResult>| run.result.biomarkers.get(Biomarker::EndOfBeatGap);
    let stroke = |run: &TaskRecord<OrganBeatResult>| run.result.biomarkers.get(Biomarker::Sv);
    scrolling(&html! {
        table {
            caption { "Changes by the accepted effects" }
            thead { tr {
                th scope="col" { "" } th.unit scope="col" { "unit" }
                @for c in compared { th scope="col" { (c.name) ", before" } th scope="col" { "after" } }
            } }
            tbody {
                tr { th scope="row" { "volume gap at the beat's end" } td.unit { "mL" }
                    @for c in compared { td.num { (fixed(gap(c.was), 1)) } td.num { b { (fixed(gap(c.is), 1)) } } } }
                tr { th scope="row" { "misfit of the volume" } td.unit { "mL" }
                    @for c in compared { td.num { (fixed(c.misfits[1][0], 1)) } td.num { b { (fixed(c.misfits[1][1], 1)) } } } }
                tr { th scope="row" title="from the recovery of 80 % of the measured volume" { "misfit of the volume in late filling" } td.unit { "mL" }
                    @for c in compared { td.num { (fixed(c.misfits[2][0], 1)) } td.num { b { (fixed(c.misfits[2][1], 1)) } } } }
                tr { th scope="row" { "misfit of the pressure" } td.unit { "mmHg" }
                    @for c in compared { td.num { (fixed(c.misfits[0][0], 1)) } td.num { b { (fixed(c.misfits[0][1], 1)) } } } }
                tr { th scope="row" { "stroke volume" } td.unit { "mL" }
                    @for c in compared { td.num { (fixed(stroke(c.was), 1)) } td.num { b { (fixed(stroke(c.is), 1)) } } } }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misfit_is_taken_at_the_measured_samples() {
        let measured = [(0.0, 1.0), (10.0, 2.0), (30.0, 9.0)];
        let simulated = [(0.0, 4.0), (20.0, 8.0)];
        // The differences are 4 − 1 and 6 − 2; the last sample lies beyond the simulated beat.
        assert!((rms(&measured, &simulated).unwrap() - 12.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(rms(&measured, &[]), None);
    }
}
