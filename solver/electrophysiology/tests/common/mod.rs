//! Blocks of tissue with fibres in one direction.

use cardiotwin_linalg::vec3::{Vec3, any_perpendicular, cross, unit};
use cardiotwin_mesh::TetMesh;
use cardiotwin_mesh::tet_mesh::Frame;

/// A block with a corner at the origin, in cells of six tetrahedra around a diagonal, all with tag
/// 1.
pub fn block(n: [usize; 3], lengths_mm: [f64; 3], fibre: Vec3) -> TetMesh {
    let id = |i: [usize; 3]| (i[0] + (n[0] + 1) * (i[1] + (n[1] + 1) * i[2])) as u32;
    let mut mesh = TetMesh::default();
    for z in 0..=n[2] {
        for y in 0..=n[1] {
            for x in 0..=n[0] {
                let at = [x, y, z];
                mesh.nodes_mm.push(std::array::from_fn(|k| {
                    lengths_mm[k] * at[k] as f64 / n[k] as f64
                }));
            }
        }
    }
    let paths = [
        ([0, 1, 2], false),
        ([1, 2, 0], false),
        ([2, 0, 1], false),
        ([0, 2, 1], true),
        ([2, 1, 0], true),
        ([1, 0, 2], true),
    ];
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                for (axes, odd) in paths {
                    let mut at = [x, y, z];
                    let mut tet = [id(at); 4];
                    for (corner, axis) in axes.into_iter().enumerate() {
                        at[axis] += 1;
                        tet[corner + 1] = id(at);
                    }
                    if odd {
                        tet.swap(2, 3);
                    }
                    mesh.tets.push(tet);
                    mesh.tags.push(1);
                }
            }
        }
    }
    let fibre = unit(fibre).expect("a direction");
    let sheet = any_perpendicular(fibre);
    mesh.frames = vec![
        Frame {
            fibre,
            sheet,
            normal: cross(fibre, sheet)
        };
        mesh.n_tets()
    ];
    mesh
}
