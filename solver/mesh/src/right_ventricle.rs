//! Meshes of both ventricles: division of the base between them, and the surfaces of the left
//! ventricle alone.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::surface::{Surface, SurfaceDefect, boundary, boundary_of, openings, sorted};
use crate::tet_mesh::{TetMesh, surface_names, tags};
use crate::vec3::{Vec3, add, distance, scale};

/// The rim of both ventricles, divided by the nearest opening.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rims {
    /// Triangles around the openings of the endocardium.
    pub left: Vec<[u32; 3]>,
    /// Triangles around the openings of the right ventricle; empty if its surface is closed.
    pub right: Vec<[u32; 3]>,
}

/// Divides the rim of a mesh with [`surface_names::RIGHT_VENTRICLE`]; `None` for a mesh of the left
/// ventricle alone.
///
/// # Errors
/// [`SurfaceDefect`] if one of the two inner walls does not form a surface.
pub fn rims(mesh: &TetMesh) -> Result<Option<Rims>, SurfaceDefect> {
    let triangles = |name: &str| {
        mesh.surface(name)
            .map(|s| s.triangles.as_slice())
            .unwrap_or_default()
    };
    if mesh.surface(surface_names::RIGHT_VENTRICLE).is_none() {
        return Ok(None);
    }
    let border = |name: &str| -> Result<Vec<Vec3>, SurfaceDefect> {
        let nodes = openings(triangles(name))?.into_iter().flatten();
        Ok(nodes.map(|node| mesh.nodes_mm[node as usize]).collect())
    };
    let (left, right) = (
        border(surface_names::ENDOCARDIUM)?,
        border(surface_names::RIGHT_VENTRICLE)?,
    );
    let mut rims = Rims::default();
    for triangle in triangles(surface_names::RIM) {
        let sum = triangle.iter().fold([0.0; 3], |sum, node| {
            add(sum, mesh.nodes_mm[*node as usize])
        });
        let middle = scale(sum, 1.0 / 3.0);
        let to = |border: &[Vec3]| {
            border
                .iter()
                .map(|x| distance(*x, middle))
                .fold(f64::INFINITY, f64::min)
        };
        let own = if to(&right) < to(&left) {
            &mut rims.right
        } else {
            &mut rims.left
        };
        own.push(*triangle);
    }
    Ok(Some(rims))
}

/// The mesh with the surfaces of the left ventricle alone: its part of the rim, and the outer side
/// of its muscle as epicardium, including the septum's right side and the faces inside the tissue
/// where the right ventricle's wall joins it. Without these the epicardium would have two gaps,
/// and its centre would lie aside. A mesh without a right ventricle, or one that cannot be divided,
/// is returned unchanged.
///
/// - `muscle`: tags of the left ventricle's wall
#[must_use]
pub fn left_alone<'a>(mesh: &'a TetMesh, muscle: &[i32]) -> Cow<'a, TetMesh> {
    let Ok(Some(rims)) = rims(mesh) else {
        return Cow::Borrowed(mesh);
    };
    let owner: BTreeMap<[u32; 3], u32> = boundary(mesh)
        .iter()
        .map(|face| (sorted(face.triangle), face.tet))
        .collect();
    let of_muscle = |triangle: &&[u32; 3]| {
        owner
            .get(&sorted(**triangle))
            .is_some_and(|tet| muscle.contains(&mesh.tags[*tet as usize]))
    };
    let mut left = mesh.clone();
    let right: Vec<[u32; 3]> = (mesh.surface(surface_names::RIGHT_VENTRICLE).into_iter())
        .flat_map(|s| s.triangles.iter().filter(of_muscle))
        .copied()
        .collect();
    let beside = |e: usize| mesh.tags[e] >= tags::BESIDE && !muscle.contains(&mesh.tags[e]);
    let joined: Vec<[u32; 3]> = boundary_of(mesh, |e| !beside(e))
        .into_iter()
        .map(|face| face.triangle)
        .filter(|triangle| !owner.contains_key(&sorted(*triangle)))
        .collect();
    left.surfaces
        .retain(|surface| surface.name != surface_names::RIGHT_VENTRICLE);
    for Surface { name, triangles } in &mut left.surfaces {
        match name.as_str() {
            surface_names::RIM => triangles.clone_from(&rims.left),
            surface_names::EPICARDIUM => {
                *triangles = triangles
                    .iter()
                    .filter(of_muscle)
                    .chain(&right)
                    .chain(&joined)
                    .copied()
                    .collect();
            }
            _ => {}
        }
    }
    Cow::Owned(left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::{LengthUnit, carp};

    /// Ambit's bi-ventricle, with our name of the right endocardium.
    fn both_ventricles() -> TetMesh {
        let stem = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../examples/meshes/ambit_biv/ambit_biv");
        let mut mesh = carp::read(&stem, LengthUnit::Micrometre).unwrap();
        for surface in mesh.surfaces.iter_mut().filter(|s| s.name == "endo_rv") {
            surface.name = surface_names::RIGHT_VENTRICLE.to_owned();
        }
        mesh
    }

    #[test]
    fn a_rim_is_parted_between_its_two_openings() {
        let mesh = both_ventricles();
        let Rims { left, right } = rims(&mesh).unwrap().expect("two");
        assert_eq!(
            left.len() + right.len(),
            mesh.surface(surface_names::RIM).unwrap().triangles.len()
        );
        let nodes = |name: &str| mesh.surface(name).unwrap().nodes();
        // Each part has all triangles at its own opening.
        for (own, inner) in [
            (&left, surface_names::ENDOCARDIUM),
            (&right, surface_names::RIGHT_VENTRICLE),
        ] {
            let inner = nodes(inner);
            let rim = &mesh.surface(surface_names::RIM).unwrap().triangles;
            let at_opening = rim
                .iter()
                .filter(|t| t.iter().filter(|node| inner.contains(node)).count() == 2);
            assert!(
                at_opening.clone().count() > 10 && at_opening.into_iter().all(|t| own.contains(t))
            );
        }
        let alone = TetMesh {
            surfaces: vec![],
            ..mesh
        };
        assert_eq!(rims(&alone), Ok(None));
    }

    #[test]
    fn the_left_ventricle_alone_has_the_right_side_of_the_septum_outside() {
        let mesh = both_ventricles();
        let left = left_alone(&mesh, &[1, 3]);
        let area = |mesh: &TetMesh, name: &str| {
            mesh.surface(name)
                .map_or(0.0, |s| s.area_mm2(&mesh.nodes_mm))
        };
        let outer = area(&left, surface_names::EPICARDIUM);
        assert!(
            outer > 1.1 * area(&mesh, surface_names::ENDOCARDIUM),
            "{outer} mm²"
        );
        assert!(
            outer < area(&mesh, surface_names::EPICARDIUM),
            "without the right free wall: {outer} mm²"
        );
        assert!(left.surface(surface_names::RIGHT_VENTRICLE).is_none());
        let septal = mesh
            .surface(surface_names::RIGHT_VENTRICLE)
            .unwrap()
            .triangles
            .iter();
        let taken = left.surface(surface_names::EPICARDIUM).unwrap();
        assert!(septal.filter(|t| taken.triangles.contains(t)).count() > 100);
        let alone = TetMesh {
            surfaces: vec![],
            ..mesh.clone()
        };
        assert!(matches!(left_alone(&alone, &[1]), Cow::Borrowed(_)));
    }

    /// Number of the outer faces of the muscle and of the septum's right side, without inner ones.
    fn outer_alone(mesh: &TetMesh, muscle: &[i32]) -> usize {
        let named = [surface_names::EPICARDIUM, surface_names::RIGHT_VENTRICLE];
        let outside: std::collections::BTreeSet<[u32; 3]> = named
            .iter()
            .flat_map(|name| &mesh.surface(name).unwrap().triangles)
            .map(|t| sorted(*t))
            .collect();
        boundary(mesh)
            .iter()
            .filter(|face| muscle.contains(&mesh.tags[face.tet as usize]))
            .filter(|face| outside.contains(&sorted(face.triangle)))
            .count()
    }

    #[test]
    fn the_outer_wall_of_the_left_ventricle_is_closed_where_the_right_wall_joins_it() {
        let mut mesh = both_ventricles();
        let muscle = [1, 3];
        let right_of = |tag: i32| tags::BESIDE + tag;
        for tag in &mut mesh.tags {
            if !muscle.contains(tag) {
                *tag = right_of(*tag);
            }
        }
        let left = left_alone(&mesh, &muscle);
        // Around the middle of the height the outer wall's nodes lie all around, with no empty sector
        // of more than a few elements.
        let outer = left.outer_wall();
        let marks = crate::landmarks::Landmarks::of(&left).unwrap();
        let across = crate::vec3::any_perpendicular(marks.axis);
        let other = crate::vec3::cross(marks.axis, across);
        let mut angles: Vec<f64> = outer
            .nodes()
            .into_iter()
            .map(|node| crate::vec3::sub(mesh.nodes_mm[node as usize], marks.base_mm))
            .filter(|x| {
                let height = 1.0 + crate::vec3::dot(*x, marks.axis) / marks.apex_height_mm;
                (0.4..0.6).contains(&height)
            })
            .map(|x| crate::vec3::dot(x, other).atan2(crate::vec3::dot(x, across)))
            .collect();
        angles.sort_by(f64::total_cmp);
        let around = angles[0] + std::f64::consts::TAU - angles[angles.len() - 1];
        let widest = angles
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .fold(around, f64::max);
        assert!(widest.to_degrees() < 20.0, "{}°", widest.to_degrees());
        // Without the faces where the walls join, two sectors are empty.
        assert!(left.outer_wall().triangles.len() > outer_alone(&mesh, &muscle));
    }
}
