//! Transfer of tissue directions between two meshes of the same body, by the nearest element.

use std::collections::HashMap;

use crate::tet_mesh::{Frame, TetMesh};
use crate::vec3::{Vec3, distance};

/// Directions for each element of `to`, from the element of `from` with the nearest centroid; empty
/// if `from` has none.
#[must_use]
pub fn frames(from: &TetMesh, to: &TetMesh) -> Vec<Frame> {
    if from.frames.is_empty() {
        return Vec::new();
    }
    let middles: Vec<Vec3> = (0..from.n_tets()).map(|e| from.centroid_mm(e)).collect();
    let cell_mm = from.mean_edge_mm().max(f64::MIN_POSITIVE);
    let cell = |x: Vec3| x.map(|c| (c / cell_mm).floor() as i64);
    let mut in_cell: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for (e, x) in middles.iter().enumerate() {
        in_cell.entry(cell(*x)).or_default().push(e as u32);
    }
    let nearest = |x: Vec3| {
        let [i, j, k] = cell(x);
        let mut best: Option<(f64, u32)> = None;
        for ring in 0_i64.. {
            for a in -ring..=ring {
                for b in -ring..=ring {
                    for c in -ring..=ring {
                        if a.abs().max(b.abs()).max(c.abs()) != ring {
                            continue;
                        }
                        for e in in_cell.get(&[i + a, j + b, k + c]).into_iter().flatten() {
                            let far = distance(middles[*e as usize], x);
                            if best.is_none_or(|(least, _)| far < least) {
                                best = Some((far, *e));
                            }
                        }
                    }
                }
            }
            // Everything in the next ring of cells is farther away than a whole ring.
            if best.is_some_and(|(least, _)| least <= ring as f64 * cell_mm) {
                break;
            }
        }
        best.map_or(0, |(_, e)| e as usize)
    };
    (0..to.n_tets())
        .map(|e| from.frames[nearest(to.centroid_mm(e))])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refine::halve_edges;
    use crate::test_meshes::block;

    #[test]
    fn directions_follow_the_place() {
        let mut mesh = block([4, 4, 4], [40.0, 40.0, 40.0]);
        let by_side = |x: Vec3| {
            if x[0] < 20.0 {
                [1.0, 0.0, 0.0]
            } else {
                [0.0, 1.0, 0.0]
            }
        };
        let frame = |fibre: Vec3| Frame {
            fibre,
            sheet: [0.0, 0.0, 1.0],
            normal: [0.0; 3],
        };
        mesh.frames = (0..mesh.n_tets())
            .map(|e| frame(by_side(mesh.centroid_mm(e))))
            .collect();
        let fine = halve_edges(&mesh);
        let found = frames(&mesh, &fine);
        assert_eq!(found.len(), fine.n_tets());
        for (e, found) in found.iter().enumerate() {
            let x = fine.centroid_mm(e);
            if (x[0] - 20.0).abs() > 4.0 {
                assert_eq!(found.fibre, by_side(x), "at {x:?}");
            }
        }
    }
}
