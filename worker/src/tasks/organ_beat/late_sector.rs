//! The sector of late activation: nodes of the ventricle within an angle around the lateral side,
//! opposite the septum.

use cardiotwin_mesh::landmarks::Landmarks;
use cardiotwin_mesh::tet_mesh::TetMesh;
use cardiotwin_mesh::vec3::{Vec3, cross, dot, scale, sub};
use cardiotwin_models::effects::LatePart;

use crate::finite_element::FiniteElementError;

/// Distance from the long axis below which a node lies on it, well above rounding \[mm\].
const ON_AXIS_MM: f64 = 1e-6;

/// Coordinates around the long axis.
pub(super) struct LateSector {
    /// Lateral direction, and the direction perpendicular to it around the axis.
    lateral: Vec3,
    around: Vec3,
    /// A point of the axis.
    on_axis: Vec3,
}

impl LateSector {
    /// - `is_generated`: whether the mesh is the program's ellipsoid, whose axis is z and whose
    ///   septum lies at −x
    ///
    /// # Errors
    /// [`FiniteElementError::OwnMesh`] for a patient's mesh without a marked septum.
    pub(super) fn of(mesh: &TetMesh, is_generated: bool) -> Result<Self, FiniteElementError> {
        if is_generated {
            return Ok(Self {
                lateral: [1.0, 0.0, 0.0],
                around: [0.0, 1.0, 0.0],
                on_axis: [0.0; 3],
            });
        }
        Self::of_anatomy(mesh).ok_or_else(|| {
            let found = "dyssynchrony delays the side opposite the septum, and the mesh marks no septum; expected a \
                         surface `septum` or a right ventricle: `cardiotwin mesh repair --septum x,y,z` marks it";
            FiniteElementError::OwnMesh {
                found: found.to_owned(),
            }
        })
    }

    fn of_anatomy(mesh: &TetMesh) -> Option<Self> {
        let marks = Landmarks::of(mesh)?;
        let lateral = scale(marks.towards_septum(mesh)?, -1.0);
        Some(Self {
            lateral,
            around: cross(marks.axis, lateral),
            on_axis: marks.base_mm,
        })
    }

    /// Delay of a node \[ms\]. The late part is a share of the full angle around the axis.
    pub(super) fn delay_ms(&self, late: LatePart, node: &Vec3) -> f64 {
        let from_axis = sub(*node, self.on_axis);
        let (across, out) = (dot(from_axis, self.around), dot(from_axis, self.lateral));
        // A node on the axis, as at the apex, has no side; rounding would choose one.
        let has_side = across.hypot(out) > ON_AXIS_MM;
        let angle = across.atan2(out);
        if has_side && angle.abs() / std::f64::consts::PI < late.share {
            late.delay_ms
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
    use cardiotwin_mesh::tet_mesh::surface_names;
    use cardiotwin_units::Ml;

    const LATE: LatePart = LatePart {
        delay_ms: 60.0,
        share: 0.25,
    };

    #[test]
    fn the_late_part_is_a_sector_opposite_the_septum() {
        let sector = LateSector::of(&TetMesh::default(), true).unwrap();
        let n = 3600;
        let delayed = (0..n).filter(|k| {
            let angle = std::f64::consts::TAU * (f64::from(*k) + 0.5) / f64::from(n);
            sector.delay_ms(LATE, &[angle.cos(), angle.sin(), 1.0]) > 0.0
        });
        assert_eq!(delayed.count(), 900);
        let at = |x: f64| sector.delay_ms(LATE, &[x, 0.0, 0.0]);
        assert_eq!((at(30.0), at(-30.0)), (60.0, 0.0));
    }

    #[test]
    fn a_patients_mesh_turned_in_space_has_the_same_late_part_and_needs_a_septum() {
        let spec = EllipsoidSpec::new(Ml(120.0), Ml(150.0), 500);
        let mut mesh = generate(&spec).unwrap().mesh;
        let delays = |mesh: &TetMesh, is_generated: bool| -> Vec<f64> {
            let sector = LateSector::of(mesh, is_generated).unwrap();
            let delay = |node| sector.delay_ms(LATE, node);
            mesh.nodes_mm.iter().map(delay).collect()
        };
        let (of_file, of_anatomy) = (delays(&mesh, true), delays(&mesh, false));
        let mut unmarked = mesh.clone();
        unmarked
            .surfaces
            .retain(|s| s.name != surface_names::SEPTUM);
        let refused = LateSector::of(&unmarked, false).err().unwrap().to_string();
        assert!(refused.contains("marks no septum"), "{refused}");
        let (sine, cosine) = 0.7_f64.sin_cos();
        for node in &mut mesh.nodes_mm {
            let [x, y, z] = *node;
            let [x, y] = [cosine * x - sine * y, sine * x + cosine * y];
            *node = [z + 40.0, x - 10.0, y];
        }
        // The same nodes are late wherever the mesh lies.
        assert_eq!(delays(&mesh, false), of_anatomy);
        assert_ne!(delays(&mesh, true), of_anatomy);
        // Of a mesh in the generator's position nearly the same: its landmarks are means over surfaces of finite elements.
        let same = of_file.iter().zip(&of_anatomy).filter(|(a, b)| a == b);
        let late = of_anatomy.iter().filter(|delay| **delay > 0.0).count();
        assert!(late > 100 && same.count() as f64 > 0.97 * of_file.len() as f64);
    }
}
