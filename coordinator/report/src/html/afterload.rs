//! Measured aortic pressure and the pressure of a fitted load, as SVG files.

use cardiotwin_schemas::afterload::{AfterloadDiscovery, AfterloadFitAnswer, CuffFitAnswer};

use super::format::significant;
use super::plot::{Axis, Chart, Mark, Scale, Series};

/// Measured pressure and the fit of three elements. Points are time in ms and pressure in mmHg.
/// `None` if no sample is finite.
#[must_use]
pub fn afterload_fit_svg(
    answer: &AfterloadFitAnswer,
    measured: &[(f64, f64)],
    fitted: &[(f64, f64)],
) -> Option<String> {
    let mut chart = chart(
        format!(
            "aortic pressure {} and three elements",
            answer.record.pressure
        ),
        measured,
        &[fitted],
    )?;
    let load = &answer.afterload;
    let name = format!(
        "three elements: R1 {}, R2 {} mmHg s/mL, C {} mL/mmHg, residual {} mmHg",
        significant(load.characteristic_resistance_mmhg_s_per_ml, 3),
        significant(load.peripheral_resistance_mmhg_s_per_ml, 3),
        significant(load.compliance_ml_per_mmhg, 3),
        significant(answer.root_mean_square_mmhg, 2)
    );
    chart.series.push(Series {
        class: "step2",
        name,
        points: fitted.to_vec(),
        dots: false,
    });
    Some(chart.file())
}

/// Pressure of the load fitted to cuff pressures. Points are time in ms and pressure in mmHg.
/// `None` without a finite sample.
#[must_use]
pub fn cuff_fit_svg(answer: &CuffFitAnswer, fitted: &[(f64, f64)]) -> Option<String> {
    let (first, last) = (fitted.first()?.0, fitted.last()?.0);
    let marks = [
        Some(answer.systolic_mmhg),
        answer.mean_mmhg,
        Some(answer.diastolic_mmhg),
    ];
    let values = fitted
        .iter()
        .map(|point| point.1)
        .chain(marks.into_iter().flatten());
    let x = Axis::new("time (ms)", "ms", Scale::exact(first, last));
    let y = Axis::new("pressure (mmHg)", "mmHg", Scale::linear(values, false)?);
    let mut chart = Chart::new(
        "aortic pressure of three elements through a cuff's pressures",
        x,
        y,
    );
    let names = ["systolic", "mean", "diastolic"];
    chart
        .marks
        .extend(std::iter::zip(names, marks).filter_map(|(name, y)| {
            Some(Mark::Across {
                y: y?,
                class: "phase",
                label: Some((name.into(), -4.0)),
            })
        }));
    let load = &answer.afterload;
    let name = format!(
        "three elements: R1 {}, R2 {} mmHg s/mL, C {} mL/mmHg",
        significant(load.characteristic_resistance_mmhg_s_per_ml, 3),
        significant(load.peripheral_resistance_mmhg_s_per_ml, 3),
        significant(load.compliance_ml_per_mmhg, 3)
    );
    chart.series.push(Series {
        class: "step2",
        name,
        points: fitted.to_vec(),
        dots: false,
    });
    Some(chart.file())
}

/// Measured pressure, the fit of three elements, and the fit with the accepted effects. Points are
/// time in ms and pressure in mmHg. `None` without a finite sample.
#[must_use]
pub fn afterload_discovery_svg(
    answer: &AfterloadDiscovery,
    measured: &[(f64, f64)],
    before: &[(f64, f64)],
    after: &[(f64, f64)],
) -> Option<String> {
    let alt = format!(
        "aortic pressure {}, before and after",
        answer.record.pressure
    );
    let mut chart = chart(alt, measured, &[before, after])?;
    let pulse = answer.record.pulse_pressure_mmhg;
    let gap = |all: f64, held_out: f64| {
        format!(
            "{} mmHg, held out {} mmHg",
            significant(all * pulse, 3),
            significant(held_out * pulse, 3)
        )
    };
    let name = format!(
        "three elements: {}",
        gap(answer.gap_before, answer.gap_heldout_before)
    );
    chart.series.push(Series {
        class: "step1",
        name,
        points: before.to_vec(),
        dots: false,
    });
    if !answer.accepted.is_empty() {
        let names = answer.accepted.join(" and ");
        let name = format!(
            "with {names}: {}",
            gap(answer.gap_after, answer.gap_heldout_after)
        );
        chart.series.push(Series {
            class: "step2",
            name,
            points: after.to_vec(),
            dots: false,
        });
    }
    Some(chart.file())
}

fn chart(alt: String, measured: &[(f64, f64)], lines: &[&[(f64, f64)]]) -> Option<Chart> {
    let (first, last) = (measured.first()?.0, measured.last()?.0);
    let values = measured
        .iter()
        .chain(lines.iter().copied().flatten())
        .map(|point| point.1);
    let x = Axis::new("time (ms)", "ms", Scale::exact(first, last));
    let y = Axis::new("pressure (mmHg)", "mmHg", Scale::linear(values, false)?);
    let mut chart = Chart::new(alt, x, y);
    let name = format!("measured ({} samples)", measured.len());
    chart.series.push(Series {
        class: "measured",
        name,
        points: measured.to_vec(),
        dots: true,
    });
    Some(chart)
}
