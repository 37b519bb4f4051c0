//! Spread of the nodes' traces around their median (Jung et al. 2022, Figure 2).

use cardiotwin_schemas::record::PatientRecord;

use crate::html::plot::{Axis, Chart, Mark, Scale, Series, SvgText, stacked};
use crate::results::model::Model;
use crate::results::spread::Spread;
use crate::results::{SignalKind, SpreadFile};

/// A chart for each quantity, with its title.
pub fn charts(file: &SpreadFile, patient: &str) -> Vec<(&'static str, Chart)> {
    file.all
        .iter()
        .filter_map(|spread| chart(spread, patient))
        .collect()
}

fn chart(spread: &Spread, patient: &str) -> Option<(&'static str, Chart)> {
    let (title, axis, unit) = match spread.kind {
        SignalKind::Stretch => (
            "Fibre stretch of the nodes",
            SvgText::from("fibre stretch λ"),
            "",
        ),
        SignalKind::Calcium => ("Calcium of the nodes", SvgText::from("calcium (µM)"), "µM"),
        _ => {
            let axis = SvgText {
                text: "active stress S".into(),
                sub: "a".into(),
                after: " (kPa)".into(),
            };
            ("Active stress of the nodes", axis, "kPa")
        }
    };
    let [lowest, low, median, high, highest] = &spread.levels;
    let values = lowest.iter().chain(highest).map(|p| p.1);
    let y = Axis::new(
        axis,
        unit,
        Scale::linear(values, spread.kind != SignalKind::Stretch)?,
    );
    let x = Axis::new(
        "time since activation (ms)",
        "ms",
        Scale::exact(0.0, median.last()?.0),
    );
    let mut chart = Chart::new(
        format!(
            "spread of the {} over the nodes of {patient}",
            spread.kind.name().replace('_', " ")
        ),
        x,
        y,
    );
    for (lower, upper, class) in [(lowest, highest, "most"), (low, high, "half")] {
        chart.marks.push(Mark::Between {
            lower: lower.clone(),
            upper: upper.clone(),
            class,
        });
    }
    let line = |class, name: &str, points: &[(f64, f64)]| Series {
        class,
        name: name.into(),
        points: points.to_vec(),
        dots: false,
    };
    // These lines are invisible and serve for reading off values; the bands show where they lie.
    let quantiles = [
        (lowest, "5 % of the wall below"),
        (low, "25 %"),
        (high, "75 %"),
        (highest, "95 %"),
    ];
    chart
        .series
        .extend(quantiles.map(|(points, name)| line("quantile", name, points)));
    chart.series.push(line("step1", "median", median));
    Some((title, chart))
}

/// Text of an SVG file with all charts. `None` if the simulation kept no spread or the targets are
/// not done.
#[must_use]
pub fn spread_svg(patient: &PatientRecord, file: &SpreadFile) -> Option<String> {
    let id = &patient.plan.id;
    let mut charts: Vec<Chart> = charts(file, id.as_str()).into_iter().map(|c| c.1).collect();
    for chart in &mut charts {
        chart.size.0 = 640.0;
        chart.series.retain(|series| series.class == "step1");
    }
    let n = patient.targets.as_ref()?.result.n_nodes;
    let lines = [
        Model::of(patient).words(),
        "line: median; dark band: half of the wall; light band: nine tenths".to_owned(),
    ];
    (!charts.is_empty()).then(|| {
        stacked(
            &format!("{id}: traces of {n} nodes since activation"),
            &lines,
            &charts,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> SpreadFile {
        let levels = [0.7, 0.8, 0.85, 0.9, 0.97];
        let trace = |level: f64| {
            (0..=100)
                .map(|t| (f64::from(t), 1.0 - (1.0 - level) * f64::from(t) / 100.0))
                .collect()
        };
        SpreadFile {
            all: vec![Spread {
                kind: SignalKind::Stretch,
                levels: levels.map(trace),
            }],
        }
    }

    #[test]
    fn bands_hold_the_median_and_values_can_be_read_off() {
        let all = charts(&file(), "P1");
        assert_eq!(all[0].0, "Fibre stretch of the nodes");
        let svg = all[0].1.render().into_string();
        assert_eq!(svg.matches("class=\"between ").count(), 2);
        assert!(
            svg.contains("data-name=\"95 %\"") && svg.contains("class=\"line step1\""),
            "{svg}"
        );
        assert!(!svg.contains("NaN"));
    }
}
