//! Search for endocardium, epicardium and rim on a mesh without surfaces.
//!
//! If tagged tissue closes the valves, the boundary has two parts, and the inner one is the
//! endocardium. If the ventricle is open, the boundary is one part, which is cut at sharp edges:
//! the cut of the base lies between the two walls, and the direction of a wall's normals shows
//! whether it is the inner or the outer one.

use crate::cavity::Cavity;
use crate::surface::{Surface, area_vector, boundary, edges};
use crate::tet_mesh::{TetMesh, surface_names};
use crate::vec3::{dot, norm};
use std::collections::BTreeMap;

/// Angle between the normals of neighbouring triangles above which their edge counts as sharp
/// \[degrees\].
pub const SHARP_DEG: f64 = 50.0;
/// Share of the boundary below which a patch is joined to a neighbour, because a crumpled spot is
/// not a separate surface.
const SMALL: f64 = 0.01;

/// Reasons why surfaces could not be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FindError {
    /// No patch encloses a cavity, or several do.
    #[error(
        "no endocardium found: of {n_patches} patches of the boundary, {n_inner} have their normals towards an enclosed \
         volume, expected exactly 1; give the surfaces as files"
    )]
    NoEndocardium {
        /// Number of patches between sharp edges.
        n_patches: usize,
        /// Number of patches that enclose a cavity.
        n_inner: usize,
    },
    /// No patch is the outer wall.
    #[error(
        "no epicardium found: the boundary has {n_patches} patch(es); give the surfaces as files"
    )]
    NoEpicardium {
        /// Number of patches between sharp edges.
        n_patches: usize,
    },
    /// The boundary does not form a surface.
    #[error("cannot divide the boundary into surfaces: {0}")]
    Boundary(#[from] crate::surface::SurfaceDefect),
}

/// Finds endocardium, epicardium and, for an open ventricle, the rim. Normals point out of the
/// tissue.
///
/// # Errors
/// [`FindError`] if the boundary does not consist of one inner patch, one outer patch and rim
/// patches. For two ventricles, and for bases without sharp edges, surfaces have to be given.
pub fn find_surfaces(mesh: &TetMesh) -> Result<Vec<Surface>, FindError> {
    let triangles: Vec<[u32; 3]> = boundary(mesh).iter().map(|face| face.triangle).collect();
    let patches = patches(mesh, &triangles);
    let mut inner = Vec::new();
    let mut outer: Option<(f64, usize)> = None;
    for (i, patch) in patches.iter().enumerate() {
        let cavity = Cavity::behind(patch)?;
        let area: f64 = patch
            .iter()
            .map(|t| norm(area_vector(*t, &mesh.nodes_mm)))
            .sum();
        // A flat ring encloses no volume; for a sphere, 36 π V² = A³.
        let round = cavity.volume_mm3(&mesh.nodes_mm).signum()
            * (113.1 * cavity.volume_mm3(&mesh.nodes_mm).powi(2) / area.powi(3));
        if round > 0.05 && cavity.openings.len() < 4 {
            inner.push(i);
        } else if round < 0.0 && outer.is_none_or(|(largest, _)| area > largest) {
            outer = Some((area, i));
        }
    }
    let [inner] = inner[..] else {
        return Err(FindError::NoEndocardium {
            n_patches: patches.len(),
            n_inner: inner.len(),
        });
    };
    let Some((_, outer)) = outer else {
        return Err(FindError::NoEpicardium {
            n_patches: patches.len(),
        });
    };
    let mut rim = Vec::new();
    let mut walls = [Vec::new(), Vec::new()];
    for (i, patch) in patches.into_iter().enumerate() {
        if i == inner {
            walls[0] = patch;
        } else if i == outer {
            walls[1] = patch;
        } else {
            rim.extend(patch);
        }
    }
    let [endocardium, epicardium] = walls;
    let named = [
        (surface_names::ENDOCARDIUM, endocardium),
        (surface_names::EPICARDIUM, epicardium),
        (surface_names::RIM, rim),
    ];
    let named = named
        .into_iter()
        .filter(|(_, triangles)| !triangles.is_empty());
    Ok(named
        .map(|(name, triangles)| Surface {
            name: name.to_owned(),
            triangles,
        })
        .collect())
}

/// Patches of the boundary between sharp edges, in the order of their first triangles.
fn patches(mesh: &TetMesh, triangles: &[[u32; 3]]) -> Vec<Vec<[u32; 3]>> {
    let normals: Vec<_> = triangles
        .iter()
        .map(|t| area_vector(*t, &mesh.nodes_mm))
        .collect();
    let areas: Vec<f64> = normals.iter().map(|n| norm(*n)).collect();
    let mut at_edge: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (i, triangle) in triangles.iter().enumerate() {
        for (a, b) in edges(*triangle) {
            at_edge.entry((a.min(b), a.max(b))).or_default().push(i);
        }
    }
    let pairs: Vec<(usize, usize)> = at_edge
        .values()
        .filter(|both| both.len() == 2)
        .map(|both| (both[0], both[1]))
        .collect();
    let joined = |sharp: f64| {
        let mut groups = Groups::new(triangles.len());
        for (i, j) in &pairs {
            if dot(normals[*i], normals[*j]) >= sharp * areas[*i] * areas[*j] {
                groups.join(*i, *j);
            }
        }
        groups
    };
    let mut groups = joined(f64::NEG_INFINITY);
    let whole = (0..triangles.len()).all(|i| groups.of(i) == 0);
    if whole {
        groups = joined(SHARP_DEG.to_radians().cos());
    }
    let total: f64 = areas.iter().sum();
    loop {
        let mut size: BTreeMap<usize, f64> = BTreeMap::new();
        for (i, area) in areas.iter().enumerate() {
            *size.entry(groups.of(i)).or_default() += area;
        }
        let smallest = size
            .iter()
            .min_by(|a, b| a.1.total_cmp(b.1))
            .filter(|_| size.len() > 1);
        let Some((small, _)) = smallest.filter(|(_, area)| **area < SMALL * total) else {
            break;
        };
        // The neighbour with which the patch shares most edges.
        let mut shared: BTreeMap<usize, usize> = BTreeMap::new();
        for (i, j) in &pairs {
            let (i, j) = (groups.of(*i), groups.of(*j));
            if (i == *small) != (j == *small) {
                *shared.entry(if i == *small { j } else { i }).or_default() += 1;
            }
        }
        let Some((neighbour, _)) = shared.iter().max_by_key(|(_, n)| **n) else {
            break;
        };
        groups.join(*small, *neighbour);
    }
    let mut found: BTreeMap<usize, Vec<[u32; 3]>> = BTreeMap::new();
    for (i, triangle) in triangles.iter().enumerate() {
        found.entry(groups.of(i)).or_default().push(*triangle);
    }
    found.into_values().collect()
}

/// Disjoint sets with union; the smallest member of a set represents it.
pub(crate) struct Groups {
    parent: Vec<usize>,
}

impl Groups {
    pub(crate) fn new(n: usize) -> Self {
        Self {
            parent: (0..n).collect(),
        }
    }

    pub(crate) fn of(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }

    pub(crate) fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.of(i), self.of(j));
        let (low, high) = (i.min(j), i.max(j));
        self.parent[high] = low;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ellipsoid::{EllipsoidSpec, generate};
    use crate::surface::sorted;
    use cardiotwin_units::Ml;

    fn set(triangles: &[[u32; 3]]) -> std::collections::BTreeSet<[u32; 3]> {
        triangles.iter().map(|t| sorted(*t)).collect()
    }

    #[test]
    fn surfaces_of_an_ellipsoid_are_found_as_they_were_made() {
        for n_nodes in [700, 2000, 10_000] {
            let spec = EllipsoidSpec {
                septum_deg: 0.0,
                ..EllipsoidSpec::new(Ml(120.0), Ml(130.0), n_nodes)
            };
            let mesh = generate(&spec).unwrap().mesh;
            let found = find_surfaces(&mesh).unwrap();
            assert_eq!(found.len(), 3);
            for surface in found {
                let made = mesh.surface(&surface.name).unwrap();
                assert_eq!(
                    set(&surface.triangles),
                    set(&made.triangles),
                    "{} at {n_nodes} nodes",
                    surface.name
                );
            }
        }
    }

    #[test]
    fn a_closed_ventricle_has_an_inner_and_an_outer_wall_and_no_rim() {
        // A hollow cube: 3 × 3 × 3 cells without the middle one.
        let mut mesh = crate::test_meshes::cube(3, 30.0);
        let inside = |x: [f64; 3]| x.iter().all(|c| (10.0..20.0).contains(c));
        let kept: Vec<_> = (0..mesh.n_tets())
            .filter(|e| !inside(mesh.centroid_mm(*e)))
            .collect();
        mesh.tets = kept.iter().map(|e| mesh.tets[*e]).collect();
        mesh.tags.truncate(kept.len());
        let found = find_surfaces(&mesh).unwrap();
        let names: Vec<_> = found.iter().map(|surface| surface.name.as_str()).collect();
        assert_eq!(
            names,
            [surface_names::ENDOCARDIUM, surface_names::EPICARDIUM]
        );
        assert_eq!(found[0].triangles.len(), 12);
    }

    #[test]
    fn a_solid_block_has_no_endocardium() {
        let error = find_surfaces(&crate::test_meshes::cube(2, 30.0)).unwrap_err();
        assert_eq!(
            error,
            FindError::NoEndocardium {
                n_patches: 6,
                n_inner: 0
            }
        );
    }
}
