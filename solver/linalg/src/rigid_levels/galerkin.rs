//! Stiffness of the groups' rigid motions about the origin, `Rᵀ (K + G D Gᵀ) R`.

use std::collections::BTreeMap;

use super::bisection::Groups;
use super::entries::Entries;
use super::motion::{Block6, Six, cross};
use crate::conjugate_gradients::Entry;

/// The rigid motions' displacement of a point: three columns are the unit vectors, three are these.
fn rotations([x, y, z]: [f64; 3]) -> [[f64; 3]; 3] {
    [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
}

/// `block R(x)`, three rows of six.
fn times_motions(block: &[[f64; 3]; 3], rotations: &[[f64; 3]; 3]) -> [Six; 3] {
    std::array::from_fn(|i| {
        let row = &block[i];
        std::array::from_fn(|j| match j {
            0..3 => row[j],
            _ => (0..3).map(|k| row[k] * rotations[j - 3][k]).sum(),
        })
    })
}

/// Force and moment about the origin of a force at `x`.
pub(super) fn moment_of<T: Entry>(x: [T; 3], f: [T; 3]) -> [T; 6] {
    let m = cross(x, f);
    [f[0], f[1], f[2], m[0], m[1], m[2]]
}

/// `to += R(x)ᵀ half`.
fn add_from_rows(x: [f64; 3], half: &[Six; 3], to: &mut Block6) {
    for j in 0..6 {
        let column = moment_of(x, [half[0][j], half[1][j], half[2][j]]);
        for i in 0..6 {
            to[6 * i + j] += column[i];
        }
    }
}

fn add(from: &[Six; 3], to: &mut [Six; 3]) {
    for (to, from) in to.iter_mut().zip(from) {
        for j in 0..6 {
            to[j] += from[j];
        }
    }
}

/// `to += d v wᵀ`.
fn add_outer(d: f64, v: &Six, w: &Six, to: &mut Block6) {
    for i in 0..6 {
        for j in 0..6 {
            to[6 * i + j] += d * v[i] * w[j];
        }
    }
}

/// Stiffness of each own group by itself, on each level but the last, and of pairs of groups on the last one.
pub(super) struct Stiffness {
    pub alone: Vec<Vec<Block6>>,
    /// Contributions of this rank, by the groups' numbers over all ranks.
    pub pairs: BTreeMap<(u32, u32), Block6>,
}

/// - `points`: positions of all nodes held
/// - `number`: number over all ranks of the last level's group, of all nodes held
pub(super) fn stiffness(
    matrix: &dyn Entries,
    points: &[[f64; 3]],
    groups: &Groups,
    number: &[u32],
) -> Stiffness {
    let pattern = matrix.pattern();
    let n = pattern.n_rows();
    let n_alone = groups.parents.len();
    let of_nodes: Vec<Vec<u32>> = (0..n_alone).map(|level| groups.of_nodes(level)).collect();
    let mut out = Stiffness {
        alone: (0..n_alone)
            .map(|level| vec![[0.0; 36]; groups.len(level)])
            .collect(),
        pairs: BTreeMap::new(),
    };
    let turns: Vec<[[f64; 3]; 3]> = points.iter().map(|x| rotations(*x)).collect();
    let mut by_level = vec![[[0.0; 6]; 3]; n_alone];
    let mut by_number: Vec<(u32, [Six; 3])> = vec![];
    let mut volumes: Vec<(u32, Six)> = vec![];
    let bulk = matrix.bulk();
    for row in 0..n {
        by_level.fill([[0.0; 6]; 3]);
        by_number.clear();
        volumes.clear();
        for slot in pattern.row(row) {
            let column = pattern.column[slot] as usize;
            let moved = times_motions(&matrix.stiffness(slot), &turns[column]);
            for (of_node, sum) in of_nodes.iter().zip(&mut by_level) {
                if column < n && of_node[column] == of_node[row] {
                    add(&moved, sum);
                }
            }
            let group = number[column];
            match by_number.iter_mut().find(|(g, _)| *g == group) {
                Some((_, sum)) => add(&moved, sum),
                None => by_number.push((group, moved)),
            }
            if !bulk.is_empty() {
                let v = moment_of(points[column], matrix.volume_of_row(slot));
                match volumes.iter_mut().find(|(g, _)| *g == group) {
                    Some((_, sum)) => (0..6).for_each(|i| sum[i] += v[i]),
                    None => volumes.push((group, v)),
                }
            }
        }
        for ((of_node, sum), alone) in of_nodes.iter().zip(&by_level).zip(&mut out.alone) {
            add_from_rows(points[row], sum, &mut alone[of_node[row] as usize]);
        }
        for (group, sum) in &by_number {
            let pair = out.pairs.entry((number[row], *group)).or_insert([0.0; 36]);
            add_from_rows(points[row], sum, pair);
        }
        for (group, v) in &volumes {
            for (other, w) in &volumes {
                let pair = out.pairs.entry((*group, *other)).or_insert([0.0; 36]);
                add_outer(bulk[row], v, w, pair);
            }
        }
    }
    if !bulk.is_empty() {
        for (level, alone) in out.alone.iter_mut().enumerate() {
            add_volumes(matrix, points, groups, level, alone);
        }
    }
    out
}

/// Adds `Rᵀ G D Gᵀ R` of each group by itself.
fn add_volumes(
    matrix: &dyn Entries,
    points: &[[f64; 3]],
    groups: &Groups,
    level: usize,
    alone: &mut [Block6],
) {
    const NONE: u32 = u32::MAX;
    let (pattern, bulk) = (matrix.pattern(), matrix.bulk());
    let mut place = vec![NONE; points.len()];
    let mut volumes: Vec<(u32, Six)> = vec![];
    for (group, sum) in alone.iter_mut().enumerate() {
        volumes.clear();
        for node in groups.nodes(level, group) {
            let row = *node as usize;
            for slot in pattern.row(row) {
                let vertex = pattern.column[slot];
                let at = &mut place[vertex as usize];
                if *at == NONE {
                    *at = volumes.len() as u32;
                    volumes.push((vertex, [0.0; 6]));
                }
                let v = moment_of(points[row], matrix.volume_of_column(slot));
                let to = &mut volumes[*at as usize].1;
                (0..6).for_each(|i| to[i] += v[i]);
            }
        }
        for (vertex, v) in &volumes {
            add_outer(bulk[*vertex as usize], v, v, sum);
            place[*vertex as usize] = NONE;
        }
    }
}
