//! Repair of a mesh as far as possible without meshing again. Each step is counted and reported.
//!
//! The order of steps matters: nodes and elements come first, then pieces and places where tissue
//! touches itself, then shapes, and last surfaces, which depend on all of these. Tags and frames
//! stay with their elements. A surface's triangles follow their nodes; triangles that are no longer
//! boundary faces are dropped and counted.

mod done;
mod error;
mod nodes;
mod plane;
mod shape;
mod surfaces;
#[cfg(test)]
mod tests;
mod touching;

pub use done::Done;
pub use error::RepairError;
pub use plane::Plane;
pub use surfaces::mark_septum;

use std::collections::BTreeMap;

use crate::checks::pieces;
use crate::find_surfaces::find_surfaces;
use crate::node_fibres::NodeFibres;
use crate::surface::{Surface, openings};
use crate::tet_mesh::{TetMesh, surface_names};
use crate::vec3::{Vec3, scale};

/// Optional steps, besides those that are always carried out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Repair {
    /// Factor of all coordinates.
    pub scale: Option<f64>,
    /// New tags, by the old ones.
    pub map_tags: BTreeMap<i32, i32>,
    /// Tags of the elements to keep; if empty, all are kept.
    pub keep_tags: Vec<i32>,
    /// Tags of the elements to remove, for example valve plugs and papillary muscles.
    pub remove_tags: Vec<i32>,
    /// Plane at which elements are cut; the side to which its normal points is removed.
    pub cut: Option<Plane>,
    /// Plane and tag: tissue on the side to which the normal points becomes passive with this tag.
    pub passive_above: Option<(Plane, i32)>,
    /// Whether to remove pieces that are not connected with the largest one.
    pub keep_largest: bool,
    /// New names of surfaces, by the old ones.
    pub rename: BTreeMap<String, String>,
    /// Whether to search surfaces again although the mesh has some.
    pub find_surfaces: bool,
    /// Plane of the base, in which the rim lies. It determines the rim if there is no sharp edge.
    pub rim_plane: Option<Plane>,
    /// A point near the middle of the septum, and the extent of the septum on the outer wall
    /// \[degrees around the long axis\].
    pub septum: Option<(Vec3, f64)>,
    /// Whether to leave badly shaped elements unchanged.
    pub keep_shapes: bool,
}

/// Repairs a mesh.
///
/// # Errors
/// [`RepairError`] if a requested step is impossible. A surface that cannot be found is no error
/// unless it was requested.
pub fn repair(mesh: &mut TetMesh, wanted: &Repair) -> Result<Done, RepairError> {
    let n_nodes = mesh.n_nodes();
    // Repairs add, remove and move nodes, so that nodal directions are replaced by those at the
    // elements' centroids.
    mesh.fibres = NodeFibres::PerElement;
    for (element, tet) in mesh.tets.iter().enumerate() {
        if let Some(node) = tet.iter().find(|node| **node as usize >= n_nodes) {
            return Err(RepairError::NodeOutOfRange {
                element,
                node: *node,
                n_nodes,
            });
        }
    }
    let mut done = Done::default();
    if let Some(factor) = wanted.scale {
        for x in &mut mesh.nodes_mm {
            *x = scale(*x, factor);
        }
        done.steps.push(format!("all lengths times {factor}"));
    }
    elements(mesh, wanted, &mut done)?;
    let opened = chosen_tags(mesh, wanted, &mut done)?;
    if let Some(plane) = &wanted.cut {
        let n = plane::cut(mesh, plane);
        done.count(
            n,
            "element cut or removed at the plane",
            "elements cut or removed at the plane",
        );
        left(mesh, "after the cut")?;
    }
    if let Some((plane, tag)) = &wanted.passive_above {
        let n = plane::tag_above(mesh, plane, *tag);
        done.count(
            n,
            "element above the plane made passive",
            "elements above the plane made passive",
        );
    }
    if wanted.keep_largest {
        let loose: usize = pieces(mesh).iter().skip(1).map(Vec::len).sum();
        done.count(
            loose,
            "element of loose pieces removed",
            "elements of loose pieces removed",
        );
        nodes::keep_largest(mesh);
    }
    let parted = touching::part(mesh);
    done.count(
        parted.doubled,
        "node parted where tissue touched itself",
        "nodes parted where tissue touched itself",
    );
    done.count(
        parted.removed,
        "element removed where tissue touched itself",
        "elements removed where tissue touched itself",
    );
    if !wanted.keep_shapes {
        let shaped = shape::improve(mesh);
        done.count(
            shaped.collapsed,
            "edge collapsed in flat elements",
            "edges collapsed in flat elements",
        );
        done.count(
            shaped.moved,
            "node moved to better shapes",
            "nodes moved to better shapes",
        );
    }
    done.count(
        nodes::drop_unused(mesh),
        "unused node removed",
        "unused nodes removed",
    );
    name_surfaces(mesh, wanted, opened, &mut done)?;
    Ok(done)
}

/// Merges doubled nodes and elements, and turns inverted elements.
fn elements(mesh: &mut TetMesh, wanted: &Repair, done: &mut Done) -> Result<(), RepairError> {
    done.count(
        nodes::merge_doubled(mesh),
        "doubled node merged",
        "doubled nodes merged",
    );
    done.count(
        nodes::drop_collapsed(mesh),
        "doubled or collapsed element removed",
        "doubled or collapsed elements removed",
    );
    done.count(
        nodes::turn_inverted(mesh),
        "turned element turned back",
        "turned elements turned back",
    );
    left(mesh, "after doubled ones were removed")?;
    let mut mapped = 0;
    for tag in &mut mesh.tags {
        if let Some(new) = wanted.map_tags.get(tag).filter(|new| *new != tag) {
            *tag = *new;
            mapped += 1;
        }
    }
    done.count(mapped, "tag mapped", "tags mapped");
    Ok(())
}

/// Removes elements by their tags. Returns whether this opened a closed cavity, whose rim is then
/// known.
fn chosen_tags(mesh: &mut TetMesh, wanted: &Repair, done: &mut Done) -> Result<bool, RepairError> {
    let kept = |tag: &i32| wanted.keep_tags.is_empty() || wanted.keep_tags.contains(tag);
    let removed = |tag: &i32| wanted.remove_tags.contains(tag);
    if wanted.keep_tags.is_empty() && wanted.remove_tags.is_empty() {
        return Ok(false);
    }
    if !wanted.remove_tags.is_empty()
        && mesh.surface(surface_names::ENDOCARDIUM).is_none()
        && let Ok(found) = find_surfaces(mesh)
    {
        // Inner and outer wall of a closed ventricle are separated before it is opened, so that no
        // sharp edge is needed.
        surfaces::replace(mesh, found, done);
    }
    let closed = mesh
        .surface(surface_names::ENDOCARDIUM)
        .is_some_and(|s| openings(&s.triangles) == Ok(vec![]));
    let stays = |tag: &i32| kept(tag) && !removed(tag);
    let septal = nodes::faces_between(mesh, &stays, &|tag: &i32| !kept(tag));
    let towards_plugs = nodes::faces_between(mesh, &stays, &removed);
    let opened = closed && !towards_plugs.is_empty();
    mesh.surfaces.push(Surface {
        name: surfaces::SIDE_OF_REMOVED.to_owned(),
        triangles: septal,
    });
    // Faces around a plug form the rim. Faces towards papillary muscles in an open cavity belong to
    // the endocardium.
    let joined = if closed {
        surface_names::RIM
    } else {
        surface_names::ENDOCARDIUM
    };
    match mesh.surfaces.iter_mut().find(|s| s.name == joined) {
        Some(surface) => surface.triangles.extend(towards_plugs),
        None if closed => mesh.surfaces.push(Surface {
            name: joined.to_owned(),
            triangles: towards_plugs,
        }),
        None => {}
    }
    let keep: Vec<bool> = mesh.tags.iter().map(stays).collect();
    done.count(
        keep.iter().filter(|k| !**k).count(),
        "element removed by its tag",
        "elements removed by their tags",
    );
    nodes::keep_elements(mesh, &keep);
    left(mesh, "with these tags")?;
    Ok(opened)
}

fn left(mesh: &TetMesh, after: &'static str) -> Result<(), RepairError> {
    if mesh.tets.is_empty() {
        Err(RepairError::Nothing { after })
    } else {
        Ok(())
    }
}

fn name_surfaces(
    mesh: &mut TetMesh,
    wanted: &Repair,
    opened: bool,
    done: &mut Done,
) -> Result<(), RepairError> {
    for (new, old) in &wanted.rename {
        let found = mesh.surfaces.iter().map(|s| s.name.clone()).collect();
        let Some(at) = mesh.surfaces.iter().position(|s| s.name == *old) else {
            return Err(RepairError::NoSurface {
                name: old.clone(),
                found,
            });
        };
        mesh.surfaces.retain(|s| s.name != *new || s.name == *old);
        let at = mesh
            .surfaces
            .iter()
            .position(|s| s.name == *old)
            .unwrap_or(at);
        mesh.surfaces[at].name.clone_from(new);
        done.steps.push(format!("surface {old} named {new}"));
    }
    let fitted = surfaces::fit_to_boundary(mesh);
    done.count(
        fitted.turned,
        "triangle turned outward",
        "triangles turned outward",
    );
    done.count(
        fitted.dropped,
        "triangle that is no boundary face dropped",
        "triangles that are no boundary faces dropped",
    );
    let needed = [
        surface_names::ENDOCARDIUM,
        surface_names::EPICARDIUM,
        surface_names::RIM,
    ];
    let lacks = needed
        .iter()
        .any(|name| mesh.surface(name).is_none_or(|s| s.triangles.is_empty()));
    // Surfaces that lost triangles by a cut or a selection are incomplete, except for one that lost
    // a plug.
    let changed = !opened && (fitted.dropped > 0 || !wanted.keep_tags.is_empty());
    if let Some(plane) = wanted.rim_plane.as_ref().or(wanted.cut.as_ref()) {
        let found = surfaces::at_plane(mesh, plane)?;
        surfaces::replace(mesh, found, done);
    } else if lacks || changed || wanted.find_surfaces {
        match find_surfaces(mesh) {
            Ok(found) => surfaces::replace(mesh, found, done),
            Err(error) if wanted.find_surfaces => return Err(error.into()),
            Err(error) => done.steps.push(format!("no surfaces found: {error}")),
        }
    }
    match wanted.septum {
        Some((at_mm, degrees)) => {
            mesh.surfaces
                .retain(|s| s.name != surfaces::SIDE_OF_REMOVED);
            let n = mark_septum(mesh, at_mm, degrees)?;
            done.count(
                n,
                "triangle of the outer wall named septum",
                "triangles of the outer wall named septum",
            );
        }
        None => {
            let n = surfaces::name_septum(mesh);
            done.count(
                n,
                "triangle towards removed tissue named septum",
                "triangles towards removed tissue named septum",
            );
        }
    }
    Ok(())
}
