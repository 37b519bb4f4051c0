//! A measured calcium transient and the curve fitted to it, as an SVG file.

use cardiotwin_schemas::fit::CalciumFitAnswer;

use super::format::significant;
use super::plot::{Axis, Chart, Mark, Scale, Series, SvgText};

/// Text of the SVG file. Points of `measured` and `fitted` are time in ms and calcium in µM. `None`
/// if no sample is finite.
#[must_use]
pub fn calcium_fit_svg(
    answer: &CalciumFitAnswer,
    measured: &[(f64, f64)],
    fitted: &[(f64, f64)],
) -> Option<String> {
    let (first, last) = (measured.first()?.0, measured.last()?.0);
    let values = measured.iter().chain(fitted).map(|point| point.1);
    let x = Axis::new("time (ms)", "ms", Scale::exact(first, last));
    let y = Axis::new("calcium (µM)", "µM", Scale::linear(values, true)?);
    let mut chart = Chart::new(
        format!("calcium transient {} and Rice's curve", answer.trace),
        x,
        y,
    );
    let samples = format!("{} ({} samples)", answer.trace, answer.n_samples);
    chart.series.push(Series {
        class: "measured",
        name: samples,
        points: measured.to_vec(),
        dots: true,
    });
    let name = format!(
        "Rice: {} to {} µM, time constants {} and {} ms, residual {} µM",
        significant(answer.ca_res_um, 3),
        significant(answer.ca_max_um, 3),
        significant(answer.tau_cr_ms, 3),
        significant(answer.tau_cd_ms, 3),
        significant(answer.root_mean_square_um, 2)
    );
    chart.series.push(Series {
        class: "step2",
        name,
        points: fitted.to_vec(),
        dots: false,
    });
    for (level, sub) in [(answer.ca_res_um, "res"), (answer.ca_max_um, "max")] {
        let label = SvgText {
            text: "Ca".into(),
            sub: sub.into(),
            after: String::new(),
        };
        chart.marks.push(Mark::Across {
            y: level,
            class: "level",
            label: Some((label, -5.0)),
        });
    }
    Some(chart.file())
}
