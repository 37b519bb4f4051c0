//! Repair of badly shaped elements: edges of flat ones are collapsed, and inner nodes move to
//! positions at which the worst element around them is best.
//!
//! Nodes of the boundary do not move, so that the heart keeps its form and volume. Elements that
//! need other facets require a new mesh.

use crate::adjacency::Adjacency;
use crate::checks::{DEGENERATE, POOR_WARNING};
use crate::quality::mean_ratio;
use crate::surface::boundary;
use crate::tet_mesh::{EDGES, TetMesh};
use crate::vec3::{Vec3, add, axpy, distance, scale};

use super::nodes::{keep_elements, renumber};

/// Number of passes over all bad elements.
const ROUNDS: usize = 12;
/// Mean ratio below which elements are improved.
const WANTED: f64 = 2.0 * POOR_WARNING;

/// Counts of the changes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Shaped {
    pub(super) moved: usize,
    pub(super) collapsed: usize,
}

/// Improves elements with a mean ratio below [`WANTED`].
pub(super) fn improve(mesh: &mut TetMesh) -> Shaped {
    let mut shaped = Shaped::default();
    let mut moved = vec![false; mesh.n_nodes()];
    for _ in 0..ROUNDS {
        let collapsed = collapse_flat(mesh);
        shaped.collapsed += collapsed;
        if smooth(mesh, &mut moved) == 0 && collapsed == 0 {
            break;
        }
    }
    shaped.moved = moved.iter().filter(|m| **m).count();
    shaped
}

fn on_boundary(mesh: &TetMesh) -> Vec<bool> {
    let mut outer = vec![false; mesh.n_nodes()];
    for face in boundary(mesh) {
        face.triangle
            .iter()
            .for_each(|node| outer[*node as usize] = true);
    }
    outer
}

/// Worst mean ratio of the elements around a node.
fn worst(mesh: &TetMesh, elements: &[u32]) -> f64 {
    elements
        .iter()
        .map(|e| mean_ratio(mesh.corners(*e as usize)))
        .fold(f64::INFINITY, f64::min)
}

/// Moves inner nodes of bad elements and returns the number of improved positions.
fn smooth(mesh: &mut TetMesh, moved: &mut [bool]) -> usize {
    let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let outer = on_boundary(mesh);
    let bad = (0..mesh.n_tets()).filter(|e| mean_ratio(mesh.corners(*e)) < WANTED);
    let mut nodes: Vec<u32> = bad
        .flat_map(|e| mesh.tets[e])
        .filter(|node| !outer[*node as usize])
        .collect();
    nodes.sort_unstable();
    nodes.dedup();
    let mut n_moved = 0;
    for node in nodes {
        let elements = around.row(node as usize);
        let start = mesh.nodes_mm[node as usize];
        let (mut best, mut value) = (start, worst(mesh, elements));
        let neighbours = elements
            .iter()
            .flat_map(|e| mesh.tets[*e as usize])
            .filter(|other| *other != node);
        let (mut sum, mut n, mut reach) = ([0.0; 3], 0.0, f64::INFINITY);
        for other in neighbours {
            let x = mesh.nodes_mm[other as usize];
            sum = add(sum, x);
            n += 1.0;
            reach = reach.min(distance(x, start));
        }
        let tried = |mesh: &mut TetMesh, x: Vec3, best: &mut Vec3, value: &mut f64| {
            mesh.nodes_mm[node as usize] = x;
            let found = worst(mesh, elements);
            let better = found > *value + 1e-9;
            if better {
                (*best, *value) = (x, found);
            }
            better
        };
        tried(mesh, scale(sum, 1.0 / n), &mut best, &mut value);
        // Then along the axes, with halved steps.
        let mut step = 0.5 * reach.max(1e-3 * mesh_scale(best, sum, n));
        for _ in 0..8 {
            let mut found = false;
            for direction in 0..6 {
                let mut axis = [0.0; 3];
                axis[direction / 2] = if direction % 2 == 0 { 1.0 } else { -1.0 };
                let x = axpy(best, step, axis);
                found |= tried(mesh, x, &mut best, &mut value);
            }
            if !found {
                step *= 0.5;
            }
        }
        mesh.nodes_mm[node as usize] = best;
        if best != start {
            n_moved += 1;
            moved[node as usize] = true;
        }
    }
    n_moved
}

/// Distance between a node and the mean of its neighbours. It allows a node that coincides with
/// another one to move.
fn mesh_scale(x: Vec3, sum: Vec3, n: f64) -> f64 {
    distance(x, scale(sum, 1.0 / n))
}

/// Collapses an edge of each flat element onto a node, if the elements around it do not become
/// worse than the flat one. Returns the number of collapses.
fn collapse_flat(mesh: &mut TetMesh) -> usize {
    let outer = on_boundary(mesh);
    let mut n_collapsed = 0;
    let flat: Vec<usize> = (0..mesh.n_tets())
        .filter(|e| mean_ratio(mesh.corners(*e)) < DEGENERATE)
        .collect();
    let mut gone = vec![false; mesh.n_tets()];
    for e in flat {
        if gone[e] {
            continue;
        }
        let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
        let before = mean_ratio(mesh.corners(e)).max(0.0);
        let tet = mesh.tets[e];
        let mut best: Option<(f64, u32, u32)> = None;
        for [from, to] in EDGES
            .into_iter()
            .flat_map(|[i, j]| [[i, j], [j, i]])
            .map(|ends| ends.map(|i| tet[i]))
        {
            // A boundary node stays in place. An inner edge between two boundary nodes is therefore
            // never collapsed, and the collapses close no opening.
            if outer[from as usize] {
                continue;
            }
            let elements = around.row(from as usize).iter().map(|e| *e as usize);
            let stay = elements.filter(|e| !gone[*e] && !mesh.tets[*e].contains(&to));
            let with = |e: usize| {
                mesh.tets[e].map(|n| mesh.nodes_mm[if n == from { to } else { n } as usize])
            };
            let value = stay
                .map(|e| mean_ratio(with(e)))
                .fold(f64::INFINITY, f64::min);
            if value > before.max(1e-3) && best.is_none_or(|(other, ..)| value > other) {
                best = Some((value, from, to));
            }
        }
        if let Some((_, from, to)) = best {
            for k in around.row(from as usize) {
                gone[*k as usize] |= mesh.tets[*k as usize].contains(&to);
            }
            renumber(mesh, |node| if node == from { to } else { node });
            n_collapsed += 1;
        }
    }
    let keep: Vec<bool> = gone.iter().map(|gone| !gone).collect();
    keep_elements(mesh, &keep);
    n_collapsed
}
