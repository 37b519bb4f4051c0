//! The mesh itself: nodes, linear tetrahedra, tags, fibre frames, surfaces.

use crate::node_fibres::NodeFibres;
use crate::surface::Surface;
use crate::vec3::{Vec3, cross, dot, scale, sub};
use cardiotwin_units::Ml;

/// Tags that this crate's generator gives; a mesh from a file brings its own.
pub mod tags {
    /// Contracting wall of the left ventricle.
    pub const LEFT_VENTRICLE: i32 = 1;
    /// Passive tissue at the base: aortic root and its like.
    pub const AORTIC_ROOT: i32 = 2;
    /// From here on: passive tissue beside the left ventricle that is no part of its base, as the right ventricle's wall. Looked at
    /// in meshes with [`super::surface_names::RIGHT_VENTRICLE`] alone.
    pub const BESIDE: i32 = 100_000;
}

/// Names of surfaces that the rest of the program knows; a mesh may carry others beside them.
pub mod surface_names {
    /// Inner wall of the cavity, from apex to rim, passive ring included: closed by the opening's cap alone.
    pub const ENDOCARDIUM: &str = "endocardium";
    /// Outer wall, without the part that [`SEPTUM`] holds.
    pub const EPICARDIUM: &str = "epicardium";
    /// The ring-shaped cut at the base, or of the aortic root: where the heart hangs.
    pub const RIM: &str = "rim";
    /// The part of the outer wall that faces the right ventricle, where it is told apart.
    pub const SEPTUM: &str = "septum";
    /// Inner wall of the right ventricle's cavity, the septum's right side included, in a mesh of both ventricles.
    pub const RIGHT_VENTRICLE: &str = "right-ventricle";
    /// All of them.
    pub const KNOWN: [&str; 5] = [ENDOCARDIUM, EPICARDIUM, RIM, SEPTUM, RIGHT_VENTRICLE];
}

/// Directions of an element's tissue: orthonormal, `normal` = fibre × sheet up to sign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// f₀, along the fibre.
    pub fibre: Vec3,
    /// s₀, in the sheet, across the fibre: transmural where the sheet angle is zero.
    pub sheet: Vec3,
    /// n₀, perpendicular to the sheet.
    pub normal: Vec3,
}

/// A mesh of linear tetrahedra.
///
/// Nodes are numbered from zero in the order of `nodes_mm`. Where a mesh is sound ([`crate::checks`]) each element has a
/// positive volume, det(x₁ − x₀, x₂ − x₀, x₃ − x₀) > 0, and each surface's triangles are faces of elements, ordered so
/// that (x₁ − x₀) × (x₂ − x₀) points out of the tissue.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TetMesh {
    /// Positions, mm.
    pub nodes_mm: Vec<Vec3>,
    /// Corners of each element.
    pub tets: Vec<[u32; 4]>,
    /// What each element is of; one per element.
    pub tags: Vec<i32>,
    /// Tissue directions, one per element, or empty where there are none yet. Where there are directions at nodes, those of
    /// the elements' centroids.
    pub frames: Vec<Frame>,
    /// Tissue directions at nodes, which the mechanics takes at integration points where there are some.
    pub fibres: NodeFibres,
    /// Named parts of the boundary.
    pub surfaces: Vec<Surface>,
}

impl TetMesh {
    /// How many nodes.
    #[must_use]
    pub fn n_nodes(&self) -> usize {
        self.nodes_mm.len()
    }

    /// How many elements.
    #[must_use]
    pub fn n_tets(&self) -> usize {
        self.tets.len()
    }

    /// The corners of element `e`, mm.
    #[must_use]
    pub fn corners(&self, e: usize) -> [Vec3; 4] {
        self.tets[e].map(|node| self.nodes_mm[node as usize])
    }

    /// Signed volume of element `e`, mm³.
    #[must_use]
    pub fn volume_mm3(&self, e: usize) -> f64 {
        volume_mm3(self.corners(e))
    }

    /// Centre of gravity of element `e`, mm.
    #[must_use]
    pub fn centroid_mm(&self, e: usize) -> Vec3 {
        let [a, b, c, d] = self.corners(e);
        std::array::from_fn(|i| 0.25 * (a[i] + b[i] + c[i] + d[i]))
    }

    /// Volume of the elements whose tag is among `tags`; of all where `tags` is empty.
    #[must_use]
    pub fn tissue_volume(&self, tags: &[i32]) -> Ml {
        let volume: f64 = (0..self.n_tets())
            .filter(|e| tags.is_empty() || tags.contains(&self.tags[*e]))
            .map(|e| self.volume_mm3(e))
            .sum();
        Ml(volume * 1e-3)
    }

    /// The surface of that name.
    #[must_use]
    pub fn surface(&self, name: &str) -> Option<&Surface> {
        self.surfaces.iter().find(|surface| surface.name == name)
    }

    /// Turns all elements over where every single one has a negative volume: a file of the other convention. Anything
    /// else stays as it is, for [`crate::checks`] to tell. Returns whether it did.
    pub fn orient_if_all_negative(&mut self) -> bool {
        let all = !self.tets.is_empty() && (0..self.n_tets()).all(|e| self.volume_mm3(e) < 0.0);
        if all {
            for tet in &mut self.tets {
                tet.swap(2, 3);
            }
        }
        all
    }

    /// Mean length of the elements' edges, each edge as often as elements share it, mm.
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

/// The four faces of a positive tetrahedron, face `i` opposite of corner `i`, ordered so that normals point outward.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Signed volume of a tetrahedron, mm³.
#[must_use]
pub fn volume_mm3(x: [Vec3; 4]) -> f64 {
    dot(sub(x[1], x[0]), cross(sub(x[2], x[0]), sub(x[3], x[0]))) / 6.0
}

/// Gradients of the four linear shape functions, 1/mm, and the volume, mm³. Not finite where the volume is zero.
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
