//! Quadratic tetrahedra, made from linear ones with a node on every edge.

use std::collections::BTreeMap;

use super::shape::EDGES;

/// A mesh of quadratic tetrahedra. Vertices keep their numbers; mid-edge nodes follow in ascending order of their edges.
#[derive(Debug, Clone, PartialEq)]
pub struct QuadraticMesh {
    /// Coordinates of vertices and mid-edge nodes \[mm\].
    pub nodes: Vec<[f64; 3]>,
    /// Nodes of each element.
    pub tets: Vec<[u32; 10]>,
    /// Number of vertices, which are the first nodes.
    pub n_vertices: usize,
    edges: BTreeMap<(u32, u32), u32>,
}

impl QuadraticMesh {
    /// Adds mid-edge nodes. `place` gives the position \[mm\] of the node between two vertices, or `None` for the edge's
    /// midpoint.
    pub fn new(
        vertices: &[[f64; 3]],
        tets: &[[u32; 4]],
        mut place: impl FnMut(u32, u32) -> Option<[f64; 3]>,
    ) -> Self {
        let mut edges: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        for tet in tets {
            for (i, j) in EDGES {
                edges.insert((tet[i].min(tet[j]), tet[i].max(tet[j])), 0);
            }
        }
        let mut nodes = vertices.to_vec();
        for (&(a, b), idx) in &mut edges {
            *idx = nodes.len() as u32;
            let (p, q) = (vertices[a as usize], vertices[b as usize]);
            nodes.push(place(a, b).unwrap_or_else(|| std::array::from_fn(|k| 0.5 * (p[k] + q[k]))));
        }
        let between = |a: u32, b: u32| edges[&(a.min(b), a.max(b))];
        let tets = tets
            .iter()
            .map(|t| {
                std::array::from_fn(|k| {
                    if k < 4 {
                        t[k]
                    } else {
                        between(t[EDGES[k - 4].0], t[EDGES[k - 4].1])
                    }
                })
            })
            .collect();
        Self {
            nodes,
            tets,
            n_vertices: vertices.len(),
            edges,
        }
    }

    /// The node between two vertices; `None` if they share no edge.
    #[must_use]
    pub fn middle(&self, a: u32, b: u32) -> Option<u32> {
        self.edges.get(&(a.min(b), a.max(b))).copied()
    }

    /// The six nodes of the triangle with these vertices; `None` if one of its edges is not in the mesh.
    #[must_use]
    pub fn triangle(&self, t: [u32; 3]) -> Option<[u32; 6]> {
        let mid = |i: usize, j: usize| self.middle(t[i], t[j]);
        Some([t[0], t[1], t[2], mid(0, 1)?, mid(1, 2)?, mid(2, 0)?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_tetrahedra_share_the_nodes_of_their_face() {
        let vertices = [
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
        ];
        let mesh = QuadraticMesh::new(&vertices, &[[0, 1, 2, 3], [1, 2, 3, 4]], |_, _| None);
        assert_eq!((mesh.nodes.len(), mesh.n_vertices), (5 + 9, 5));
        let shared = mesh.tets[0]
            .iter()
            .filter(|n| mesh.tets[1].contains(n))
            .count();
        assert_eq!(shared, 6);
        let face = mesh.triangle([3, 1, 2]).expect("a face of the mesh");
        assert_eq!(mesh.nodes[face[4] as usize], [0.5, 0.5, 0.0]);
        assert_eq!(mesh.triangle([0, 4, 1]), None);
    }
}
