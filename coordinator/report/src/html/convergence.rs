//! Convergence plots: parameters and cost of step 1 by iteration (the paper's Figure A2),
//! differential evolution of step 2.

use cardiotwin_schemas::label::Label;
use cardiotwin_schemas::record::{IterationRecord, PatientRecord};
use cardiotwin_schemas::step1::Step1Parameter;

use super::format::significant;
use super::plot::{Axis, Chart, Mark, Reading, Scale, Series, SvgText};
use crate::results::PatientView;
use crate::results::columns::Columns;

const SMALL: (f64, f64) = (300.0, 190.0);
const SMALL_MARGINS: [f64; 4] = [54.0, 12.0, 14.0, 42.0];

fn iteration_axis(iterations: &[IterationRecord]) -> Axis {
    let last = iterations.iter().map(|i| i.number).max().unwrap_or(1);
    let first = iterations.iter().map(|i| i.number).min().unwrap_or(1);
    let mut axis = Axis::new(
        "iteration",
        "",
        Scale::exact(f64::from(first) - 0.3, f64::from(last) + 0.3),
    );
    let every = (last - first) / 10 + 1;
    axis.fixed = Some(
        (first..=last)
            .step_by(every as usize)
            .map(|k| (f64::from(k), k.to_string()))
            .collect(),
    );
    axis
}

fn small(alt: String, x: Axis, y: Axis) -> Chart {
    let mut chart = Chart::new(alt, x, y);
    chart.size = SMALL;
    chart.margins = SMALL_MARGINS;
    chart.y.ticks = 4;
    chart.reading = Reading::Off;
    chart
}

/// Marks the iterate that was taken and the iterations that failed.
fn mark_iterations(
    chart: &mut Chart,
    patient: &PatientRecord,
    y_of: impl Fn(&IterationRecord) -> Option<f64>,
) {
    let taken = PatientView(patient).best_iteration().map(|i| i.number);
    for iteration in &patient.iterations {
        let x = f64::from(iteration.number);
        if Some(iteration.number) == taken {
            chart.marks.push(Mark::Up { x, class: "taken" });
        }
        if let Some(failure) = &iteration.failure {
            let (lo, hi, _) = chart.y.scale.ends();
            let y = y_of(iteration).unwrap_or_else(|| {
                if lo > 0.0 {
                    (lo * hi).sqrt()
                } else {
                    0.5 * (lo + hi)
                }
            });
            let title = format!("iteration {} failed: {}", iteration.number, failure.message);
            chart.marks.push(Mark::Cross {
                x,
                y,
                class: "failed",
                title,
            });
        }
    }
}

/// Cost by iteration with the tolerance. `None` before the first simulation.
#[must_use]
pub fn cost(patient: &PatientRecord) -> Option<Chart> {
    let tolerance = patient.plan.settings.step1.tolerance;
    let points: Vec<_> = patient
        .iterations
        .iter()
        .filter_map(|i| {
            i.cost
                .filter(|c| c.is_finite())
                .map(|c| (f64::from(i.number), c))
        })
        .collect();
    let promised = |i: &IterationRecord| i.proposal.as_ref().map(|task| task.result.predicted_cost);
    let predicted: Vec<_> = patient
        .iterations
        .iter()
        .filter_map(|i| {
            promised(i)
                .filter(|c| *c > 0.0)
                .map(|c| (f64::from(i.number), c))
        })
        .collect();
    let shown = points
        .iter()
        .chain(predicted.iter().filter(|_| !points.is_empty()))
        .map(|p| p.1);
    let scale = Scale::log(
        shown.chain((!points.is_empty()).then_some(0.7 * tolerance)),
        3.0,
    )?;
    let mut chart = small(
        format!("cost of {} by iteration", patient.plan.id),
        iteration_axis(&patient.iterations),
        Axis::new("cost", "", scale),
    );
    let label = SvgText::from(format!("converged at {}", significant(tolerance, 1)).as_str());
    chart.marks.push(Mark::Across {
        y: tolerance,
        class: "level",
        label: Some((label, 14.0)),
    });
    if !predicted.is_empty() {
        chart.series.push(Series {
            class: "mean",
            name: "predicted by the proposal".into(),
            points: predicted,
            dots: true,
        });
    }
    chart.series.push(Series {
        class: "measured",
        name: "cost".into(),
        points,
        dots: true,
    });
    mark_iterations(&mut chart, patient, |i| i.cost);
    Some(chart)
}

/// One chart per updated parameter, relative to the first guess. All charts have the same
/// logarithmic axis.
#[must_use]
pub fn parameters(patient: &PatientRecord) -> Vec<(&'static str, Chart)> {
    let Some(first) = patient.iterations.first() else {
        return Vec::new();
    };
    let first_values = first.parameters.updated();
    let relative = |i: &IterationRecord, k: usize| i.parameters.updated()[k] / first_values[k];
    let all = (0..6)
        .flat_map(|k| patient.iterations.iter().map(move |i| (i, k)))
        .map(|(i, k)| relative(i, k));
    let Some(scale) = Scale::log(all, 2.0) else {
        return Vec::new();
    };
    let charts = Step1Parameter::KEYS
        .into_iter()
        .enumerate()
        .map(|(k, key)| {
            let label = Label::of(key);
            let mut chart = small(
                format!(
                    "{key} of {} by iteration, relative to the first guess",
                    patient.plan.id
                ),
                iteration_axis(&patient.iterations),
                Axis::new("× first guess", "× first guess", scale),
            );
            chart.marks.push(Mark::Across {
                y: 1.0,
                class: "level",
                label: None,
            });
            let points = patient
                .iterations
                .iter()
                .map(|i| (f64::from(i.number), relative(i, k)))
                .collect();
            let name = label.map_or(key, |l| l.meaning).to_owned();
            chart.series.push(Series {
                class: "step1",
                name,
                points,
                dots: true,
            });
            mark_iterations(&mut chart, patient, |i| Some(relative(i, k)));
            (key, chart)
        });
    charts.collect()
}

/// Best and mean cost of the population over the number of cell evaluations.
///
/// # Errors
/// A sentence for the report that explains why there is no plot.
pub fn evolution(patient: &PatientRecord) -> Result<Chart, String> {
    let Some(fit) = &patient.cell_fit else {
        return Err("Step 2 has not finished.".to_owned());
    };
    let Some(file) = fit.artefact("convergence") else {
        return Err("Step 2 wrote no convergence.csv.".to_owned());
    };
    let columns = Columns::read(&file).map_err(|e| e.to_string())?;
    let best = columns
        .pairs("evaluations", "best_cost")
        .unwrap_or_default();
    let mean = columns
        .pairs("evaluations", "mean_cost")
        .unwrap_or_default();
    let unusable = || {
        format!(
            "{} has no usable columns `evaluations` and `best_cost`.",
            file.display()
        )
    };
    let last = best.last().ok_or_else(unusable)?.0;
    // The first populations contain candidates with the cost of a failed cell. The axis follows the
    // best cost, and the mean is drawn where it is low enough to be informative.
    let ceiling = 10.0 * best.iter().map(|p| p.1).fold(0.0, f64::max);
    let mean: Vec<_> = mean.into_iter().filter(|p| p.1 <= ceiling).collect();
    let scale = Scale::log(best.iter().chain(&mean).map(|p| p.1), 3.0).ok_or_else(unusable)?;
    let mut chart = Chart::new(
        format!(
            "convergence of differential evolution of {}",
            patient.plan.id
        ),
        Axis::new("cell evaluations", "evaluations", Scale::exact(0.0, last)),
        Axis::new("cost", "", scale),
    );
    chart.series.push(Series {
        class: "mean",
        name: "population mean".into(),
        points: mean,
        dots: false,
    });
    chart.series.push(Series {
        class: "step2",
        name: "best".into(),
        points: best,
        dots: false,
    });
    Ok(chart)
}
