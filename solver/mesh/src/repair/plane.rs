//! Cut at a plane through the base: tissue above it is removed or becomes passive.

use std::collections::BTreeMap;

use super::nodes::keep_elements;
use crate::adjacency::Adjacency;
use crate::tet_mesh::{EDGES, TetMesh, volume_mm3};
use crate::vec3::{Vec3, axpy, distance, dot, sub};

/// Distance from the plane, as a share of the shortest cut edge, below which a node is moved onto
/// the plane, so that the cut leaves no sliver.
const SNAP: f64 = 0.25;

/// A plane. Its normal points to the side that is removed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point in the plane \[mm\].
    pub point_mm: Vec3,
    /// Unit normal of the plane.
    pub normal: Vec3,
}

impl Plane {
    /// Height of a point above the plane \[mm\].
    #[must_use]
    pub fn above_mm(&self, x: Vec3) -> f64 {
        dot(sub(x, self.point_mm), self.normal)
    }
}

/// Tags the elements whose centroid lies above the plane, and returns their number.
pub(super) fn tag_above(mesh: &mut TetMesh, plane: &Plane, tag: i32) -> usize {
    let above: Vec<usize> = (0..mesh.n_tets())
        .filter(|e| plane.above_mm(mesh.centroid_mm(*e)) > 0.0)
        .collect();
    for e in &above {
        mesh.tags[*e] = tag;
    }
    above.len()
}

/// Cuts the mesh at the plane and returns the number of cut or removed elements. Surfaces lose the
/// triangles at cut elements.
pub(super) fn cut(mesh: &mut TetMesh, plane: &Plane) -> usize {
    let mut height: Vec<f64> = mesh.nodes_mm.iter().map(|x| plane.above_mm(*x)).collect();
    snap(mesh, plane, &mut height);
    let mut at_edge: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let (mut tets, mut tags, mut frames) = (Vec::new(), Vec::new(), Vec::new());
    let mut n_changed = 0;
    for e in 0..mesh.n_tets() {
        let tet = mesh.tets[e];
        let above = tet.map(|node| height[node as usize] > 0.0);
        let below = tet.map(|node| height[node as usize] < 0.0);
        let parts = if !above.contains(&true) {
            vec![tet]
        } else if !below.contains(&true) {
            vec![]
        } else {
            lower_part(mesh, &height, tet, &mut at_edge)
        };
        n_changed += usize::from(parts != [tet]);
        for part in parts {
            tets.push(part);
            tags.push(mesh.tags[e]);
            frames.extend(mesh.frames.get(e));
        }
    }
    mesh.tets = tets;
    mesh.tags = tags;
    mesh.frames = frames;
    let flat: Vec<bool> = (0..mesh.n_tets())
        .map(|e| mesh.volume_mm3(e) > 0.0)
        .collect();
    keep_elements(mesh, &flat);
    n_changed
}

/// Moves nodes near the plane into it, unless this inverts an element.
fn snap(mesh: &mut TetMesh, plane: &Plane, height: &mut [f64]) {
    let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let mut shortest = vec![f64::INFINITY; mesh.n_nodes()];
    for tet in &mesh.tets {
        for [i, j] in EDGES.map(|edge| edge.map(|i| tet[i] as usize)) {
            if height[i] * height[j] < 0.0 {
                let length = distance(mesh.nodes_mm[i], mesh.nodes_mm[j]);
                shortest[i] = shortest[i].min(length);
                shortest[j] = shortest[j].min(length);
            }
        }
    }
    for node in 0..mesh.n_nodes() {
        if height[node] == 0.0
            || height[node].abs() > SNAP * shortest[node]
            || !shortest[node].is_finite()
        {
            continue;
        }
        let old = mesh.nodes_mm[node];
        let before: Vec<f64> = around
            .row(node)
            .iter()
            .map(|e| mesh.volume_mm3(*e as usize))
            .collect();
        mesh.nodes_mm[node] = axpy(old, -height[node], plane.normal);
        let sound = around
            .row(node)
            .iter()
            .zip(before)
            .all(|(e, v)| mesh.volume_mm3(*e as usize) > 0.2 * v);
        if sound {
            height[node] = 0.0;
        } else {
            mesh.nodes_mm[node] = old;
        }
    }
}

/// Tetrahedra of a cut element's part below the plane. Diagonals of quadrilaterals begin at the
/// smallest node, so that neighbours agree.
fn lower_part(
    mesh: &mut TetMesh,
    height: &[f64],
    tet: [u32; 4],
    at_edge: &mut BTreeMap<[u32; 2], u32>,
) -> Vec<[u32; 4]> {
    let mut crossing = |a: u32, b: u32| {
        let key = [a.min(b), a.max(b)];
        *at_edge.entry(key).or_insert_with(|| {
            let (low, high) = (height[key[0] as usize], height[key[1] as usize]);
            let [x, y] = key.map(|node| mesh.nodes_mm[node as usize]);
            mesh.nodes_mm.push(axpy(x, low / (low - high), sub(y, x)));
            mesh.nodes_mm.len() as u32 - 1
        })
    };
    let of = |sign: f64| {
        tet.into_iter()
            .filter(move |node| height[*node as usize] * sign > 0.0)
            .collect::<Vec<u32>>()
    };
    let (below, above) = (of(-1.0), of(1.0));
    let on: Vec<u32> = tet
        .into_iter()
        .filter(|node| height[*node as usize] == 0.0)
        .collect();
    let parts = match (&below[..], &above[..], &on[..]) {
        ([a], [b, c, d], []) => vec![[*a, crossing(*a, *b), crossing(*a, *c), crossing(*a, *d)]],
        ([a], [b, c], [p]) => vec![[*a, *p, crossing(*a, *b), crossing(*a, *c)]],
        ([a], [b], [p, q]) => vec![[*a, *p, *q, crossing(*a, *b)]],
        ([a, b], [c], [p]) => {
            let (ac, bc) = (crossing(*a, *c), crossing(*b, *c));
            // Pyramid over the quadrilateral a, b, bc, ac with its apex at p.
            pyramid([*a, *b, bc, ac], *p)
        }
        ([a, b], [c, d], []) => {
            let [ac, ad, bc, bd] =
                [(*a, *c), (*a, *d), (*b, *c), (*b, *d)].map(|(x, y)| crossing(x, y));
            prism([*a, ac, ad], [*b, bc, bd])
        }
        ([a, b, c], [d], []) => {
            let [ad, bd, cd] = [*a, *b, *c].map(|x| crossing(x, *d));
            prism([*a, *b, *c], [ad, bd, cd])
        }
        _ => vec![],
    };
    let upright = |part: [u32; 4]| {
        let x = part.map(|node| mesh.nodes_mm[node as usize]);
        if volume_mm3(x) < 0.0 {
            [part[0], part[1], part[3], part[2]]
        } else {
            part
        }
    };
    parts.into_iter().map(upright).collect()
}

/// Divides a pyramid into two tetrahedra, with the base's diagonal at the smallest node.
fn pyramid(base: [u32; 4], top: u32) -> Vec<[u32; 4]> {
    let first = (0..4).min_by_key(|i| base[*i]).unwrap_or(0);
    let at = |i: usize| base[(first + i) % 4];
    vec![[at(0), at(1), at(2), top], [at(0), at(2), at(3), top]]
}

/// Divides a prism into three tetrahedra, with the diagonal of each side at its smallest node
/// (Dompierre et al. 1999). The smallest of all nodes is joined to the opposite triangle and to the
/// opposite side.
fn prism(low: [u32; 3], high: [u32; 3]) -> Vec<[u32; 4]> {
    let smallest = low.into_iter().chain(high).min().unwrap_or(0);
    let (near, far) = if low.contains(&smallest) {
        (low, high)
    } else {
        (high, low)
    };
    let k = near.iter().position(|node| *node == smallest).unwrap_or(0);
    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
    let mut parts = vec![[smallest, far[0], far[1], far[2]]];
    parts.extend(pyramid([near[i], near[j], far[j], far[i]], smallest));
    parts
}
