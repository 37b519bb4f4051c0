//! Charts of a search's findings: measured data, base model and extended model over a beat, and the
//! residuals.

use cardiotwin_schemas::discover::{ComparedSignal, DiscoverCase, DiscoverSeries};

use crate::html::plot::{Axis, Chart, Mark, Scale, Series};

/// Signal that a chart shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    /// Pressure of the left ventricle, mmHg.
    Pressure,
    /// Volume of the left ventricle, mL.
    Volume,
}

/// Names of phases and their short forms in a chart.
const SHORT: [(&str, &str); 7] = [
    ("isovolumic_contraction", "IVC"),
    ("early_ejection", "early ej."),
    ("late_ejection", "late ej."),
    ("isovolumic_relaxation", "IVR"),
    ("rapid_filling", "filling"),
    ("diastasis", "diastasis"),
    ("atrial_systole", "atrial"),
];
/// Width of a character over that of the chart. A phase too narrow for its name is drawn without
/// it.
const CHARACTER_SHARE: f64 = 0.0135;
/// Half width of the noise band in standard deviations of the noise.
const BAND: f64 = 2.0;

/// Traces before and after the accepted effects, to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct Compared<'a> {
    /// Pseudonym of the patient.
    patient: &'a str,
    /// Names of the accepted effects; empty if there is nothing after them.
    accepted: &'a [String],
    /// Name of the model before.
    before: &'static str,
    series: &'a DiscoverSeries,
}

impl<'a> Compared<'a> {
    /// The reduced ventricle of the search.
    #[must_use]
    pub fn reduced(case: &'a DiscoverCase) -> Self {
        let found = &case.found;
        let none: &[String] = &[];
        Self {
            patient: &case.case,
            accepted: if found.findings.none {
                none
            } else {
                &found.findings.accepted
            },
            before: "base model",
            series: &found.series,
        }
    }

    /// The finite-element ventricle; `None` if it was not simulated.
    #[must_use]
    pub fn finite_element(case: &'a DiscoverCase) -> Option<Self> {
        Some(Self {
            before: "finite elements without it",
            series: &case.finite_element.as_ref()?.series,
            ..Self::reduced(case)
        })
    }
}

struct Parts<'a> {
    name: &'static str,
    unit: &'static str,
    data: &'a ComparedSignal,
    before: &'a [f64],
    after: &'a [f64],
}

fn parts<'a>(of: &Compared<'a>, which: Which) -> Parts<'a> {
    let (series, curves) = (of.series, &of.series.curves);
    match which {
        Which::Pressure => Parts {
            name: "pressure",
            unit: "mmHg",
            data: &series.pressure,
            before: &curves.pressure_before_mmhg,
            after: &curves.pressure_after_mmhg,
        },
        Which::Volume => Parts {
            name: "volume",
            unit: "mL",
            data: &series.volume,
            before: &curves.volume_before_ml,
            after: &curves.volume_after_ml,
        },
    }
}

fn zip(x: &[f64], y: &[f64]) -> Vec<(f64, f64)> {
    std::iter::zip(x, y).map(|(x, y)| (*x, *y)).collect()
}

/// Measured data and both models over the beat. `None` without data.
#[must_use]
pub fn signal(compared: &Compared<'_>, which: Which) -> Option<Chart> {
    let of = parts(compared, which);
    let time = &compared.series.curves.time_ms;
    let values = of
        .data
        .measured
        .iter()
        .chain(of.before)
        .chain(of.after)
        .copied();
    let y = Axis::new(
        format!("{} ({})", of.name, of.unit).as_str(),
        of.unit,
        Scale::linear(values, false)?,
    );
    let mut chart = Chart::new(
        format!(
            "{} of {}: measured, before, after",
            of.name, compared.patient
        ),
        time_axis(compared)?,
        y,
    );
    // Samples are drawn as dots, so that the lines of the models stay visible.
    let measured = zip(&of.data.time_ms, &of.data.measured);
    chart.series.push(Series {
        class: "measured",
        name: "measured".to_owned(),
        points: measured,
        dots: true,
    });
    let before = zip(time, of.before);
    chart.series.push(Series {
        class: "before",
        name: compared.before.to_owned(),
        points: before,
        dots: false,
    });
    if !compared.accepted.is_empty() {
        let name = format!("with {}", compared.accepted.join(", ").replace('_', " "));
        chart.series.push(Series {
            class: "after",
            name,
            points: zip(time, of.after),
            dots: false,
        });
    }
    phases(&mut chart, compared.series, false);
    Some(chart)
}

/// Data minus model at the times of the data, for both models, over the noise band. `None` without
/// data.
#[must_use]
pub fn residual(compared: &Compared<'_>, which: Which) -> Option<Chart> {
    let of = parts(compared, which);
    let left = |model: &[f64]| -> Vec<f64> {
        std::iter::zip(&of.data.measured, model)
            .map(|(d, m)| d - m)
            .collect()
    };
    let (before, after) = (left(&of.data.before), left(&of.data.after));
    let band = BAND * of.data.noise_sd;
    let values = before
        .iter()
        .chain(&after)
        .copied()
        .chain([-1.4 * band, 1.4 * band]);
    let y = Axis::new(
        format!("residual ({})", of.unit).as_str(),
        of.unit,
        Scale::linear(values, false)?,
    );
    let mut chart = Chart::new(
        format!("residual of the {} of {}", of.name, compared.patient),
        time_axis(compared)?,
        y,
    );
    chart.size.1 = 190.0;
    chart.marks.push(Mark::Band {
        from: -band,
        to: band,
        class: "noise",
    });
    chart.marks.push(Mark::Across {
        y: 0.0,
        class: "level",
        label: None,
    });
    let time = &of.data.time_ms;
    chart.series.push(Series {
        class: "before",
        name: compared.before.into(),
        points: zip(time, &before),
        dots: false,
    });
    if !compared.accepted.is_empty() {
        chart.series.push(Series {
            class: "after",
            name: "after".into(),
            points: zip(time, &after),
            dots: false,
        });
    }
    phases(&mut chart, compared.series, true);
    Some(chart)
}

fn time_axis(compared: &Compared<'_>) -> Option<Axis> {
    Some(Axis::new(
        "time (ms)",
        "ms",
        Scale::exact(0.0, *compared.series.curves.time_ms.last()?),
    ))
}

/// Marks where phases begin, and writes their names if `named`.
fn phases(chart: &mut Chart, series: &DiscoverSeries, named: bool) {
    let phases = &series.phases;
    let cycle = series.curves.time_ms.last().copied().unwrap_or(0.0);
    for (i, phase) in phases.iter().enumerate() {
        chart.marks.push(Mark::Up {
            x: phase.begin_ms,
            class: "phase",
        });
        let next = phases[(i + 1) % phases.len()].begin_ms;
        // The name of a phase that runs past the end of the cycle is written before the end.
        let end = if next > phase.begin_ms { next } else { cycle };
        let short = SHORT
            .iter()
            .find(|(name, _)| *name == phase.phase)
            .map_or("", |(_, short)| short);
        if named && end - phase.begin_ms > CHARACTER_SHARE * short.len() as f64 * cycle {
            chart.marks.push(Mark::Words {
                from: phase.begin_ms,
                to: end,
                text: short.to_owned(),
            });
        }
    }
}
