//! Shape quality of elements.

use crate::tet_mesh::{EDGES, TetMesh, volume_mm3};
use crate::vec3::{Vec3, cross, dot, norm, sub};

/// Mean ratio of a tetrahedron, 12 (3 V)^(2/3) / Σ l²: 1 for a regular tetrahedron, 0 for a flat
/// one, negative for an inverted one.
///
/// Source: Liu, Joe 1994, "Relationship between tetrahedron shape measures", BIT 34, 268.
#[must_use]
pub fn mean_ratio(x: [Vec3; 4]) -> f64 {
    let volume = volume_mm3(x);
    let squares: f64 = EDGES
        .iter()
        .map(|[i, j]| dot(sub(x[*j], x[*i]), sub(x[*j], x[*i])))
        .sum();
    if squares == 0.0 {
        return 0.0;
    }
    volume.signum() * 12.0 * (3.0 * volume.abs()).powf(2.0 / 3.0) / squares
}

/// The six dihedral angles \[degrees\].
#[must_use]
pub fn dihedral_angles_deg(x: [Vec3; 4]) -> [f64; 6] {
    EDGES.map(|[i, j]| {
        let mut others = (0..4).filter(|k| *k != i && *k != j);
        let (Some(k), Some(l)) = (others.next(), others.next()) else {
            return f64::NAN;
        };
        let along = sub(x[j], x[i]);
        let a = cross(along, sub(x[k], x[i]));
        let b = cross(along, sub(x[l], x[i]));
        norm(cross(a, b)).atan2(dot(a, b)).to_degrees()
    })
}

/// Shape quality of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Smallest [`mean_ratio`] of an element, 1 for a regular one and 0 for a flat one.
    pub min: f64,
    /// Mean [`mean_ratio`] over elements.
    pub mean: f64,
    /// Share of elements whose mean ratio is below 0.3.
    pub poor_share: f64,
    /// Smallest dihedral angle \[degrees\].
    pub min_dihedral_deg: f64,
    /// Largest dihedral angle \[degrees\], near 180 in a sliver.
    pub max_dihedral_deg: f64,
    /// Length of the shortest edge \[mm\].
    pub min_edge_mm: f64,
    /// Mean length of the edges \[mm\].
    pub mean_edge_mm: f64,
    /// Length of the longest edge \[mm\].
    pub max_edge_mm: f64,
}

/// Mean ratio below which an element counts as poor.
pub const POOR: f64 = 0.3;

impl Quality {
    /// Quality over all elements; not-a-number throughout for a mesh without elements.
    #[must_use]
    pub fn of(mesh: &TetMesh) -> Self {
        let n = mesh.n_tets() as f64;
        let mut q = Self {
            min: f64::INFINITY,
            mean: 0.0,
            poor_share: 0.0,
            min_dihedral_deg: f64::INFINITY,
            max_dihedral_deg: 0.0,
            min_edge_mm: f64::INFINITY,
            mean_edge_mm: mesh.mean_edge_mm(),
            max_edge_mm: 0.0,
        };
        for e in 0..mesh.n_tets() {
            let x = mesh.corners(e);
            let ratio = mean_ratio(x);
            q.min = q.min.min(ratio);
            q.mean += ratio / n;
            q.poor_share += if ratio < POOR { 1.0 / n } else { 0.0 };
            for angle in dihedral_angles_deg(x) {
                q.min_dihedral_deg = q.min_dihedral_deg.min(angle);
                q.max_dihedral_deg = q.max_dihedral_deg.max(angle);
            }
            for [i, j] in EDGES {
                let edge = norm(sub(x[j], x[i]));
                q.min_edge_mm = q.min_edge_mm.min(edge);
                q.max_edge_mm = q.max_edge_mm.max(edge);
            }
        }
        q
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_regular_tetrahedron_scores_one() {
        let x = [
            [1.0, 1.0, 1.0],
            [-1.0, 1.0, -1.0],
            [1.0, -1.0, -1.0],
            [-1.0, -1.0, 1.0],
        ];
        assert!((mean_ratio(x) - 1.0).abs() < 1e-14, "{}", mean_ratio(x));
        for angle in dihedral_angles_deg(x) {
            assert!((angle - (1.0f64 / 3.0).acos().to_degrees()).abs() < 1e-10);
        }
        assert!((mean_ratio([x[0], x[2], x[1], x[3]]) + 1.0).abs() < 1e-14);
    }

    #[test]
    fn a_sliver_scores_near_zero_and_has_a_flat_angle() {
        let x = [
            [0.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [1.0, 0.0, 1e-3],
            [0.0, 1.0, 1e-3],
        ];
        assert!(mean_ratio(x).abs() < 0.05);
        assert!(dihedral_angles_deg(x).iter().any(|angle| *angle > 179.0));
    }
}
