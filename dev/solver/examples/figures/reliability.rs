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

/// Effects whose probabilities are judged.
#[derive(Clone, Copy)]
enum Stated {
    /// The first-ranked effect of each case, if its strength may be named.
    First,
    /// Named effects.
    Named,
}

impl Stated {
    const ALL: [Self; 2] = [Self::First, Self::Named];

    fn words(self) -> &'static str {
        match self {
            Self::First => "first-ranked effects of a strength that may be named",
            Self::Named => "named effects",
        }
    }

    /// Probabilities, and whether the effect is hidden in the case.
    fn of(self, case: &Case) -> Vec<(f64, bool)> {
        let is_right = |name: &String| case.hidden.iter().any(|(hidden, _)| hidden == name);
        let first = case.ranked.first().filter(|r| r.plausible);
        let chosen: Vec<_> = match self {
            Self::First => first.into_iter().collect(),
            Self::Named => (case.ranked.iter())
                .filter(|r| case.named.contains(&r.name))
                .collect(),
        };
        (chosen.into_iter())
            .map(|r| (r.probability, is_right(&r.name)))
            .collect()
    }

    /// Mean stated probability and right effects in each bin, over the cases of the catalogue.
    fn bins(self, sets: &[Set]) -> Vec<(f64, Rate)> {
        let stated: Vec<(f64, bool)> = (sets.iter().flat_map(|set| &set.cases))
            .filter(|case| !case.off_catalogue)
            .flat_map(|case| self.of(case))
            .collect();
        (0..BINS.len())
            .map(|bin| {
                let (lower, upper) = ends(bin);
                let is_in = |p: f64| p <= upper && (p > lower || bin == 0);
                let own: Vec<_> = stated.iter().filter(|(p, _)| is_in(*p)).collect();
                let mean = own.iter().map(|(p, _)| p).sum::<f64>() / own.len().max(1) as f64;
                let rate = Rate {
                    hits: own.iter().filter(|(_, right)| *right).count(),
                    of: own.len(),
                };
                (mean, rate)
            })
            .collect()
    }
}

/// Draws the reliability diagram over all sets.
pub fn draw(sets: &[Set]) -> String {
    let mut svg = Svg::new(470.0, 460.0);
    let title = "How often a stated effect is right";
    svg.text((14.0, 22.0), 14.0, Anchor::Start, 0.0, title);
    legend(&mut svg, Stated::ALL.map(Stated::words).into_iter());
    let frame = Frame {
        x: 60.0,
        y: 100.0,
        w: 300.0,
        h: 300.0,
    };
    frame.draw(&mut svg, "share of right effects");
    let marks = [(0.0, "0"), (0.5, "½"), (1.0, "1")];
    frame.lower_axis(&mut svg, &marks, "stated probability");
    svg.line(frame.at(0.0, 0.0), frame.at(1.0, 1.0), "#a0a0a0", 1.0);
    for (stated, colour) in Stated::ALL.into_iter().zip(COLOURS) {
        frame.curve(&mut svg, &stated.bins(sets), colour);
    }
    svg.finish()
}

/// The diagram as a Markdown table.
pub fn table(sets: &[Set]) -> String {
    let mut out = String::from("\n| effects | stated | mean | right |\n|---|---|---|---|\n");
    for stated in Stated::ALL {
        for (bin, (mean, rate)) in stated.bins(sets).into_iter().enumerate() {
            let (lower, upper) = ends(bin);
            if rate.of > 0 {
                let (name, words) = (stated.words(), rate.words());
                let _ = writeln!(out, "| {name} | {lower} to {upper} | {mean:.2} | {words} |");
            }
        }
    }
    out
}
