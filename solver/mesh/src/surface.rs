//! Surfaces of triangles: the boundary of a mesh, its parts, and their edges.

mod boundary;

pub use boundary::{BoundaryFace, boundary, boundary_of};

use crate::vec3::{Vec3, cross, norm, scale, sub};
use std::collections::BTreeMap;

/// A named part of the boundary.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// One of [`crate::tet_mesh::surface_names`], or a name from the file.
    pub name: String,
    /// Corners, ordered so that the normal points out of the tissue (for an endocardium: into the
    /// cavity).
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Nodes of the surface, ascending, each once.
    #[must_use]
    pub fn nodes(&self) -> Vec<u32> {
        let mut nodes: Vec<u32> = self.triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Area of the surface \[mm²\].
    #[must_use]
    pub fn area_mm2(&self, nodes_mm: &[Vec3]) -> f64 {
        self.triangles
            .iter()
            .map(|t| norm(area_vector(*t, nodes_mm)))
            .sum()
    }
}

/// Half the cross product of two edges, which is the area \[mm²\] times the unit normal.
#[must_use]
pub fn area_vector(triangle: [u32; 3], nodes_mm: &[Vec3]) -> Vec3 {
    let [a, b, c] = triangle.map(|node| nodes_mm[node as usize]);
    scale(cross(sub(b, a), sub(c, a)), 0.5)
}

/// Corners of a triangle in ascending order, which identify it whatever its orientation.
#[must_use]
pub fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Directed edges of a triangle.
#[must_use]
pub fn edges([a, b, c]: [u32; 3]) -> [(u32, u32); 3] {
    [(a, b), (b, c), (c, a)]
}

/// Reasons why a patch of triangles does not form a surface.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SurfaceDefect {
    /// Three or more triangles share an edge.
    #[error(
        "the edge between nodes {a} and {b} belongs to {n_triangles} triangles, but at most 2 can meet in a surface"
    )]
    Branched {
        /// First node of the edge.
        a: u32,
        /// Second node of the edge.
        b: u32,
        /// Number of triangles at the edge.
        n_triangles: usize,
    },
    /// The normals of two neighbours point to different sides.
    #[error("the two triangles at the edge between nodes {a} and {b} have opposite orientations")]
    Inconsistent {
        /// First node of the edge.
        a: u32,
        /// Second node of the edge.
        b: u32,
    },
    /// The rim of an opening touches itself.
    #[error("the rim of the surface's opening passes node {node} more than once")]
    Pinched {
        /// Node that the rim passes more than once.
        node: u32,
    },
}

/// Openings of a patch of triangles, as closed loops of nodes in the direction of the triangles'
/// own edges. Each loop begins with its smallest node, and the loops are in the order of these
/// nodes. A closed surface has none.
///
/// # Errors
/// [`SurfaceDefect`] if the patch does not form an oriented surface.
pub fn openings(triangles: &[[u32; 3]]) -> Result<Vec<Vec<u32>>, SurfaceDefect> {
    let mut uses: BTreeMap<(u32, u32), (usize, usize)> = BTreeMap::new();
    for (a, b) in triangles.iter().flat_map(|t| edges(*t)) {
        let count = uses.entry((a.min(b), a.max(b))).or_default();
        if a < b {
            count.0 += 1;
        } else {
            count.1 += 1;
        }
    }
    let mut next: BTreeMap<u32, u32> = BTreeMap::new();
    for ((a, b), (forward, backward)) in uses {
        match (forward, backward) {
            (1, 1) => {}
            (1, 0) | (0, 1) => {
                let (from, to) = if forward == 1 { (a, b) } else { (b, a) };
                if next.insert(from, to).is_some() {
                    return Err(SurfaceDefect::Pinched { node: from });
                }
            }
            (2, 0) | (0, 2) => return Err(SurfaceDefect::Inconsistent { a, b }),
            _ => {
                return Err(SurfaceDefect::Branched {
                    a,
                    b,
                    n_triangles: forward + backward,
                });
            }
        }
    }
    let mut loops = Vec::new();
    while let Some((start, mut at)) = next.pop_first() {
        let mut nodes = vec![start];
        while at != start {
            nodes.push(at);
            at = next
                .remove(&at)
                .ok_or(SurfaceDefect::Pinched { node: at })?;
        }
        loops.push(nodes);
    }
    Ok(loops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tet_mesh::TetMesh;

    #[test]
    fn a_tetrahedron_is_closed_and_without_a_face_open() {
        let mesh = TetMesh {
            nodes_mm: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            tets: vec![[0, 1, 2, 3]],
            tags: vec![1],
            ..TetMesh::default()
        };
        let mut triangles: Vec<_> = boundary(&mesh).iter().map(|face| face.triangle).collect();
        assert_eq!(openings(&triangles), Ok(vec![]));
        let gone = triangles.remove(0);
        let opening = openings(&triangles).unwrap();
        assert_eq!(opening.len(), 1);
        assert_eq!(opening[0].len(), 3);
        assert!(gone.iter().all(|node| opening[0].contains(node)));
        triangles.push([gone[0], gone[2], gone[1]]);
        assert!(matches!(
            openings(&triangles),
            Err(SurfaceDefect::Inconsistent { .. })
        ));
    }

    #[test]
    fn an_edge_of_three_triangles_is_refused() {
        let found = openings(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        assert_eq!(
            found,
            Err(SurfaceDefect::Branched {
                a: 0,
                b: 1,
                n_triangles: 3
            })
        );
    }

    #[test]
    fn two_triangles_that_touch_in_a_point_are_pinched() {
        assert_eq!(
            openings(&[[0, 1, 2], [0, 3, 4]]),
            Err(SurfaceDefect::Pinched { node: 0 })
        );
    }
}
