//! Repair of tissue that touches itself in an edge or a node, where four boundary triangles meet
//! and the boundary does not form a surface.

use std::collections::BTreeMap;

use super::nodes::keep_elements;
use crate::adjacency::Adjacency;
use crate::checks::branched_edges;
use crate::find_surfaces::Groups;
use crate::surface::sorted;
use crate::tet_mesh::{FACES, TetMesh};
use crate::vec3::{add, axpy, scale, sub};

/// Distance by which a separated node moves towards the centre of its own elements, as a share of
/// the way, so that no two nodes coincide.
const APART: f64 = 0.03;
/// Number of passes; places that still touch after them are left for the checks to report.
const ROUNDS: usize = 8;

/// Counts of the changes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Parted {
    pub(super) doubled: usize,
    pub(super) removed: usize,
}

/// Separates tissue that touches itself. A node whose elements form groups without a common face
/// becomes several nodes. If the elements around an edge form such groups but those around its ends
/// do not, the smaller group is removed.
pub(super) fn part(mesh: &mut TetMesh) -> Parted {
    let mut parted = Parted::default();
    for _ in 0..ROUNDS {
        let edges = branched_edges(mesh);
        if edges.is_empty() {
            break;
        }
        let doubled = part_nodes(mesh, &edges);
        parted.doubled += doubled;
        if doubled == 0 {
            let removed = remove_smaller_fans(mesh, &edges);
            parted.removed += removed;
            if removed == 0 {
                break;
            }
        }
    }
    parted
}

/// Groups of elements that are connected by faces containing all of `nodes`.
fn fans(mesh: &TetMesh, elements: &[u32], nodes: &[u32]) -> Vec<Vec<u32>> {
    let mut groups = Groups::new(elements.len());
    let mut at_face: BTreeMap<[u32; 3], usize> = BTreeMap::new();
    for (k, e) in elements.iter().enumerate() {
        let tet = mesh.tets[*e as usize];
        for face in FACES.map(|face| face.map(|i| tet[i])) {
            if nodes.iter().all(|node| face.contains(node))
                && let Some(other) = at_face.insert(sorted(face), k)
            {
                groups.join(other, k);
            }
        }
    }
    let mut fans: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for (k, e) in elements.iter().enumerate() {
        fans.entry(groups.of(k)).or_default().push(*e);
    }
    let mut fans: Vec<Vec<u32>> = fans.into_values().collect();
    fans.sort_by_key(|fan| std::cmp::Reverse(fan.len()));
    fans
}

fn part_nodes(mesh: &mut TetMesh, edges: &[[u32; 2]]) -> usize {
    let mut nodes: Vec<u32> = edges.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    let mut n_doubled = 0;
    for node in nodes {
        let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
        let at_mm = mesh.nodes_mm[node as usize];
        for fan in fans(mesh, around.row(node as usize), &[node])
            .into_iter()
            .skip(1)
        {
            let new = mesh.n_nodes() as u32;
            let sum = fan
                .iter()
                .fold([0.0; 3], |sum, e| add(sum, mesh.centroid_mm(*e as usize)));
            let own = scale(sum, 1.0 / fan.len() as f64);
            mesh.nodes_mm.push(axpy(at_mm, APART, sub(own, at_mm)));
            let mut faces = Vec::new();
            for e in &fan {
                let tet = &mut mesh.tets[*e as usize];
                faces.extend(FACES.map(|face| sorted(face.map(|i| tet[i]))));
                *tet = tet.map(|other| if other == node { new } else { other });
            }
            faces.sort_unstable();
            for triangle in mesh.surfaces.iter_mut().flat_map(|s| &mut s.triangles) {
                if triangle.contains(&node) && faces.binary_search(&sorted(*triangle)).is_ok() {
                    *triangle = triangle.map(|other| if other == node { new } else { other });
                }
            }
            n_doubled += 1;
        }
    }
    n_doubled
}

fn remove_smaller_fans(mesh: &mut TetMesh, edges: &[[u32; 2]]) -> usize {
    let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let mut keep = vec![true; mesh.n_tets()];
    for [a, b] in edges {
        let both = around
            .row(*a as usize)
            .iter()
            .filter(|e| mesh.tets[**e as usize].contains(b));
        let both: Vec<u32> = both.copied().collect();
        for fan in fans(mesh, &both, &[*a, *b]).into_iter().skip(1) {
            fan.iter().for_each(|e| keep[*e as usize] = false);
        }
    }
    keep_elements(mesh, &keep);
    keep.iter().filter(|k| !**k).count()
}
