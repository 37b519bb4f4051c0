//! Small meshes for tests.

use crate::tet_mesh::TetMesh;

/// A cube of side `length` with a corner at the origin and `n` cells per side, each divided into
/// six tetrahedra around its diagonal.
pub fn cube(n: usize, length: f64) -> TetMesh {
    block([n; 3], [length; 3])
}

/// A block with a corner at the origin.
pub fn block(n: [usize; 3], lengths: [f64; 3]) -> TetMesh {
    let id = |i: [usize; 3]| (i[0] + (n[0] + 1) * (i[1] + (n[1] + 1) * i[2])) as u32;
    let mut mesh = TetMesh::default();
    for z in 0..=n[2] {
        for y in 0..=n[1] {
            for x in 0..=n[0] {
                let at = [x, y, z];
                mesh.nodes_mm.push(std::array::from_fn(|k| {
                    lengths[k] * at[k] as f64 / n[k] as f64
                }));
            }
        }
    }
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                for (axes, even) in [
                    ([0, 1, 2], true),
                    ([1, 2, 0], true),
                    ([2, 0, 1], true),
                    ([0, 2, 1], false),
                    ([2, 1, 0], false),
                    ([1, 0, 2], false),
                ] {
                    let mut at = [x, y, z];
                    let mut tet = [id(at); 4];
                    for (corner, axis) in axes.into_iter().enumerate() {
                        at[axis] += 1;
                        tet[corner + 1] = id(at);
                    }
                    if !even {
                        tet.swap(2, 3);
                    }
                    mesh.tets.push(tet);
                    mesh.tags.push(1);
                }
            }
        }
    }
    mesh
}
