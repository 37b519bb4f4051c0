//! Trade-off between found effects and false names (ROC curve), over the evidence that a name needs.

use crate::classes::same_class;
use crate::frame::{COLOURS, Frame, legend};
use crate::rate::{Rate, is_visible, singles};
use crate::svg::{Anchor, Svg};
use crate::{Case, Set};
use std::fmt::Write;

/// Evidence thresholds of the curve.
const THRESHOLDS: [f64; 10] = [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0, 40.0];
/// Largest share of false names on the plot's axis.
const WIDEST: f64 = 0.5;

/// Name that the case gets where this much robust evidence is needed.
fn name_at(case: &Case, threshold: f64) -> Option<&str> {
    let first = case.ranked.iter().find(|r| r.plausible)?;
    (first.evidence.min(first.robust) >= threshold).then_some(first.name.as_str())
}

/// Shares of false names and of found effects, right up to the class, at a threshold.
fn rates(set: &Set, threshold: f64) -> (Rate, Rate) {
    let nulls = set.cases.iter().filter(|c| c.is_null());
    let found = |case: &Case| {
        (case.single().zip(name_at(case, threshold)))
            .is_some_and(|((truth, _), name)| same_class(truth, name))
    };
    (
        Rate::of(nulls, |case| name_at(case, threshold).is_some()),
        Rate::of(singles(set).filter(|c| is_visible(c)), found),
    )
}

/// Draws found effects over false names.
pub fn draw(sets: &[Set]) -> String {
    let top = 60.0 + 18.0 * sets.len() as f64;
    let mut svg = Svg::new(470.0, top + 330.0);
    let title = "Found effects over false names";
    svg.text((14.0, 22.0), 14.0, Anchor::Start, 0.0, title);
    legend(&mut svg, sets.iter().map(|set| set.name.as_str()));
    let frame = Frame {
        x: 60.0,
        y: top,
        w: 380.0,
        h: 250.0,
    };
    frame.draw(&mut svg, "visible single effects, right up to the class");
    let marks = [(0.0, "0"), (0.2, "10 %"), (0.4, "20 %"), (1.0, "50 %")];
    frame.lower_axis(&mut svg, &marks, "healthy hearts that get a name");
    for (k, set) in sets.iter().enumerate() {
        let mut points: Vec<(f64, Rate)> = THRESHOLDS
            .iter()
            .map(|t| rates(set, *t))
            .map(|(wrong, right)| ((wrong.share() / WIDEST).min(1.0), right))
            .collect();
        points.reverse();
        frame.curve(&mut svg, &points, COLOURS[k % COLOURS.len()]);
    }
    svg.finish()
}

/// The curve as a Markdown table.
pub fn table(sets: &[Set]) -> String {
    let mut out = String::from("\n| set | evidence | false names | found |\n|---|---|---|---|\n");
    for set in sets {
        for threshold in THRESHOLDS {
            let (wrong, right) = rates(set, threshold);
            let _ = writeln!(
                out,
                "| {} | {threshold} | {} of {} | {} of {} |",
                set.name, wrong.hits, wrong.of, right.hits, right.of
            );
        }
    }
    out
}
