//! Surfaces of a repaired mesh: existing ones are fitted to its boundary, others are determined by
//! a plane or a position.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::{Done, Plane, RepairError};
use crate::cavity::Cavity;
use crate::find_surfaces::{FindError, Groups};
use crate::landmarks::Landmarks;
use crate::surface::{Surface, area_vector, boundary, edges, sorted};
use crate::tet_mesh::{TetMesh, surface_names};
use crate::vec3::{Vec3, dot, norm, reject, sub, unit};

/// Name of the temporary surface of faces towards removed tissue.
pub(super) const SIDE_OF_REMOVED: &str = "\u{1}removed";
/// Smallest cosine of the angle between a face's normal and the plane's for the face to belong to
/// the rim.
const RIM_COSINE: f64 = 0.8;

/// Counts of the changes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Fitted {
    pub(super) turned: usize,
    pub(super) dropped: usize,
}

/// Turns triangles outwards. Triangles that are not boundary faces, or that belong to an earlier
/// surface, are dropped.
pub(super) fn fit_to_boundary(mesh: &mut TetMesh) -> Fitted {
    let outward: HashMap<[u32; 3], [u32; 3]> = boundary(mesh)
        .iter()
        .map(|face| (sorted(face.triangle), face.triangle))
        .collect();
    let mut fitted = Fitted::default();
    let mut taken: BTreeSet<[u32; 3]> = BTreeSet::new();
    for surface in &mut mesh.surfaces {
        let ours = surface.name == SIDE_OF_REMOVED;
        surface.triangles.retain_mut(|triangle| {
            let key = sorted(*triangle);
            match outward.get(&key).filter(|_| ours || taken.insert(key)) {
                Some(face) => {
                    if !crate::checks::same_turn(*face, *triangle) {
                        *triangle = *face;
                        fitted.turned += 1;
                    }
                    true
                }
                None => {
                    fitted.dropped += usize::from(!ours);
                    false
                }
            }
        });
    }
    mesh.surfaces
        .retain(|surface| !surface.triangles.is_empty());
    fitted
}

/// Replaces surfaces of the same names and reports the new ones. A septum that is part of a new
/// surface is taken out of it.
pub(super) fn replace(mesh: &mut TetMesh, found: Vec<Surface>, done: &mut Done) {
    let known = [
        surface_names::ENDOCARDIUM,
        surface_names::EPICARDIUM,
        surface_names::RIM,
    ];
    mesh.surfaces.retain(|s| !known.contains(&s.name.as_str()));
    let named: Vec<String> = found
        .iter()
        .map(|s| format!("{} ({})", s.name, s.triangles.len()))
        .collect();
    done.steps.push(format!(
        "surfaces found, with their triangles: {}",
        named.join(", ")
    ));
    let septum: BTreeSet<[u32; 3]> = mesh
        .surface(surface_names::SEPTUM)
        .map(|s| s.triangles.iter().map(|t| sorted(*t)).collect())
        .unwrap_or_default();
    for mut surface in found {
        surface.triangles.retain(|t| !septum.contains(&sorted(*t)));
        mesh.surfaces.push(surface);
    }
}

/// Endocardium, epicardium and rim from the plane of the base: faces in the plane form the rim, and
/// the others form an inner and an outer wall.
pub(super) fn at_plane(mesh: &TetMesh, plane: &Plane) -> Result<Vec<Surface>, FindError> {
    let triangles: Vec<[u32; 3]> = boundary(mesh).iter().map(|face| face.triangle).collect();
    let near = 0.5 * mesh.mean_edge_mm();
    let in_plane = |t: &[u32; 3]| {
        let normal = area_vector(*t, &mesh.nodes_mm);
        let flat = dot(normal, plane.normal) > RIM_COSINE * norm(normal);
        flat && t
            .iter()
            .all(|node| plane.above_mm(mesh.nodes_mm[*node as usize]).abs() < near)
    };
    let (rim, walls): (Vec<[u32; 3]>, Vec<[u32; 3]>) = triangles.into_iter().partition(in_plane);
    let mut groups = Groups::new(walls.len());
    let mut at_edge: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for (i, triangle) in walls.iter().enumerate() {
        for (a, b) in edges(*triangle) {
            if let Some(other) = at_edge.insert((a.min(b), a.max(b)), i) {
                groups.join(other, i);
            }
        }
    }
    let mut patches: BTreeMap<usize, Vec<[u32; 3]>> = BTreeMap::new();
    for (i, triangle) in walls.iter().enumerate() {
        patches.entry(groups.of(i)).or_default().push(*triangle);
    }
    let mut sized = Vec::new();
    for patch in patches.into_values() {
        sized.push((Cavity::behind(&patch)?.volume_mm3(&mesh.nodes_mm), patch));
    }
    let n_patches = sized.len();
    let n_inner = sized.iter().filter(|(volume, _)| *volume > 0.0).count();
    let (Some(inner), Some(outer)) = (
        (0..n_patches)
            .max_by(|i, j| sized[*i].0.total_cmp(&sized[*j].0))
            .filter(|i| sized[*i].0 > 0.0),
        (0..n_patches)
            .min_by(|i, j| sized[*i].0.total_cmp(&sized[*j].0))
            .filter(|i| sized[*i].0 < 0.0),
    ) else {
        return Err(if n_inner == 0 {
            FindError::NoEndocardium { n_patches, n_inner }
        } else {
            FindError::NoEpicardium { n_patches }
        });
    };
    let (mut endocardium, mut epicardium, mut rest) = (Vec::new(), Vec::new(), rim);
    for (i, (_, patch)) in sized.into_iter().enumerate() {
        if i == inner {
            endocardium = patch;
        } else if i == outer {
            epicardium = patch;
        } else {
            rest.extend(patch); // small patches next to the plane
        }
    }
    let named = [
        (surface_names::ENDOCARDIUM, endocardium),
        (surface_names::EPICARDIUM, epicardium),
        (surface_names::RIM, rest),
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

/// Moves triangles from the epicardium to a new septum and returns their number.
fn move_to_septum(mesh: &mut TetMesh, septal: &BTreeSet<[u32; 3]>) -> usize {
    let mut triangles = Vec::new();
    for surface in mesh
        .surfaces
        .iter_mut()
        .filter(|s| s.name == surface_names::EPICARDIUM)
    {
        surface.triangles.retain(|t| {
            let stays = !septal.contains(&sorted(*t));
            if !stays {
                triangles.push(*t);
            }
            stays
        });
    }
    let n = triangles.len();
    if n > 0 {
        mesh.surfaces.push(Surface {
            name: surface_names::SEPTUM.to_owned(),
            triangles,
        });
    }
    n
}

/// Makes the faces towards removed tissue a septum, if they belong to the outer wall. Returns their
/// number.
pub(super) fn name_septum(mesh: &mut TetMesh) -> usize {
    let septal: BTreeSet<[u32; 3]> = mesh
        .surface(SIDE_OF_REMOVED)
        .map(|s| s.triangles.iter().map(|t| sorted(*t)).collect())
        .unwrap_or_default();
    mesh.surfaces.retain(|s| s.name != SIDE_OF_REMOVED);
    if mesh.surface(surface_names::SEPTUM).is_some() {
        0
    } else {
        move_to_septum(mesh, &septal)
    }
}

/// Marks a part of the outer wall as septum: within `degrees`/2 of a point, as an angle around the
/// long axis. Returns the number of triangles.
///
/// # Errors
/// [`RepairError::Septum`] if the mesh has no long axis, or no face lies within the angle.
pub fn mark_septum(mesh: &mut TetMesh, at_mm: Vec3, degrees: f64) -> Result<usize, RepairError> {
    let refuse = |why| RepairError::Septum { at_mm, why };
    let marks =
        Landmarks::of(mesh).ok_or(refuse("a long axis needs endocardium, epicardium and rim"))?;
    let around = |x: Vec3| unit(reject(sub(x, marks.base_mm), marks.axis));
    let towards = around(at_mm).ok_or(refuse("the point lies on the long axis"))?;
    // An earlier septum becomes epicardium again.
    let old = mesh
        .surface(surface_names::SEPTUM)
        .map(|s| s.triangles.clone())
        .unwrap_or_default();
    mesh.surfaces.retain(|s| s.name != surface_names::SEPTUM);
    if let Some(outer) = mesh
        .surfaces
        .iter_mut()
        .find(|s| s.name == surface_names::EPICARDIUM)
    {
        outer.triangles.extend(old);
    }
    let least = (0.5 * degrees).to_radians().cos();
    let middle = |t: &[u32; 3]| -> Vec3 {
        let x = t.map(|node| mesh.nodes_mm[node as usize]);
        std::array::from_fn(|k| (x[0][k] + x[1][k] + x[2][k]) / 3.0)
    };
    // The lowest fifth of the wall is the apex, which no right ventricle covers.
    let apical = marks.apex_height_mm * 0.8;
    let outer = mesh
        .surface(surface_names::EPICARDIUM)
        .map(|s| s.triangles.as_slice())
        .unwrap_or_default();
    let septal: BTreeSet<[u32; 3]> = outer
        .iter()
        .filter(|t| {
            let x = middle(t);
            dot(sub(marks.base_mm, x), marks.axis) < apical
                && around(x).is_some_and(|d| dot(d, towards) > least)
        })
        .map(|t| sorted(*t))
        .collect();
    match move_to_septum(mesh, &septal) {
        0 => Err(refuse("no triangle of the epicardium lies there")),
        n => Ok(n),
    }
}
