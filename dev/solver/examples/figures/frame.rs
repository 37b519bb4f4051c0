//! Frame of a plot: a rate from 0 to 1 over an axis from 0 to 1.

use crate::rate::Rate;
use crate::svg::{Anchor, Svg};

/// Colours of the sets, in their order.
pub const COLOURS: [&str; 6] = [
    "#1f6fb4", "#d9731a", "#2f8f4e", "#7a4fa3", "#b4452f", "#6b6b6b",
];

/// Position and size of a plot \[px\].
pub struct Frame {
    pub x: f64,
    pub y: f64,
    pub w: f64,
    pub h: f64,
}

impl Frame {
    /// Place of a point of the plot.
    pub fn at(&self, x: f64, rate: f64) -> (f64, f64) {
        (self.x + self.w * x, self.y + self.h * (1.0 - rate))
    }

    /// Draws the area, the axis of the rate, and a title.
    pub fn draw(&self, svg: &mut Svg, title: &str) {
        svg.rect(self.x, self.y, self.w, self.h, "#fafafa");
        for (rate, name) in [(0.0, "0"), (0.5, "½"), (1.0, "1")] {
            svg.line(self.at(0.0, rate), self.at(1.0, rate), "#d8d8d8", 0.7);
            let (x, y) = self.at(0.0, rate);
            svg.text((x - 5.0, y + 4.0), 11.0, Anchor::End, 0.0, name);
        }
        svg.text((self.x, self.y - 7.0), 12.0, Anchor::Start, 0.0, title);
    }

    /// Draws marks of the lower axis and its name.
    pub fn lower_axis(&self, svg: &mut Svg, marks: &[(f64, &str)], name: &str) {
        for (at, text) in marks {
            let (x, y) = self.at(*at, 0.0);
            svg.text((x, y + 15.0), 11.0, Anchor::Middle, 0.0, text);
        }
        let (x, y) = self.at(0.5, 0.0);
        svg.text((x, y + 32.0), 12.0, Anchor::Middle, 0.0, name);
    }

    /// Draws points with intervals, joined by lines.
    pub fn curve(&self, svg: &mut Svg, points: &[(f64, Rate)], colour: &str) {
        let points: Vec<&(f64, Rate)> = points.iter().filter(|(_, r)| r.of > 0).collect();
        for pair in points.windows(2) {
            svg.line(
                self.at(pair[0].0, pair[0].1.share()),
                self.at(pair[1].0, pair[1].1.share()),
                colour,
                1.5,
            );
        }
        for (x, rate) in points {
            let (low, high) = rate.interval();
            svg.line(self.at(*x, low), self.at(*x, high), colour, 0.6);
            svg.disc(self.at(*x, rate.share()), 3.0, colour);
        }
    }
}

/// Names of the sets next to their colours.
pub fn legend<'a>(svg: &mut Svg, names: impl Iterator<Item = &'a str>) {
    for (k, name) in names.enumerate() {
        let y = 42.0 + 18.0 * k as f64;
        svg.disc((20.0, y - 4.0), 4.0, COLOURS[k % COLOURS.len()]);
        let text = format!("{name} (bars: 95 %)");
        svg.text((30.0, y), 12.0, Anchor::Start, 0.0, &text);
    }
}
