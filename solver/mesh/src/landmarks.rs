//! Apex, base and long axis of a ventricle, from its surfaces.

use crate::cavity::Cavity;
use crate::surface::area_vector;
use crate::tet_mesh::{TetMesh, surface_names};
use crate::vec3::{Vec3, add, dot, norm, scale, sub, unit};

/// Landmarks of a ventricle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmarks {
    /// Centre of the largest opening \[mm\].
    pub base_mm: Vec3,
    /// Point of the outer wall farthest below the base \[mm\].
    pub apex_mm: Vec3,
    /// Point of the inner wall farthest below the base \[mm\].
    pub endocardial_apex_mm: Vec3,
    /// Unit vector from apex to base, which is the normal of the opening.
    pub axis: Vec3,
    /// Distance of the apex below the base \[mm\].
    pub apex_height_mm: f64,
}

impl Landmarks {
    /// Landmarks of a mesh with endocardium and epicardium; `None` if the endocardium is closed or
    /// does not form a surface.
    #[must_use]
    pub fn of(mesh: &TetMesh) -> Option<Self> {
        let endocardium = mesh.surface(surface_names::ENDOCARDIUM)?;
        mesh.surface(surface_names::EPICARDIUM)?;
        let cavity = Cavity::behind(&endocardium.triangles).ok()?;
        let largest = (0..cavity.openings.len()).max_by_key(|k| cavity.openings[*k].len())?;
        let base_mm = cavity.opening_centre_mm(largest, &mesh.nodes_mm);
        // Area vectors of a closed surface sum to zero. The sum over the endocardium is therefore
        // the area vector of the opening.
        let sum = endocardium
            .triangles
            .iter()
            .fold([0.0; 3], |sum, t| add(sum, area_vector(*t, &mesh.nodes_mm)));
        let axis = unit(sum)?;
        let below = |x: Vec3| dot(sub(base_mm, x), axis);
        let lowest = |nodes: Vec<u32>| {
            let places = nodes.into_iter().map(|node| mesh.nodes_mm[node as usize]);
            places.max_by(|a, b| below(*a).total_cmp(&below(*b)))
        };
        let (apex_mm, endocardial_apex_mm) = (
            lowest(mesh.outer_wall().nodes())?,
            lowest(endocardium.nodes())?,
        );
        let marks = Self {
            base_mm,
            apex_mm,
            endocardial_apex_mm,
            axis,
            apex_height_mm: below(apex_mm),
        };
        (marks.apex_height_mm > 0.0).then_some(marks)
    }

    /// Mean distance of the opening's border from its centre \[mm\].
    #[must_use]
    pub fn base_radius_mm(&self, mesh: &TetMesh) -> Option<f64> {
        let endocardium = mesh.surface(surface_names::ENDOCARDIUM)?;
        let cavity = Cavity::behind(&endocardium.triangles).ok()?;
        let border = cavity.openings.iter().max_by_key(|nodes| nodes.len())?;
        let sum: f64 = border
            .iter()
            .map(|node| norm(sub(mesh.nodes_mm[*node as usize], self.base_mm)))
            .sum();
        Some(sum / border.len() as f64)
    }

    /// Unit vector perpendicular to the axis, towards the centre of a surface; `None` if the mesh
    /// has no such surface, or if its centre lies on the axis.
    #[must_use]
    pub fn towards(&self, mesh: &TetMesh, surface: &str) -> Option<Vec3> {
        let nodes = mesh.surface(surface)?.nodes();
        let sum = nodes.iter().fold([0.0; 3], |sum, node| {
            add(sum, mesh.nodes_mm[*node as usize])
        });
        let middle = scale(sum, 1.0 / nodes.len().max(1) as f64);
        unit(crate::vec3::reject(sub(middle, self.base_mm), self.axis))
    }

    /// Unit vector perpendicular to the axis, towards the septum: a surface marked as such, or else the
    /// right ventricle. `None` if the mesh has neither.
    #[must_use]
    pub fn towards_septum(&self, mesh: &TetMesh) -> Option<Vec3> {
        self.towards(mesh, surface_names::SEPTUM)
            .or_else(|| self.towards(mesh, surface_names::RIGHT_VENTRICLE))
    }

    /// Two activation sites at the ends of the left bundle's fascicles: on the endocardium, two
    /// thirds of the way from base to apex, on opposite sides. They are an assumption for meshes
    /// without given sites. If the septum is marked, one of the sites lies in it.
    #[must_use]
    pub fn usual_sites_mm(&self, mesh: &TetMesh) -> Vec<Vec3> {
        let Some(endocardium) = mesh.surface(surface_names::ENDOCARDIUM) else {
            return Vec::new();
        };
        let level = add(
            self.base_mm,
            scale(self.axis, -2.0 / 3.0 * self.apex_height_mm),
        );
        let towards = self
            .towards(mesh, surface_names::SEPTUM)
            .unwrap_or_else(|| crate::vec3::any_perpendicular(self.axis));
        let nearest = |goal: Vec3| {
            let places = endocardium
                .nodes()
                .into_iter()
                .map(|node| mesh.nodes_mm[node as usize]);
            places.min_by(|a, b| norm(sub(*a, goal)).total_cmp(&norm(sub(*b, goal))))
        };
        let reach = 0.5 * self.base_radius_mm(mesh).unwrap_or(0.0);
        [1.0, -1.0]
            .into_iter()
            .filter_map(|side| nearest(add(level, scale(towards, side * reach))))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ellipsoid::{EllipsoidSpec, generate};
    use cardiotwin_units::Ml;

    #[test]
    fn an_ellipsoid_has_its_ends_on_its_axis() {
        let mesh = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 2000))
            .unwrap()
            .mesh;
        let marks = Landmarks::of(&mesh).unwrap();
        // The long axis is z, with the base at the top.
        let across = |x: Vec3| x[0].hypot(x[1]);
        assert!(marks.axis[2].abs() > 0.999, "{marks:?}");
        assert!(
            across(marks.base_mm) < 0.5 && across(marks.apex_mm) < 0.5,
            "{marks:?}"
        );
        assert!(
            norm(sub(marks.apex_mm, marks.endocardial_apex_mm)) > 3.0,
            "a wall between them: {marks:?}"
        );
        let sites = marks.usual_sites_mm(&mesh);
        assert_eq!(sites.len(), 2);
        assert!(norm(sub(sites[0], sites[1])) > 10.0, "{sites:?}");
    }
}
