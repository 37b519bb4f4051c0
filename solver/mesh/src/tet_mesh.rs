//! The mesh: nodes, linear tetrahedra, tags, fibre frames and surfaces.

use crate::node_fibres::NodeFibres;
use crate::surface::Surface;
use crate::vec3::{Vec3, cross, dot, scale, sub};
use cardiotwin_units::Ml;

pub use crate::frame::Frame;

/// Tags of generated meshes. Meshes from files have tags of their own.
pub mod tags {
    /// Contracting wall of the left ventricle.
    pub const LEFT_VENTRICLE: i32 = 1;
    /// Passive tissue at the base, such as the aortic root.
    pub const AORTIC_ROOT: i32 = 2;
    /// First tag of passive tissue that does not belong to the left ventricle's base, such as the
    /// right ventricle's wall. It has this meaning only in meshes with
    /// [`super::surface_names::RIGHT_VENTRICLE`].
    pub const BESIDE: i32 = 100_000;
}

/// Names of surfaces that the program uses; a mesh may have other surfaces as well.
pub mod surface_names {
    /// Inner wall of the cavity from apex to rim, including the passive ring. Together with the
    /// opening's cap it is closed.
    pub const ENDOCARDIUM: &str = "endocardium";
    /// Outer wall, except for the part in [`SEPTUM`].
    pub const EPICARDIUM: &str = "epicardium";
    /// Ring-shaped cut at the base or through the aortic root, where the heart is suspended.
    pub const RIM: &str = "rim";
    /// Part of the outer wall that faces the right ventricle, if it is marked.
    pub const SEPTUM: &str = "septum";
    /// Inner wall of the right ventricle's cavity, including the right side of the septum, in a
    /// mesh of both ventricles.
    pub const RIGHT_VENTRICLE: &str = "right-ventricle";
    /// All names that the program uses.
    pub const KNOWN: [&str; 5] = [ENDOCARDIUM, EPICARDIUM, RIM, SEPTUM, RIGHT_VENTRICLE];
}

/// A mesh of linear tetrahedra.
///
/// Nodes are numbered from zero in the order of `nodes_mm`. In a sound mesh ([`crate::checks`]),
/// each element has a positive volume, det(x₁ − x₀, x₂ − x₀, x₃ − x₀) > 0, and the triangles of
/// each surface are faces of elements, ordered so that (x₁ − x₀) × (x₂ − x₀) points out of the
/// tissue.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TetMesh {
    /// Positions of the nodes \[mm\].
    pub nodes_mm: Vec<Vec3>,
    /// Corners of each element.
    pub tets: Vec<[u32; 4]>,
    /// Tag of each element, which identifies its tissue.
    pub tags: Vec<i32>,
    /// Tissue directions of each element, or empty if there are none yet. If there are nodal
    /// directions, these are the directions at the elements' centroids.
    pub frames: Vec<Frame>,
    /// Tissue directions at nodes. If they exist, the mechanics evaluates them at integration
    /// points.
    pub fibres: NodeFibres,
    /// Named parts of the boundary.
    pub surfaces: Vec<Surface>,
}

impl TetMesh {
    /// Number of nodes in the mesh.
    #[must_use]
    pub fn n_nodes(&self) -> usize {
        self.nodes_mm.len()
    }

    /// Number of tetrahedra in the mesh.
    #[must_use]
    pub fn n_tets(&self) -> usize {
        self.tets.len()
    }

    /// Corners of element `e` \[mm\].
    #[must_use]
    pub fn corners(&self, e: usize) -> [Vec3; 4] {
        self.tets[e].map(|node| self.nodes_mm[node as usize])
    }

    /// Signed volume of element `e` \[mm³\].
    #[must_use]
    pub fn volume_mm3(&self, e: usize) -> f64 {
        volume_mm3(self.corners(e))
    }

    /// Centroid of element `e` \[mm\].
    #[must_use]
    pub fn centroid_mm(&self, e: usize) -> Vec3 {
        let [a, b, c, d] = self.corners(e);
        std::array::from_fn(|i| 0.25 * (a[i] + b[i] + c[i] + d[i]))
    }

    /// Volume of the elements with one of `tags`, or of all elements if `tags` is empty.
    #[must_use]
    pub fn tissue_volume(&self, tags: &[i32]) -> Ml {
        let volume: f64 = (0..self.n_tets())
            .filter(|e| tags.is_empty() || tags.contains(&self.tags[*e]))
            .map(|e| self.volume_mm3(e))
            .sum();
        Ml(volume * 1e-3)
    }

    /// The surface with a name.
    #[must_use]
    pub fn surface(&self, name: &str) -> Option<&Surface> {
        self.surfaces.iter().find(|surface| surface.name == name)
    }

    /// The outer wall all around, which is what measures of shape need: [`surface_names::EPICARDIUM`] and
    /// the part of it that is marked as [`surface_names::SEPTUM`]. A triangle of both counts once. It is
    /// empty if the mesh has neither. In a mesh of both ventricles the left ventricle's outer wall has
    /// further parts ([`crate::right_ventricle::left_alone`]).
    #[must_use]
    pub fn outer_wall(&self) -> Surface {
        let mut seen = std::collections::BTreeSet::new();
        let triangles = [surface_names::EPICARDIUM, surface_names::SEPTUM]
            .into_iter()
            .filter_map(|name| self.surface(name))
            .flat_map(|surface| surface.triangles.iter().copied())
            .filter(|triangle| seen.insert(crate::surface::sorted(*triangle)))
            .collect();
        Surface {
            name: surface_names::EPICARDIUM.to_owned(),
            triangles,
        }
    }

    /// Turns all elements if every one of them has a negative volume, as in files with the opposite
    /// convention. Otherwise the mesh is left unchanged for [`crate::checks`] to report. Returns
    /// whether elements were turned.
    pub fn orient_if_all_negative(&mut self) -> bool {
        let all = !self.tets.is_empty() && (0..self.n_tets()).all(|e| self.volume_mm3(e) < 0.0);
        if all {
            for tet in &mut self.tets {
                tet.swap(2, 3);
            }
        }
        all
    }

    /// Mean length of the elements' edges \[mm\]; an edge counts once for each element that has it.
    #[must_use]
    pub fn mean_edge_mm(&self) -> f64 {
        let mut total = 0.0;
        for e in 0..self.n_tets() {
            let x = self.corners(e);
            for [i, j] in EDGES {
                total += crate::vec3::distance(x[i], x[j]);
            }
        }
        total / (6.0 * self.n_tets().max(1) as f64)
    }
}

/// The six edges of a tetrahedron.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The four faces of a positive tetrahedron. Face `i` is opposite corner `i`, and the order of its
/// corners gives an outward normal.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Signed volume of a tetrahedron \[mm³\].
#[must_use]
pub fn volume_mm3(x: [Vec3; 4]) -> f64 {
    dot(sub(x[1], x[0]), cross(sub(x[2], x[0]), sub(x[3], x[0]))) / 6.0
}

/// Gradients of the four linear shape functions \[1/mm\], and the volume \[mm³\]. Gradients are not
/// finite if the volume is zero.
#[must_use]
pub fn shape_gradients(x: [Vec3; 4]) -> ([Vec3; 4], f64) {
    let [a, b, c] = [sub(x[1], x[0]), sub(x[2], x[0]), sub(x[3], x[0])];
    let det = dot(a, cross(b, c));
    let g1 = scale(cross(b, c), 1.0 / det);
    let g2 = scale(cross(c, a), 1.0 / det);
    let g3 = scale(cross(a, b), 1.0 / det);
    let g0 = std::array::from_fn(|i| -(g1[i] + g2[i] + g3[i]));
    ([g0, g1, g2, g3], det / 6.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REFERENCE: [Vec3; 4] = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];

    #[test]
    fn faces_of_a_positive_tetrahedron_point_outward() {
        let centre = [0.25; 3];
        for (i, face) in FACES.iter().enumerate() {
            let [a, b, c] = face.map(|k| REFERENCE[k]);
            let normal = cross(sub(b, a), sub(c, a));
            assert!(dot(normal, sub(a, centre)) > 0.0, "face {i}");
            assert!(!face.contains(&i));
        }
    }

    #[test]
    fn shape_gradients_reproduce_a_linear_field() {
        let x = [
            [0.3, 0.1, 0.2],
            [2.0, 0.4, 0.1],
            [0.2, 1.5, 0.3],
            [0.5, 0.2, 1.9],
        ];
        let slope = [1.5, -0.7, 2.2];
        let (gradients, volume) = shape_gradients(x);
        assert!((volume - volume_mm3(x)).abs() < 1e-14);
        for i in 0..3 {
            let found: f64 = (0..4).map(|k| gradients[k][i] * dot(slope, x[k])).sum();
            assert!((found - slope[i]).abs() < 1e-13);
        }
    }
}
