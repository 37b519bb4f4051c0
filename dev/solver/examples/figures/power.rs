//! Detection rates over strength, noise and visibility, with intervals.

use crate::classes::same_class;
use crate::frame::{COLOURS, Frame, legend};
use crate::rate::{BANDS, Rate, band, is_visible, right_class, right_first, singles};
use crate::svg::{Anchor, Svg};
use crate::{Case, Set};
use cardiotwin_validation::hidden::NAMES;
use std::fmt::Write;

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
    legend(&mut svg, sets.iter().map(|set| set.name.as_str()));
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

/// The scores as a Markdown table.
pub fn table(sets: &[Set]) -> String {
    let mut out = String::from("| set | figure | |\n|---|---|---|\n");
    for set in sets {
        let mut row = |figure: &str, rate: Rate| {
            if rate.of > 0 {
                let _ = writeln!(out, "| {} | {figure} | {} |", set.name, rate.words());
            }
        };
        let seen = |c: &&Case| is_visible(c);
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
