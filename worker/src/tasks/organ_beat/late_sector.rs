//! The sector of late activation: nodes of the ventricle within an angle around the lateral side,
//! opposite the septum.

use cardiotwin_mesh::landmarks::Landmarks;
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names};
use cardiotwin_mesh::vec3::{Vec3, cross, dot, scale, sub};
use cardiotwin_models::effects::LatePart;

use crate::finite_element::FiniteElementError;

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
        let septum = marks
            .towards(mesh, surface_names::SEPTUM)
            .or_else(|| marks.towards(mesh, surface_names::RIGHT_VENTRICLE))?;
        let lateral = scale(septum, -1.0);
        Some(Self {
            lateral,
            around: cross(marks.axis, lateral),
            on_axis: marks.base_mm,
        })
    }

    /// Delay of a node \[ms\]. The late part is a share of the full angle around the axis.
    pub(super) fn delay_ms(&self, late: LatePart, node: &Vec3) -> f64 {
        let from_axis = sub(*node, self.on_axis);
        let angle = dot(from_axis, self.around).atan2(dot(from_axis, self.lateral));
        if angle.abs() / std::f64::consts::PI < late.share {
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
        let expected: Vec<f64> = {
            let sector = LateSector::of(&mesh, true).unwrap();
            mesh.nodes_mm
                .iter()
                .map(|x| sector.delay_ms(LATE, x))
                .collect()
        };
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
        let sector = LateSector::of(&mesh, false).unwrap();
        let pairs = mesh.nodes_mm.iter().zip(&expected);
        let same = pairs
            .filter(|(x, delay)| sector.delay_ms(LATE, x) == **delay)
            .count();
        let late = expected.iter().filter(|delay| **delay > 0.0).count();
        assert!(
            late > 100 && same as f64 > 0.97 * expected.len() as f64,
            "{same} {late}"
        );
    }
}
