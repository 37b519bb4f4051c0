//! Uniform refinement: all edges are halved and each tetrahedron becomes eight, without change of
//! the body.

use std::collections::BTreeMap;

use crate::surface::Surface;
use crate::tet_mesh::TetMesh;
use crate::vec3::{add, distance, scale};

/// Divides each tetrahedron at the midpoints of its edges: four tetrahedra at the corners, and the
/// octahedron between them into four around its shortest diagonal (Bey 1995). Triangles of surfaces
/// are divided into four; tags and frames pass to the parts. Nodes keep their numbers, and nodes on
/// edges follow in ascending order of the edges. Facets stay flat, so that volumes and surfaces are
/// those of the coarse mesh.
#[must_use]
pub fn halve_edges(mesh: &TetMesh) -> TetMesh {
    let key = |a: u32, b: u32| (a.min(b), a.max(b));
    let mut edges = BTreeMap::new();
    for [a, b, c, d] in &mesh.tets {
        for (i, j) in [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)] {
            edges.insert(key(*i, *j), 0);
        }
    }
    let mut nodes_mm = mesh.nodes_mm.clone();
    for ((a, b), node) in &mut edges {
        *node = nodes_mm.len() as u32;
        nodes_mm.push(scale(
            add(mesh.nodes_mm[*a as usize], mesh.nodes_mm[*b as usize]),
            0.5,
        ));
    }
    let middle = |a: u32, b: u32| edges.get(&key(a, b)).copied();
    let mut tets = Vec::with_capacity(8 * mesh.n_tets());
    for t in &mesh.tets {
        let m = |i: usize, j: usize| edges[&key(t[i], t[j])];
        let (m01, m02, m03, m12, m13, m23) = (m(0, 1), m(0, 2), m(0, 3), m(1, 2), m(1, 3), m(2, 3));
        tets.extend([
            [t[0], m01, m02, m03],
            [m01, t[1], m12, m13],
            [m02, m12, t[2], m23],
            [m03, m13, m23, t[3]],
        ]);
        // The two ends of the diagonal, and the four other corners in a circle around it.
        let diagonals = [
            (m02, m13, [m01, m12, m23, m03]),
            (m01, m23, [m02, m03, m13, m12]),
            (m03, m12, [m01, m02, m23, m13]),
        ];
        let length =
            |d: &(u32, u32, [u32; 4])| distance(nodes_mm[d.0 as usize], nodes_mm[d.1 as usize]);
        let (p, q, around) = *diagonals
            .iter()
            .min_by(|a, b| length(a).total_cmp(&length(b)))
            .unwrap_or(&diagonals[0]);
        tets.extend((0..4).map(|k| [p, q, around[k], around[(k + 1) % 4]]));
    }
    let refined = |t: &[u32; 3]| {
        let (ab, bc, ca) = (
            middle(t[0], t[1])?,
            middle(t[1], t[2])?,
            middle(t[2], t[0])?,
        );
        Some([[t[0], ab, ca], [ab, t[1], bc], [ca, bc, t[2]], [ab, bc, ca]])
    };
    let surfaces = (mesh.surfaces.iter())
        .map(|s| Surface {
            name: s.name.clone(),
            // A triangle that is not a face of the mesh stays unchanged, so that the checks of
            // surfaces find it.
            triangles: s
                .triangles
                .iter()
                .flat_map(|t| refined(t).map_or(vec![*t], |parts| parts.to_vec()))
                .collect(),
        })
        .collect();
    TetMesh {
        nodes_mm,
        tags: (0..tets.len()).map(|e| mesh.tags[e / 8]).collect(),
        frames: if mesh.frames.is_empty() {
            vec![]
        } else {
            (0..tets.len()).map(|e| mesh.frames[e / 8]).collect()
        },
        fibres: mesh
            .fibres
            .with_middles(edges.keys().map(|(a, b)| [*a, *b])),
        tets,
        surfaces,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::openings;
    use crate::test_meshes::block;

    #[test]
    fn halves_fill_the_body_without_gaps_and_surfaces_stay_closed() {
        let mut coarse = block([2, 1, 1], [3.0, 1.0, 2.0]);
        coarse.tags = (0..coarse.n_tets() as i32).collect();
        coarse.surfaces = vec![Surface {
            name: "all".to_owned(),
            triangles: boundary(&coarse),
        }];
        let fine = halve_edges(&coarse);
        assert_eq!((fine.n_tets(), fine.tags[17]), (8 * coarse.n_tets(), 2));
        for e in 0..coarse.n_tets() {
            for part in 8 * e..8 * e + 8 {
                assert!(
                    (fine.volume_mm3(part) - coarse.volume_mm3(e) / 8.0).abs() < 1e-12,
                    "{part} of {e}"
                );
            }
        }
        let surface = &fine.surfaces[0].triangles;
        assert_eq!(surface.len(), 4 * coarse.surfaces[0].triangles.len());
        assert_eq!(openings(surface), Ok(vec![]));
        let (mut found, mut given) = (boundary(&fine), surface.clone());
        for t in found.iter_mut().chain(&mut given) {
            let first = (0..3).min_by_key(|i| t[*i]).expect("three");
            t.rotate_left(first);
        }
        found.sort_unstable();
        given.sort_unstable();
        assert_eq!(found, given);
    }

    /// Faces that belong to one element only, with outward normals.
    fn boundary(mesh: &TetMesh) -> Vec<[u32; 3]> {
        let mut faces = BTreeMap::new();
        for [a, b, c, d] in &mesh.tets {
            for face in [[*a, *c, *b], [*a, *b, *d], [*b, *c, *d], [*a, *d, *c]] {
                let mut key = face;
                key.sort_unstable();
                faces.entry(key).or_insert_with(Vec::new).push(face);
            }
        }
        faces
            .into_values()
            .filter(|f| f.len() == 1)
            .map(|f| f[0])
            .collect()
    }
}
