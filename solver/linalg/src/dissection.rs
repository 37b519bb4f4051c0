//! Fill-reducing order from coordinates, by nested dissection of boxes.

use crate::Pattern;

/// Number of rows below which a part is not divided further.
const SMALLEST_PART: usize = 24;

/// Elimination order of the rows of a symmetric `pattern`, whose rows lie at `points` (three
/// numbers each). Each part is divided in half across its longest side; the two halves come first,
/// and the separator between them last. Row `order[k]` is the `k`-th to be eliminated.
#[must_use]
pub fn nested_dissection(pattern: &Pattern, points: &[f64]) -> Vec<u32> {
    let mut order = Vec::with_capacity(pattern.n_rows());
    let mut side = vec![0_u8; pattern.n_rows()];
    dissect(
        pattern,
        points,
        (0..pattern.n_rows() as u32).collect(),
        &mut side,
        &mut order,
    );
    order
}

fn dissect(
    pattern: &Pattern,
    points: &[f64],
    mut part: Vec<u32>,
    side: &mut [u8],
    order: &mut Vec<u32>,
) {
    if part.len() <= SMALLEST_PART {
        order.extend(part);
        return;
    }
    let at = |node: u32, axis: usize| points[3 * node as usize + axis];
    let extent = |axis: usize| {
        let (low, high) = part
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), n| {
                (l.min(at(*n, axis)), h.max(at(*n, axis)))
            });
        high - low
    };
    let extents = [extent(0), extent(1), extent(2)];
    let axis = (0..3).fold(0, |m, k| if extents[k] > extents[m] { k } else { m });
    part.sort_by(|a, b| at(*a, axis).total_cmp(&at(*b, axis)).then(a.cmp(b)));
    let upper = part.split_off(part.len() / 2);
    for n in &part {
        side[*n as usize] = 1;
    }
    for n in &upper {
        side[*n as usize] = 2;
    }
    // The separator is the boundary of the upper half with the lower one.
    let touches = |n: u32| {
        pattern.row(n as usize).any(|k| {
            side.get(pattern.column[k] as usize)
                .is_some_and(|s| *s == 1)
        })
    };
    let (separator, inner): (Vec<u32>, Vec<u32>) = upper.iter().partition(|n| touches(**n));
    for n in part.iter().chain(&upper) {
        side[*n as usize] = 0;
    }
    if inner.is_empty() {
        order.extend(part);
        order.extend(separator);
        return;
    }
    dissect(pattern, points, part, side, order);
    dissect(pattern, points, inner, side, order);
    order.extend(separator);
}
