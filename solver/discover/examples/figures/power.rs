//! Detection rates over strength, noise and visibility, with intervals.

use crate::svg::{Anchor, Svg};
use crate::{Case, Set};
use cardiotwin_validation::hidden::NAMES;
use std::fmt::Write;

/// Effects that these data can hardly distinguish.
const CLASSES: [[&str; 2]; 3] = [
    ["mitral_regurgitation", "ventricular_septal_defect"],
    ["passive_stiffening", "pericardial_constraint"],
    ["aortic_stenosis", "wave_reflection"],
];
const COLOURS: [&str; 4] = ["#1f6fb4", "#d9731a", "#2f8f4e", "#7a4fa3"];
/// Bands of visibility: names and lower ends.
const BANDS: [(&str, f64); 4] = [
    ("limit", f64::MIN),
    ("weak", 20.0),
    ("moderate", 50.0),
    ("strong", 150.0),
];

#[derive(Clone, Copy, Default)]
struct Rate {
    hits: usize,
    of: usize,
}

impl Rate {
    fn of<'a>(cases: impl Iterator<Item = &'a Case>, hit: impl Fn(&Case) -> bool) -> Self {
        cases.fold(Self::default(), |r, c| Self {
            hits: r.hits + usize::from(hit(c)),
            of: r.of + 1,
        })
    }

    fn share(self) -> f64 {
        self.hits as f64 / self.of.max(1) as f64
    }

    /// 95 % interval (Wilson 1927).
    fn interval(self) -> (f64, f64) {
        let (n, p, z) = (self.of.max(1) as f64, self.share(), 1.96);
        let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        ((middle - half).max(0.0), (middle + half).min(1.0))
    }

    fn words(self) -> String {
        let (low, high) = self.interval();
        let percent = |x: f64| 100.0 * x;
        format!(
            "{} of {} ({:.0} %, 95 % interval {:.0} to {:.0} %)",
            self.hits,
            self.of,
            percent(self.share()),
            percent(low),
            percent(high)
        )
    }
}

fn same_class(a: &str, b: &str) -> bool {
    a == b
        || CLASSES
            .iter()
            .any(|class| class.contains(&a) && class.contains(&b))
}

fn right_first(case: &Case) -> bool {
    case.single()
        .is_some_and(|(truth, _)| case.named.first() == Some(truth))
}

fn right_class(case: &Case) -> bool {
    case.single()
        .is_some_and(|(truth, _)| case.named.first().is_some_and(|n| same_class(n, truth)))
}

/// Frame of a plot: the rate from 0 to 1 over an axis from 0 to 1.
struct Frame {
    x: f64,
    y: f64,
    w: f64,
    h: f64,
}

impl Frame {
    fn at(&self, x: f64, rate: f64) -> (f64, f64) {
        (self.x + self.w * x, self.y + self.h * (1.0 - rate))
    }

    fn draw(&self, svg: &mut Svg, title: &str) {
        svg.rect(self.x, self.y, self.w, self.h, "#fafafa");
        for (rate, name) in [(0.0, "0"), (0.5, "½"), (1.0, "1")] {
            svg.line(self.at(0.0, rate), self.at(1.0, rate), "#d8d8d8", 0.7);
            let (x, y) = self.at(0.0, rate);
            svg.text((x - 5.0, y + 4.0), 11.0, Anchor::End, 0.0, name);
        }
        svg.text((self.x, self.y - 7.0), 12.0, Anchor::Start, 0.0, title);
    }

    /// Draws points with intervals, joined by lines.
    fn curve(&self, svg: &mut Svg, points: &[(f64, Rate)], colour: &str) {
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

/// Draws the rates over visibility for each set, then those of each effect over its strength.
pub fn draw(sets: &[Set]) -> String {
    let (columns, w, h) = (4, 180.0, 110.0);
    let rows = NAMES.len().div_ceil(columns);
    let mut svg = Svg::new(
        60.0 + columns as f64 * (w + 50.0),
        345.0 + rows as f64 * (h + 62.0) + 20.0,
    );
    svg.text(
        (14.0, 22.0),
        15.0,
        Anchor::Start,
        0.0,
        "Share of cases with one effect whose right name, up to its class, comes first",
    );
    for (k, set) in sets.iter().enumerate() {
        let y = 42.0 + 18.0 * k as f64;
        svg.disc((20.0, y - 4.0), 4.0, COLOURS[k % COLOURS.len()]);
        svg.text(
            (30.0, y),
            12.0,
            Anchor::Start,
            0.0,
            &format!("{} (bars: 95 %)", set.name),
        );
    }
    let wide = Frame {
        x: 60.0,
        y: 120.0,
        w: 380.0,
        h: 140.0,
    };
    wide.draw(
        &mut svg,
        "by visibility (fall of χ² that the right effect makes without noise)",
    );
    let noise = Frame {
        x: 540.0,
        y: 120.0,
        w: 300.0,
        h: 140.0,
    };
    noise.draw(
        &mut svg,
        "by noise (factor of the usual one; effects not hard)",
    );
    let factors = [0.5, 1.0, 2.0];
    for (i, factor) in factors.iter().enumerate() {
        let (x, y) = noise.at((i as f64 + 0.5) / 3.0, 0.0);
        svg.text(
            (x, y + 15.0),
            11.0,
            Anchor::Middle,
            0.0,
            &format!("{factor}"),
        );
    }
    for (b, (name, low)) in BANDS.iter().enumerate() {
        let (x, y) = wide.at((b as f64 + 0.5) / 4.0, 0.0);
        let from = if b == 0 {
            "< 20".to_owned()
        } else {
            format!("≥ {low}")
        };
        svg.text(
            (x, y + 15.0),
            11.0,
            Anchor::Middle,
            0.0,
            &format!("{name} ({from})"),
        );
    }
    for (k, set) in sets.iter().enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let shift = 0.012 * k as f64;
        let in_band: Vec<(f64, Rate)> = (0..BANDS.len())
            .map(|b| {
                (
                    (b as f64 + 0.5) / 4.0 + shift,
                    Rate::of(singles(set).filter(|c| band(c) == Some(b)), right_class),
                )
            })
            .collect();
        wide.curve(&mut svg, &in_band, colour);
        let with = |f: f64| move |c: &&Case| !c.hard && (c.noise - f).abs() < 1e-9;
        let by_noise: Vec<(f64, Rate)> = (factors.iter().enumerate())
            .map(|(i, f)| {
                (
                    (i as f64 + 0.5) / 3.0 + shift,
                    Rate::of(singles(set).filter(with(*f)), right_class),
                )
            })
            .collect();
        noise.curve(&mut svg, &by_noise, colour);
    }
    for (e, (name, smallest, levels)) in NAMES.iter().enumerate() {
        let frame = Frame {
            x: 50.0 + (e % columns) as f64 * (w + 50.0),
            y: 345.0 + (e / columns) as f64 * (h + 62.0),
            w,
            h,
        };
        frame.draw(&mut svg, &name.replace('_', " "));
        let x = |level: usize| (level as f64 + 0.5) / 4.0;
        for (level, size) in levels.iter().enumerate() {
            let (x, y) = frame.at(x(level), 0.0);
            svg.text(
                (x, y + 14.0),
                10.5,
                Anchor::Middle,
                0.0,
                &format!("{:.1}×", size / smallest),
            );
        }
        for (k, set) in sets.iter().enumerate() {
            let at = |level: usize| {
                let nearest = |size: f64| {
                    let off = |l: &usize| (levels[*l] / smallest / size).ln().abs();
                    (0..levels.len())
                        .min_by(|a, b| off(a).total_cmp(&off(b)))
                        .expect("four levels")
                };
                let cases = singles(set).filter(|c| {
                    c.single().is_some_and(|(n, size)| {
                        n == name && *size > 0.0 && nearest(*size) == level
                    })
                });
                (x(level) + 0.015 * k as f64, Rate::of(cases, right_class))
            };
            let points: Vec<(f64, Rate)> = (0..levels.len()).map(at).collect();
            frame.curve(&mut svg, &points, COLOURS[k % COLOURS.len()]);
        }
    }
    svg.text(
        (14.0, 316.0 - 6.0),
        12.0,
        Anchor::Start,
        0.0,
        "by strength, in multiples of the smallest meaningful one (all noise together)",
    );
    svg.finish()
}

fn singles(set: &Set) -> impl Iterator<Item = &Case> {
    set.cases.iter().filter(|c| c.single().is_some())
}

fn band(case: &Case) -> Option<usize> {
    let seen = case.visibility?;
    BANDS.iter().rposition(|(_, low)| seen >= *low)
}

/// The scores as a Markdown table.
pub fn table(sets: &[Set]) -> String {
    let mut out = String::from("| set | figure | |\n|---|---|---|\n");
    for set in sets {
        let mut row = |figure: &str, rate: Rate| {
            if rate.of > 0 {
                let _ = writeln!(out, "| {} | {figure} | {} |", set.name, rate.words());
            }
        };
        let seen = |c: &&Case| !c.hard && band(c).is_none_or(|b| b > 0);
        row(
            "one effect, weak or better: right name first",
            Rate::of(singles(set).filter(seen), right_first),
        );
        row(
            "one effect, weak or better: right class first",
            Rate::of(singles(set).filter(seen), right_class),
        );
        let limit = |c: &&Case| c.hard || band(c) == Some(0);
        let careful = |c: &Case| c.named.is_empty() || right_class(c);
        row(
            "one effect, hard or at the limit: right class or none",
            Rate::of(singles(set).filter(limit), careful),
        );
        row(
            "nothing missing: a name (false alarm)",
            Rate::of(set.cases.iter().filter(|c| c.is_null()), |c| {
                !c.named.is_empty()
            }),
        );
        let doubles = || set.cases.iter().filter(|c| c.hidden.len() == 2);
        let is_hidden =
            |c: &Case, name: &String| c.hidden.iter().any(|(truth, _)| same_class(truth, name));
        row(
            "two effects: first name is one of them",
            Rate::of(doubles(), |c| {
                c.named.first().is_some_and(|n| is_hidden(c, n))
            }),
        );
        let both = |c: &Case| {
            c.hidden
                .iter()
                .all(|(truth, _)| c.named.iter().any(|n| same_class(n, truth)))
        };
        row("two effects: both added", Rate::of(doubles(), both));
        let off = set.cases.iter().filter(|c| c.off_catalogue);
        row(
            "gap outside the catalogue: unexplained or none",
            Rate::of(off, |c| c.named.is_empty()),
        );
    }
    out
}
