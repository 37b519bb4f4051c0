//! Confusion matrix of hidden effects against the first named effect, one panel per set.

use crate::Set;
use crate::svg::{Anchor, Svg};
use cardiotwin_validation::hidden::NAMES;

const CELL: f64 = 24.0;
const LEFT: f64 = 200.0;
const TOP: f64 = 200.0;

/// Draws the confusion matrix.
pub fn draw(sets: &[Set]) -> String {
    let names: Vec<String> = NAMES
        .iter()
        .map(|(name, ..)| name.replace('_', " "))
        .collect();
    let rows = [
        names.clone(),
        vec!["outside the catalogue".to_owned(), "nothing".to_owned()],
    ]
    .concat();
    let columns = [names, vec!["unexplained".to_owned(), "none".to_owned()]].concat();
    let panel = TOP + CELL * rows.len() as f64 + 50.0;
    let mut svg = Svg::new(
        LEFT + CELL * columns.len() as f64 + 60.0,
        panel * sets.len() as f64,
    );
    for (k, set) in sets.iter().enumerate() {
        let top = panel * k as f64 + TOP;
        let counted = counts(set);
        let n: usize = counted.iter().flatten().sum();
        svg.text(
            (10.0, top - TOP + 24.0),
            15.0,
            Anchor::Start,
            0.0,
            &format!("{}: {n} cases with one or no effect", set.name),
        );
        svg.text(
            (LEFT - 8.0, top - 8.0),
            12.0,
            Anchor::End,
            0.0,
            "hidden ↓   named first →",
        );
        for (j, name) in columns.iter().enumerate() {
            svg.text(
                (LEFT + CELL * (j as f64 + 0.65), top - 6.0),
                12.0,
                Anchor::Start,
                -60.0,
                name,
            );
        }
        for (i, name) in rows.iter().enumerate() {
            let y = top + CELL * i as f64;
            svg.text((LEFT - 8.0, y + 0.68 * CELL), 12.0, Anchor::End, 0.0, name);
            let total: usize = counted[i].iter().sum();
            for (j, count) in counted[i].iter().enumerate() {
                let share = *count as f64 / total.max(1) as f64;
                let right = i == j || (i == rows.len() - 2 && j == rows.len() - 1);
                svg.rect(LEFT + CELL * j as f64, y, CELL, CELL, &shade(share, right));
                if *count > 0 {
                    let at = (LEFT + CELL * (j as f64 + 0.5), y + 0.68 * CELL);
                    svg.text(at, 12.0, Anchor::Middle, 0.0, &count.to_string());
                }
            }
            let at = (LEFT + CELL * columns.len() as f64 + 8.0, y + 0.68 * CELL);
            svg.text(at, 11.0, Anchor::Start, 0.0, &format!("of {total}"));
        }
    }
    svg.finish()
}

/// Colour of a cell: blue if right, orange if wrong, with the row's share as intensity.
fn shade(share: f64, right: bool) -> String {
    let full = if right {
        (90.0, 150.0, 220.0)
    } else {
        (240.0, 160.0, 80.0)
    };
    let mix = |c: f64| (255.0 + (c - 255.0) * share).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(full.0), mix(full.1), mix(full.2))
}

fn counts(set: &Set) -> Vec<Vec<usize>> {
    let n = NAMES.len();
    let idx = |name: &str| NAMES.iter().position(|(known, ..)| *known == name);
    let mut table = vec![vec![0; n + 2]; n + 2];
    for case in &set.cases {
        let row = match case.single() {
            Some((name, _)) => idx(name),
            None if case.off_catalogue => Some(n),
            None if case.is_null() => Some(n + 1),
            None => None,
        };
        let nameless = if case.unexplained { n } else { n + 1 };
        let column = case.named.first().map_or(Some(nameless), |name| idx(name));
        if let (Some(row), Some(column)) = (row, column) {
            table[row][column] += 1;
        }
    }
    table
}
