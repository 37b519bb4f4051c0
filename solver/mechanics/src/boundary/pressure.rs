//! Pressure that follows a deforming surface, and the volume enclosed by it.

use cardiotwin_linalg::vec3::cross;
use cardiotwin_linalg::{NO_SLOT, Pattern};

use crate::element::shape::{triangle, triangle_rule};
use crate::linear::Assembled;

/// Why a surface cannot carry a load.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// The triangles do not all have three nodes or all have six.
    #[error(
        "a triangle of the surface has {found} nodes, expected 3 (linear) or 6 (quadratic), the same for all"
    )]
    Nodes {
        /// Number of nodes found.
        found: usize,
    },
    /// A triangle is not a face of an element of the body.
    #[error(
        "triangle {triangle} of the surface joins nodes {a} and {b}, which no element of the body shares"
    )]
    NotOfBody {
        /// Index of the triangle.
        triangle: usize,
        /// First node of the edge.
        a: u32,
        /// Second node of the edge.
        b: u32,
    },
}

/// Value and two derivatives of a node's shape function.
type NodeShape = (f64, [f64; 2]);

/// Triangles of three or six nodes, counter-clockwise from outside the body, with their slots in the stiffness.
#[derive(Debug, Clone)]
pub struct Faces {
    /// Number of nodes of a triangle.
    pub n_nodes: usize,
    /// Nodes, ordered by triangle.
    pub nodes: Vec<u32>,
    /// Slots of the node pairs `(a, b)`, ordered by triangle.
    pub slots: Vec<u32>,
    /// Weight of each integration point, and value and derivatives of each node's shape function there.
    pub points: Vec<(f64, Vec<NodeShape>)>,
    /// Number of nodes that this rank owns; later nodes are ghosts.
    n_owned: usize,
}

impl Faces {
    /// Prepares `triangles` for a body whose stiffness has the sparsity `pattern`.
    ///
    /// # Errors
    /// [`SurfaceError`] for a triangle with another number of nodes, or one that is not a face of the body.
    pub fn new<const N: usize>(
        triangles: &[[u32; N]],
        pattern: &Pattern,
    ) -> Result<Self, SurfaceError> {
        if N != 3 && N != 6 {
            return Err(SurfaceError::Nodes { found: N });
        }
        let mut slots = Vec::with_capacity(triangles.len() * N * N);
        for (idx, t) in triangles.iter().enumerate() {
            for &a in t {
                for &b in t {
                    let slot = pattern.slot(a, b);
                    if slot == NO_SLOT && (a as usize) < pattern.n_rows() {
                        return Err(SurfaceError::NotOfBody {
                            triangle: idx,
                            a,
                            b,
                        });
                    }
                    slots.push(slot);
                }
            }
        }
        let points = triangle_rule(if N == 3 { 3 } else { 6 })
            .iter()
            .map(|(l, w)| (*w, triangle(N, l)))
            .collect();
        Ok(Self {
            n_nodes: N,
            nodes: triangles.as_flattened().to_vec(),
            slots,
            points,
            n_owned: pattern.n_rows(),
        })
    }

    /// This rank's share of a triangle in sums over ranks, the fraction of its nodes that are owned.
    pub(crate) fn share(&self, nodes: &[u32]) -> f64 {
        nodes
            .iter()
            .filter(|n| (**n as usize) < self.n_owned)
            .count() as f64
            / nodes.len() as f64
    }

    /// Positions of a triangle's nodes, padded with zeros to six.
    pub(crate) fn positions(
        nodes: &[u32],
        reference: &[f64],
        displacement: &[f64],
    ) -> [[f64; 3]; 6] {
        let mut out = [[0.0; 3]; 6];
        for (x, &n) in out.iter_mut().zip(nodes) {
            let k = 3 * n as usize;
            x.copy_from_slice(&reference[k..k + 3]);
            if let Some(u) = displacement.get(k..k + 3) {
                (0..3).for_each(|i| x[i] += u[i]);
            }
        }
        out
    }

    /// Both tangent vectors at an integration point.
    pub(crate) fn tangents(shape: &[NodeShape], x: &[[f64; 3]]) -> [[f64; 3]; 2] {
        let mut out = [[0.0; 3]; 2];
        for ((_, slope), x) in shape.iter().zip(x) {
            for i in 0..3 {
                out[0][i] += slope[0] * x[i];
                out[1][i] += slope[1] * x[i];
            }
        }
        out
    }
}

/// A surface under pressure.
#[derive(Debug, Clone)]
pub struct PressureSurface {
    faces: Faces,
}

impl PressureSurface {
    /// A surface of triangles with three or six nodes, seen counter-clockwise from outside the body.
    ///
    /// # Errors
    /// [`SurfaceError`] for a triangle with another number of nodes, or one that is not a face of the body.
    pub fn new<const N: usize>(
        triangles: &[[u32; N]],
        pattern: &Pattern,
    ) -> Result<Self, SurfaceError> {
        Ok(Self {
            faces: Faces::new(triangles, pattern)?,
        })
    }

    /// Adds `p ∫ Nₐ n da` \[mN\] for `pressure` \[kPa\] on the deformed surface, the negative force of the pressure.
    pub fn add_forces(
        &self,
        pressure: f64,
        reference: &[f64],
        displacement: &[f64],
        force: &mut [f64],
    ) {
        for nodes in self.faces.nodes.chunks(self.faces.n_nodes) {
            let x = Faces::positions(nodes, reference, displacement);
            for (weight, shape) in &self.faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                let n = cross(e1, e2);
                for (&node, (value, _)) in nodes.iter().zip(shape) {
                    for i in 0..3 {
                        if let Some(f) = force.get_mut(3 * node as usize + i) {
                            *f += 0.5 * weight * pressure * value * n[i];
                        }
                    }
                }
            }
        }
    }

    pub(crate) fn faces(&self) -> &Faces {
        &self.faces
    }

    /// This rank's share of `∫ n da` \[mm²\] over the deformed surface.
    pub(crate) fn resultant(&self, reference: &[f64], displacement: &[f64]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for nodes in self.faces.nodes.chunks(self.faces.n_nodes) {
            let x = Faces::positions(nodes, reference, displacement);
            let share = self.faces.share(nodes);
            for (weight, shape) in &self.faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                let n = cross(e1, e2);
                (0..3).for_each(|i| sum[i] += share * (0.5 * weight * n[i]));
            }
        }
        sum
    }

    /// Adds the derivative of [`Self::add_forces`] with respect to displacement \[mN/mm\].
    pub fn add_tangent(
        &self,
        pressure: f64,
        reference: &[f64],
        displacement: &[f64],
        tangent: &mut dyn Assembled,
    ) {
        self.add_tangent_part(pressure, reference, displacement, tangent, false);
    }

    /// As [`Self::add_tangent`], but the symmetric part alone, which is exact for a closed surface.
    pub fn add_symmetric_tangent(
        &self,
        pressure: f64,
        reference: &[f64],
        displacement: &[f64],
        tangent: &mut dyn Assembled,
    ) {
        self.add_tangent_part(pressure, reference, displacement, tangent, true);
    }

    fn add_tangent_part(
        &self,
        pressure: f64,
        reference: &[f64],
        displacement: &[f64],
        tangent: &mut dyn Assembled,
        symmetric: bool,
    ) {
        let n = self.faces.n_nodes;
        for (nodes, slots) in self
            .faces
            .nodes
            .chunks(n)
            .zip(self.faces.slots.chunks(n * n))
        {
            let x = Faces::positions(nodes, reference, displacement);
            let mut blocks = [[0.0; 9]; 36];
            for (weight, shape) in &self.faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                for (a, (value, _)) in shape.iter().enumerate() {
                    let k = 0.5 * weight * pressure * value;
                    for (b, (_, slope)) in shape.iter().enumerate() {
                        // d(e1 × e2) = Σ_b (N_b,ξ δ_b × e2 − N_b,η δ_b × e1): δ × w as a matrix on δ.
                        let w: [f64; 3] =
                            std::array::from_fn(|i| k * (slope[0] * e2[i] - slope[1] * e1[i]));
                        let block = &mut blocks[a * n + b];
                        let skew = [0.0, w[2], -w[1], -w[2], 0.0, w[0], w[1], -w[0], 0.0];
                        for (to, from) in block.iter_mut().zip(skew) {
                            *to += from;
                        }
                    }
                }
            }
            if symmetric {
                let whole = blocks;
                for a in 0..n {
                    for b in 0..n {
                        let (own, other) = (&whole[a * n + b], &whole[b * n + a]);
                        blocks[a * n + b] =
                            std::array::from_fn(|k| 0.5 * (own[k] + other[3 * (k % 3) + k / 3]));
                    }
                }
            }
            for (slot, block) in slots.iter().zip(&blocks) {
                tangent.add_block(*slot, block);
            }
        }
    }

    /// This rank's share of the volume \[mm³\] between the deformed surface and the point `about`, positive where the surface
    /// faces it: the cavity's volume if `about` lies in the plane of a flat opening.
    #[must_use]
    pub fn volume(&self, about: [f64; 3], reference: &[f64], displacement: &[f64]) -> f64 {
        let mut volume = 0.0;
        for nodes in self.faces.nodes.chunks(self.faces.n_nodes) {
            let x = Faces::positions(nodes, reference, displacement);
            let share = self.faces.share(nodes);
            for (weight, shape) in &self.faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                let n = cross(e1, e2);
                for i in 0..3 {
                    let at: f64 = shape.iter().zip(&x).map(|(s, x)| s.0 * x[i]).sum();
                    volume -= share * (0.5 * weight * (at - about[i]) * n[i] / 3.0);
                }
            }
        }
        volume
    }
}
