//! A truncated ellipsoid as left ventricle, with a passive ring at the base, with given volumes of
//! wall and cavity.
//!
//! The long axis is z. The apex points to −z, the middle of the septum lies at −x, and anterior is
//! +y. Every layer through the wall is a triangulated surface of rings around the axis, with
//! approximately equal edge lengths from a six-fold apex to the rim; layers are connected by wedges
//! of three tetrahedra. The discrete volumes equal the requested ones to round-off, because the two
//! free lengths (endocardial short axis, wall thickness) are computed from the mesh's own volumes.

mod rings;
mod shape;
mod spec;
mod wedges;

pub use shape::Shape;
pub use spec::EllipsoidSpec;

use crate::cavity::Cavity;
use crate::surface::{Surface, boundary, sorted};
use crate::tet_mesh::{TetMesh, surface_names, tags};
use cardiotwin_units::Ml;
use rings::Rings;
use std::collections::BTreeMap;

/// Accepted numbers of nodes.
pub const NODES: std::ops::RangeInclusive<usize> = 500..=2_000_000;

/// Reasons why an ellipsoid cannot be generated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EllipsoidError {
    /// A setting is outside its range.
    #[error("ellipsoid: {key} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting.
        key: &'static str,
        /// Value of the setting.
        found: f64,
        /// Range of the setting.
        expected: &'static str,
    },
    /// No mesh meets the two volumes.
    #[error(
        "ellipsoid: no mesh of {n_nodes} nodes has a cavity of {cavity} and a wall of {wall} \
         (residual {residual:.1e}); use more nodes or a rounder shape"
    )]
    NoSize {
        /// Requested number of nodes.
        n_nodes: usize,
        /// Requested volume of the cavity.
        cavity: Ml,
        /// Requested volume of the wall.
        wall: Ml,
        /// Largest relative error of the two volumes.
        residual: f64,
    },
}

/// A generated ellipsoid with the lengths that give the requested volumes.
#[derive(Debug, Clone, PartialEq)]
pub struct Ellipsoid {
    /// The mesh, without fibre frames.
    pub mesh: TetMesh,
    /// Lengths of the ellipsoid.
    pub shape: Shape,
    /// Number of wedges through the wall; the number of nodes through the wall is one more.
    pub n_layers: usize,
}

/// Generates the mesh. The same specification always gives the same mesh, bit for bit.
///
/// # Errors
/// [`EllipsoidError`] for settings outside their range or volumes that no mesh meets.
pub fn generate(spec: &EllipsoidSpec) -> Result<Ellipsoid, EllipsoidError> {
    check(spec)?;
    let first = Shape::from_volumes(spec);
    let (rings, n_layers) = Rings::for_nodes(&first, spec.n_nodes);
    let tets = wedges::split(&rings, n_layers);
    let topology = Topology {
        spec,
        rings: &rings,
        n_layers,
        tets: &tets,
    };
    let shape = topology.fit(first)?;
    let mut mesh = topology.mesh(&shape);
    mesh.surfaces = topology.surfaces(&mesh);
    Ok(Ellipsoid {
        mesh,
        shape,
        n_layers,
    })
}

fn check(spec: &EllipsoidSpec) -> Result<(), EllipsoidError> {
    let top = spec.base_height + spec.ring_height;
    let rules = [
        (
            "cavity (mL)",
            spec.cavity.0,
            spec.cavity.0 > 0.0 && spec.cavity.0 < 2000.0,
            "a volume in (0, 2000)",
        ),
        (
            "wall (mL)",
            spec.wall.0,
            spec.wall.0 > 0.0 && spec.wall.0 < 2000.0,
            "a volume in (0, 2000)",
        ),
        (
            "n_nodes",
            spec.n_nodes as f64,
            NODES.contains(&spec.n_nodes),
            "a number from 500 to 2,000,000",
        ),
        (
            "long_to_short",
            spec.long_to_short,
            (1.0..=5.0).contains(&spec.long_to_short),
            "a number from 1 to 5",
        ),
        (
            "base_height",
            spec.base_height,
            (-0.5..=0.7).contains(&spec.base_height),
            "a number from -0.5 to 0.7",
        ),
        (
            "ring_height",
            spec.ring_height,
            (0.0..=0.5).contains(&spec.ring_height),
            "a number from 0 to 0.5",
        ),
        ("base_height + ring_height", top, top <= 0.8, "at most 0.8"),
        (
            "apex_wall",
            spec.apex_wall,
            (0.3..=1.5).contains(&spec.apex_wall),
            "a number from 0.3 to 1.5",
        ),
        (
            "septum_deg",
            spec.septum_deg,
            (0.0..=180.0).contains(&spec.septum_deg),
            "an angle from 0 to 180",
        ),
    ];
    for (key, found, sound, expected) in rules {
        if !sound {
            return Err(EllipsoidError::Setting {
                key,
                found,
                expected,
            });
        }
    }
    Ok(())
}

/// Everything except the lengths.
struct Topology<'a> {
    spec: &'a EllipsoidSpec,
    rings: &'a Rings,
    n_layers: usize,
    tets: &'a [wedges::WedgeTet],
}

impl Topology<'_> {
    /// The mesh without its surfaces.
    fn mesh(&self, shape: &Shape) -> TetMesh {
        let mut nodes_mm = Vec::with_capacity(self.rings.columns.len() * (self.n_layers + 1));
        for column in &self.rings.columns {
            for layer in 0..=self.n_layers {
                let depth = layer as f64 / self.n_layers as f64;
                nodes_mm.push(shape.point(depth, column.height, column.angle));
            }
        }
        TetMesh {
            nodes_mm,
            tets: self.tets.iter().map(|tet| tet.corners).collect(),
            tags: self
                .tets
                .iter()
                .map(|tet| {
                    if tet.in_ring {
                        tags::AORTIC_ROOT
                    } else {
                        tags::LEFT_VENTRICLE
                    }
                })
                .collect(),
            ..TetMesh::default()
        }
    }

    /// Endocardial triangles: the innermost layer, with normals into the cavity.
    fn endocardium(&self) -> Vec<[u32; 3]> {
        let step = self.n_layers as u32 + 1;
        // The rings' triangles are counter-clockwise as seen from outside.
        self.rings
            .triangles
            .iter()
            .map(|[a, b, c]| [a * step, c * step, b * step])
            .collect()
    }

    /// Lengths for which the mesh itself has the requested volumes, by Newton's method in short
    /// axis and thickness with a finite-difference derivative.
    fn fit(&self, mut shape: Shape) -> Result<Shape, EllipsoidError> {
        let failed = |residual| EllipsoidError::NoSize {
            n_nodes: self.spec.n_nodes,
            cavity: self.spec.cavity,
            wall: self.spec.wall,
            residual,
        };
        let cavity = Cavity::behind(&self.endocardium()).map_err(|_| failed(f64::NAN))?;
        let volumes = |shape: &Shape| {
            let mesh = self.mesh(shape);
            let wall = mesh.tissue_volume(&[tags::LEFT_VENTRICLE]);
            [
                cavity.volume(&mesh.nodes_mm).0 / self.spec.cavity.0 - 1.0,
                wall.0 / self.spec.wall.0 - 1.0,
            ]
        };
        let mut residual = f64::INFINITY;
        for _ in 0..20 {
            let r = volumes(&shape);
            residual = r[0].abs().max(r[1].abs());
            if residual < 1e-12 {
                return Ok(shape);
            }
            let step = 1e-6;
            let by_axis = volumes(&Shape {
                short_mm: shape.short_mm * (1.0 + step),
                ..shape
            });
            let by_wall = volumes(&Shape {
                wall_mm: shape.wall_mm * (1.0 + step),
                ..shape
            });
            let a = [
                [(by_axis[0] - r[0]) / step, (by_wall[0] - r[0]) / step],
                [(by_axis[1] - r[1]) / step, (by_wall[1] - r[1]) / step],
            ];
            let det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
            let change = [
                (a[0][1] * r[1] - a[1][1] * r[0]) / det,
                (a[1][0] * r[0] - a[0][0] * r[1]) / det,
            ];
            shape.short_mm *= 1.0 + change[0].clamp(-0.3, 0.3);
            shape.wall_mm *= 1.0 + change[1].clamp(-0.3, 0.3);
        }
        if residual < 1e-9 {
            Ok(shape)
        } else {
            Err(failed(residual))
        }
    }

    /// Sorts the boundary faces into surfaces by the layers and rings of their nodes.
    fn surfaces(&self, mesh: &TetMesh) -> Vec<Surface> {
        let step = self.n_layers as u32 + 1;
        let mut parts: BTreeMap<&'static str, Vec<[u32; 3]>> = BTreeMap::new();
        for face in boundary(mesh) {
            let layers = sorted(face.triangle.map(|node| node % step));
            let name = if layers == [0; 3] {
                surface_names::ENDOCARDIUM
            } else if layers == [step - 1; 3] {
                if self.faces_septum(mesh, face.triangle) {
                    surface_names::SEPTUM
                } else {
                    surface_names::EPICARDIUM
                }
            } else {
                surface_names::RIM
            };
            parts.entry(name).or_default().push(face.triangle);
        }
        parts
            .into_iter()
            .map(|(name, triangles)| Surface {
                name: name.to_owned(),
                triangles,
            })
            .collect()
    }

    /// Whether an epicardial triangle belongs to the septum: it lies in the septum's sector,
    /// between a fifth of the wall's height and the wall's top.
    fn faces_septum(&self, mesh: &TetMesh, triangle: [u32; 3]) -> bool {
        let step = self.n_layers as u32 + 1;
        let corners = triangle.map(|node| mesh.nodes_mm[node as usize]);
        let [x, y]: [f64; 2] =
            std::array::from_fn(|i| corners.iter().map(|corner| corner[i]).sum::<f64>() / 3.0);
        let off = y.atan2(-x).to_degrees().abs();
        let heights = triangle.map(|node| self.rings.columns[(node / step) as usize].height);
        off <= 0.5 * self.spec.septum_deg
            && self.spec.septum_deg > 0.0
            && heights.iter().all(|height| (0.2..=1.0).contains(height))
    }
}

#[cfg(test)]
mod tests;
