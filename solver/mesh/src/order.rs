//! Renumbering of a mesh, so that neighbours in space are neighbours in memory.

use crate::adjacency::Adjacency;
use crate::surface::Surface;
use crate::tet_mesh::TetMesh;
use std::collections::VecDeque;

/// A new order of nodes and elements, as a map from new to old numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Renumbering {
    /// Old number of each node in the new order.
    pub nodes: Vec<u32>,
    /// Old number of each element in the new order.
    pub tets: Vec<u32>,
}

impl Renumbering {
    /// Reverse Cuthill-McKee order, which has a small bandwidth. It starts each connected part of
    /// the mesh at a peripheral node and takes neighbours by degree, then by number.
    ///
    /// Source: Cuthill, McKee 1969, reversed after George 1971.
    #[must_use]
    pub fn reverse_cuthill_mckee(mesh: &TetMesh) -> Self {
        let graph = Adjacency::node_to_nodes(mesh.n_nodes(), &mesh.tets);
        let degree = |node: u32| graph.row(node as usize).len();
        let mut placed = vec![false; mesh.n_nodes()];
        let mut order: Vec<u32> = Vec::with_capacity(mesh.n_nodes());
        for seed in 0..mesh.n_nodes() as u32 {
            if placed[seed as usize] {
                continue;
            }
            let start = far_node(&graph, seed);
            let first = order.len();
            placed[start as usize] = true;
            order.push(start);
            let mut at = first;
            while at < order.len() {
                let mut next: Vec<u32> = graph
                    .row(order[at] as usize)
                    .iter()
                    .copied()
                    .filter(|node| !placed[*node as usize])
                    .collect();
                next.sort_unstable_by_key(|node| (degree(*node), *node));
                for node in next {
                    placed[node as usize] = true;
                    order.push(node);
                }
                at += 1;
            }
        }
        order.reverse();
        Self::of_nodes(mesh, order)
    }

    /// Order along Hilbert's curve through the mesh's bounding cube. It is cheap and gives compact
    /// pieces, which suits caches and partitions into ranges.
    #[must_use]
    pub fn hilbert(mesh: &TetMesh) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for x in &mesh.nodes_mm {
            for k in 0..3 {
                low[k] = low[k].min(x[k]);
                high[k] = high[k].max(x[k]);
            }
        }
        let width = (0..3)
            .map(|k| high[k] - low[k])
            .fold(f64::MIN_POSITIVE, f64::max);
        let most = f64::from((1u32 << HILBERT_BITS) - 1);
        let key = |x: &[f64; 3]| {
            hilbert_key(std::array::from_fn(|k| {
                ((x[k] - low[k]) / width * most) as u32
            }))
        };
        let keys: Vec<u64> = mesh.nodes_mm.iter().map(key).collect();
        let mut order: Vec<u32> = (0..mesh.n_nodes() as u32).collect();
        order.sort_by_key(|node| (keys[*node as usize], *node));
        Self::of_nodes(mesh, order)
    }

    /// Nodes in a given order, and elements by their smallest new node.
    #[must_use]
    pub fn of_nodes(mesh: &TetMesh, nodes: Vec<u32>) -> Self {
        let new = inverse(&nodes);
        let mut tets: Vec<u32> = (0..mesh.n_tets() as u32).collect();
        tets.sort_by_key(|e| {
            let mut corners = mesh.tets[*e as usize].map(|node| new[node as usize]);
            corners.sort_unstable();
            (corners, *e)
        });
        Self { nodes, tets }
    }

    /// A random order, for tests of results that must not depend on it.
    #[must_use]
    pub fn shuffled(mesh: &TetMesh, seed: u64) -> Self {
        let shuffle = |n: usize, seed: u64| {
            let mut order: Vec<u32> = (0..n as u32).collect();
            order.sort_by_key(|i| {
                (seed ^ u64::from(*i))
                    .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                    .rotate_left(29)
            });
            order
        };
        Self {
            nodes: shuffle(mesh.n_nodes(), seed),
            tets: shuffle(mesh.n_tets(), !seed),
        }
    }

    /// The mesh in the new order.
    #[must_use]
    pub fn apply(&self, mesh: &TetMesh) -> TetMesh {
        let new = inverse(&self.nodes);
        let node = |old: u32| new[old as usize];
        TetMesh {
            nodes_mm: self
                .nodes
                .iter()
                .map(|old| mesh.nodes_mm[*old as usize])
                .collect(),
            tets: self
                .tets
                .iter()
                .map(|old| mesh.tets[*old as usize].map(node))
                .collect(),
            tags: self
                .tets
                .iter()
                .map(|old| mesh.tags[*old as usize])
                .collect(),
            frames: if mesh.frames.is_empty() {
                Vec::new()
            } else {
                self.tets
                    .iter()
                    .map(|old| mesh.frames[*old as usize])
                    .collect()
            },
            fibres: mesh.fibres.at(self.nodes.iter().map(|old| *old as usize)),
            surfaces: mesh
                .surfaces
                .iter()
                .map(|surface| Surface {
                    name: surface.name.clone(),
                    triangles: surface
                        .triangles
                        .iter()
                        .map(|triangle| triangle.map(node))
                        .collect(),
                })
                .collect(),
        }
    }
}

/// New number of each old item.
#[must_use]
pub fn inverse(new_to_old: &[u32]) -> Vec<u32> {
    let mut new = vec![0; new_to_old.len()];
    for (place, old) in new_to_old.iter().enumerate() {
        new[*old as usize] = place as u32;
    }
    new
}

/// Largest difference between the numbers of two neighbouring nodes.
#[must_use]
pub fn bandwidth(mesh: &TetMesh) -> usize {
    let spread = |tet: &[u32; 4]| {
        let (low, high) = tet.iter().fold((u32::MAX, 0), |(low, high), node| {
            (low.min(*node), high.max(*node))
        });
        (high - low) as usize
    };
    mesh.tets.iter().map(spread).max().unwrap_or(0)
}

/// A node with approximately the largest distance from another one: from the last level of two
/// breadth-first searches, the node of least degree.
fn far_node(graph: &Adjacency, seed: u32) -> u32 {
    let mut far = seed;
    for _ in 0..2 {
        let mut depth = vec![u32::MAX; graph.n_rows()];
        depth[far as usize] = 0;
        let mut queue = VecDeque::from([far]);
        let mut last = (0, usize::MAX, far);
        while let Some(node) = queue.pop_front() {
            let here = depth[node as usize];
            let degree = graph.row(node as usize).len();
            if here > last.0 || (here == last.0 && degree < last.1) {
                last = (here, degree, node);
            }
            for next in graph.row(node as usize) {
                if depth[*next as usize] == u32::MAX {
                    depth[*next as usize] = here + 1;
                    queue.push_back(*next);
                }
            }
        }
        far = last.2;
    }
    far
}

const HILBERT_BITS: u32 = 20;

/// Position on Hilbert's curve.
///
/// Source: Skilling 2004, "Programming the Hilbert curve", AIP Conf. Proc. 707, 381.
fn hilbert_key(mut x: [u32; 3]) -> u64 {
    let top = 1u32 << (HILBERT_BITS - 1);
    let mut q = top;
    while q > 1 {
        let p = q - 1;
        for i in 0..3 {
            if x[i] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
        q >>= 1;
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    let mut t = 0;
    q = top;
    while q > 1 {
        if x[2] & q != 0 {
            t ^= q - 1;
        }
        q >>= 1;
    }
    x = x.map(|x| x ^ t);
    let mut key = 0;
    for bit in (0..HILBERT_BITS).rev() {
        for part in x {
            key = key << 1 | u64::from(part >> bit & 1);
        }
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_meshes::cube;
    use crate::vec3::distance;

    fn is_permutation(order: &[u32]) -> bool {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        sorted.into_iter().eq(0..order.len() as u32)
    }

    #[test]
    fn orders_are_permutations_that_keep_the_mesh() {
        let mesh = crate::ellipsoid::generate(&crate::EllipsoidSpec::new(
            cardiotwin_units::Ml(120.0),
            cardiotwin_units::Ml(130.0),
            900,
        ))
        .unwrap()
        .mesh;
        for order in [
            Renumbering::reverse_cuthill_mckee(&mesh),
            Renumbering::hilbert(&mesh),
            Renumbering::shuffled(&mesh, 3),
        ] {
            assert!(is_permutation(&order.nodes) && is_permutation(&order.tets));
            let new = order.apply(&mesh);
            assert!((new.tissue_volume(&[1]).0 / mesh.tissue_volume(&[1]).0 - 1.0).abs() < 1e-12);
            for (i, old) in order.tets.iter().enumerate() {
                assert_eq!(new.corners(i), mesh.corners(*old as usize));
            }
            let area = |mesh: &TetMesh| mesh.surface("septum").unwrap().area_mm2(&mesh.nodes_mm);
            assert_eq!(area(&new), area(&mesh));
        }
    }

    #[test]
    fn cuthill_mckee_brings_a_shuffled_block_near_its_least_bandwidth() {
        let mesh = cube(10, 1.0);
        let lost = Renumbering::shuffled(&mesh, 1).apply(&mesh);
        assert!(bandwidth(&lost) > 1000);
        let found = Renumbering::reverse_cuthill_mckee(&lost).apply(&lost);
        assert!(bandwidth(&found) < 300, "{}", bandwidth(&found));
    }

    #[test]
    fn neighbours_on_hilberts_curve_are_neighbours_in_space() {
        let mesh = cube(15, 15.0);
        let order = Renumbering::hilbert(&mesh);
        let step = |pair: &[u32]| {
            distance(
                mesh.nodes_mm[pair[0] as usize],
                mesh.nodes_mm[pair[1] as usize],
            )
        };
        // With 16 nodes per side, each cell of the curve contains one node, so that each step is
        // one cell.
        assert!(
            order
                .nodes
                .windows(2)
                .all(|pair| (step(pair) - 1.0).abs() < 1e-12)
        );
    }
}
