//! Figure of a predicted beat next to the twin's: pressure, volume, loop.

use super::plot::{Axis, Chart, Scale, Series, stacked};

/// Lines of one beat: pressure and volume over time, and the loop.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BeatLines {
    /// Time \[ms\] and pressure \[mmHg\].
    pub pressure: Vec<(f64, f64)>,
    /// Time \[ms\] and volume \[mL\].
    pub volume: Vec<(f64, f64)>,
    /// Volume \[mL\] and pressure \[mmHg\].
    pub pv_loop: Vec<(f64, f64)>,
}

/// Text of an SVG file; empty if there is nothing to draw.
///
/// - `headline`: title with the patient; `changes`: lines below it
#[must_use]
pub fn figure(headline: &str, changes: &[String], before: &BeatLines, after: &BeatLines) -> String {
    let charts: Option<Vec<Chart>> = [
        (
            "time (ms)",
            "pressure (mmHg)",
            &before.pressure,
            &after.pressure,
        ),
        ("time (ms)", "volume (mL)", &before.volume, &after.volume),
        (
            "volume (mL)",
            "pressure (mmHg)",
            &before.pv_loop,
            &after.pv_loop,
        ),
    ]
    .into_iter()
    .map(|(x, y, before, after)| chart(x, y, before, after))
    .collect();
    charts.map_or_else(String::new, |charts| stacked(headline, changes, &charts))
}

fn chart(
    x: &'static str,
    y: &'static str,
    before: &[(f64, f64)],
    after: &[(f64, f64)],
) -> Option<Chart> {
    let all = || before.iter().chain(after);
    let across = Axis::new(x, "", Scale::linear(all().map(|p| p.0), false)?);
    let up = Axis::new(y, "", Scale::linear(all().map(|p| p.1), false)?);
    let mut chart = Chart::new(format!("{y} over {x}, before and after"), across, up);
    for (class, points) in [("before", before), ("after", after)] {
        chart.series.push(Series {
            class,
            name: class.to_owned(),
            points: points.to_vec(),
            dots: false,
        });
    }
    Some(chart)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_charts_with_both_beats_are_drawn() {
        let lines = |scale: f64| BeatLines {
            pressure: vec![(0.0, 10.0), (300.0, 120.0 * scale)],
            volume: vec![(0.0, 120.0), (300.0, 50.0)],
            pv_loop: vec![(120.0, 10.0), (50.0, 120.0 * scale)],
        };
        let svg = figure("p1", &["R: 1 to 0.8".to_owned()], &lines(1.0), &lines(0.9));
        assert!(
            svg.starts_with("<svg") && svg.contains("R: 1 to 0.8"),
            "{svg}"
        );
        assert_eq!(
            svg.matches("class=\"line before\"").count(),
            3 + 1,
            "three and the legend's"
        );
        assert_eq!(
            figure("p1", &[], &BeatLines::default(), &BeatLines::default()),
            ""
        );
    }
}
