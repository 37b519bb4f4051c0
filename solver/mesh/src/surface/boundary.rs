//! The boundary of a mesh: faces that belong to one element only.

use super::sorted;
use crate::tet_mesh::{FACES, TetMesh};

/// A boundary face and its element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoundaryFace {
    /// Corners, ordered so that the normal points outwards.
    pub triangle: [u32; 3],
    /// Index of the only element with this face.
    pub tet: u32,
}

/// Faces that belong to one element only, in the order of elements. Normals point outwards if
/// elements have a positive volume.
#[must_use]
pub fn boundary(mesh: &TetMesh) -> Vec<BoundaryFace> {
    boundary_of(mesh, |_| true)
}

/// Boundary of the elements that `within` accepts.
pub fn boundary_of(mesh: &TetMesh, within: impl Fn(usize) -> bool) -> Vec<BoundaryFace> {
    let mut faces: Vec<([u32; 3], BoundaryFace)> = Vec::with_capacity(4 * mesh.n_tets());
    for (e, tet) in mesh.tets.iter().enumerate().filter(|(e, _)| within(*e)) {
        for face in FACES {
            let triangle = face.map(|i| tet[i]);
            faces.push((
                sorted(triangle),
                BoundaryFace {
                    triangle,
                    tet: e as u32,
                },
            ));
        }
    }
    faces.sort_unstable_by_key(|(key, face)| (*key, face.tet));
    let mut single: Vec<BoundaryFace> = faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|same| same.len() == 1)
        .map(|same| same[0].1)
        .collect();
    single.sort_unstable_by_key(|face| (face.tet, sorted(face.triangle)));
    single
}
