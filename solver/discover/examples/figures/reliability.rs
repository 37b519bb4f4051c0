//! Reliability of the stated probabilities: how often a name is right that is said with a
//! probability.

use crate::frame::{COLOURS, Frame, legend};
use crate::rate::Rate;
use crate::svg::{Anchor, Svg};
use crate::{Case, Set};
use std::fmt::Write;

/// Upper ends of the bins of the probability.
const BINS: [f64; 6] = [0.1, 0.3, 0.5, 0.7, 0.9, 1.0];

/// Lower and upper end of a bin.
fn ends(bin: usize) -> (f64, f64) {
    let lower = bin.checked_sub(1).map_or(0.0, |below| BINS[below]);
    (lower, BINS[bin])
}

/// Right answers and mean stated probability in each bin, over the first-ranked effect of each case
/// of the catalogue.
fn bins(cases: &[&Case]) -> Vec<(f64, Rate)> {
    let stated: Vec<(f64, &Case, bool)> = (cases.iter())
        .filter(|case| !case.off_catalogue)
        .filter_map(|case| {
            let first = case.ranked.first()?;
            let right = case.hidden.iter().any(|(name, _)| *name == first.name);
            Some((first.probability, *case, right))
        })
        .collect();
    (0..BINS.len())
        .map(|bin| {
            let (lower, upper) = ends(bin);
            let is_in = |p: f64| p <= upper && (p > lower || bin == 0);
            let own: Vec<_> = stated.iter().filter(|(p, ..)| is_in(*p)).collect();
            let mean = own.iter().map(|(p, ..)| p).sum::<f64>() / own.len().max(1) as f64;
            let rate = Rate {
                hits: own.iter().filter(|(.., right)| *right).count(),
                of: own.len(),
            };
            (mean, rate)
        })
        .collect()
}

/// All sets and their union.
fn groups(sets: &[Set]) -> Vec<(&str, Vec<&Case>)> {
    let mut all: Vec<(&str, Vec<&Case>)> = (sets.iter())
        .map(|set| (set.name.as_str(), set.cases.iter().collect()))
        .collect();
    all.push(("all", sets.iter().flat_map(|set| &set.cases).collect()));
    all
}

/// Draws the reliability diagram of all cases.
pub fn draw(sets: &[Set]) -> String {
    let mut svg = Svg::new(400.0, 440.0);
    let title = "How often the first-ranked effect is right";
    svg.text((14.0, 22.0), 14.0, Anchor::Start, 0.0, title);
    legend(&mut svg, ["all sets together"].into_iter());
    let frame = Frame {
        x: 60.0,
        y: 80.0,
        w: 300.0,
        h: 300.0,
    };
    frame.draw(&mut svg, "share of right effects");
    let marks = [(0.0, "0"), (0.5, "½"), (1.0, "1")];
    frame.lower_axis(&mut svg, &marks, "stated probability");
    svg.line(frame.at(0.0, 0.0), frame.at(1.0, 1.0), "#a0a0a0", 1.0);
    let groups = groups(sets);
    let (_, all) = groups.last().expect("the union is always there");
    frame.curve(&mut svg, &bins(all), COLOURS[0]);
    svg.finish()
}

/// The diagram as a Markdown table.
pub fn table(sets: &[Set]) -> String {
    let mut out = String::from("\n| set | stated | mean | right |\n|---|---|---|---|\n");
    for (name, cases) in groups(sets) {
        for (bin, (mean, rate)) in bins(&cases).into_iter().enumerate() {
            let (lower, upper) = ends(bin);
            if rate.of > 0 {
                let _ = writeln!(
                    out,
                    "| {name} | {lower} to {upper} | {mean:.2} | {} |",
                    rate.words()
                );
            }
        }
    }
    out
}
