//! Checks of surfaces: triangles must form a surface on this mesh's boundary with normals out of
//! the tissue, and the endocardium must be open at the rim.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::places::{at_edge, at_node, at_triangle, middle};
use super::{Defect, Expected, Item, Place, Tangle};
use crate::cavity::Cavity;
use crate::surface::{Surface, boundary, edges, sorted};
use crate::tet_mesh::{TetMesh, surface_names};

pub(super) fn check(mesh: &TetMesh, expected: &Expected, sound: bool, found: &mut Vec<Defect>) {
    let lacks = |name: &&&str| {
        mesh.surface(name)
            .is_none_or(|surface| surface.triangles.is_empty())
    };
    let missing: Vec<String> = expected
        .surfaces
        .iter()
        .filter(lacks)
        .map(|name| (*name).to_owned())
        .collect();
    let no_surface = (!missing.is_empty()).then(|| Defect::NoSurface {
        names: missing,
        found: mesh
            .surfaces
            .iter()
            .map(|surface| surface.name.clone())
            .collect(),
        why_not_found: expected.surfaces_not_found.clone(),
    });
    let outward: HashMap<[u32; 3], [u32; 3]> = boundary(mesh)
        .iter()
        .map(|face| (sorted(face.triangle), face.triangle))
        .collect();
    let known = [
        surface_names::ENDOCARDIUM,
        surface_names::EPICARDIUM,
        surface_names::RIM,
        surface_names::SEPTUM,
    ];
    let mut owner: BTreeMap<[u32; 3], &str> = BTreeMap::new();
    // A file may have further surfaces, which are not checked.
    let whole = |name: &str| known.contains(&name) || expected.surfaces.contains(&name);
    let right = |name: &str| expected.right_ventricle == Some(name);
    let meant = |name: &str| whole(name) || right(name) || expected.sprung.contains(&name);
    for surface in mesh.surfaces.iter().filter(|s| meant(&s.name)) {
        let name = || surface.name.clone();
        let (mut off, mut inward) = (Vec::new(), Vec::new());
        let mut shared: BTreeMap<&str, Vec<Place>> = BTreeMap::new();
        for triangle in &surface.triangles {
            match outward.get(&sorted(*triangle)) {
                None => off.push(at_triangle(mesh, *triangle)),
                Some(face) if !same_turn(*face, *triangle) => {
                    inward.push(at_triangle(mesh, *triangle))
                }
                Some(_) => {}
            }
            // Springs may act on a part of another surface.
            if !(whole(&surface.name) || right(&surface.name)) {
                continue;
            }
            if let Some(first) = owner.insert(sorted(*triangle), &surface.name) {
                shared
                    .entry(first)
                    .or_default()
                    .push(at_triangle(mesh, *triangle));
            }
        }
        let of = surface.triangles.len();
        found.extend(shared.into_iter().map(|(first, places)| {
            let first = first.to_owned();
            match right(&first) || right(&surface.name) {
                true => Defect::RightOverlap {
                    first,
                    second: name(),
                    places,
                },
                false => Defect::TwoSurfaces {
                    first,
                    second: name(),
                    places,
                },
            }
        }));
        if !off.is_empty() {
            found.push(Defect::OffBoundary {
                name: name(),
                of,
                places: off,
            });
        }
        if sound && !inward.is_empty() {
            found.push(Defect::Inward {
                name: name(),
                of,
                places: inward,
            });
        }
        tangles(mesh, surface, right(&surface.name), found);
    }
    // A closed endocardium has no border at which a rim could lie, so that this defect is reported
    // instead.
    let closed = endocardium(mesh, expected, found);
    let of_rim = |names: &Vec<String>| names[..] == [surface_names::RIM.to_owned()];
    found
        .extend(no_surface.filter(|d| {
            !(closed && matches!(d, Defect::NoSurface { names, .. } if of_rim(names)))
        }));
}

/// Finds all edges and nodes at which the triangles do not form a surface.
///
/// - `right`: whether this is the right ventricle's endocardium
fn tangles(mesh: &TetMesh, surface: &Surface, right: bool, found: &mut Vec<Defect>) {
    let mut uses: BTreeMap<[u32; 2], (usize, usize)> = BTreeMap::new();
    for (a, b) in surface.triangles.iter().flat_map(|t| edges(*t)) {
        let count = uses.entry([a.min(b), a.max(b)]).or_default();
        if a < b {
            count.0 += 1;
        } else {
            count.1 += 1;
        }
    }
    let mut ends: BTreeMap<u32, usize> = BTreeMap::new();
    let (mut branched, mut against) = (Vec::new(), Vec::new());
    for (edge, (forward, backward)) in uses {
        match (forward, backward) {
            (1, 1) => {}
            (1, 0) | (0, 1) => edge
                .into_iter()
                .for_each(|node| *ends.entry(node).or_default() += 1),
            (2, 0) | (0, 2) => against.push(at_edge(mesh, edge)),
            _ => branched.push(at_edge(mesh, edge)),
        }
    }
    let whole = branched.is_empty() && against.is_empty();
    // A rim may touch itself where it is one element wide, and so may walls where they meet it. The
    // border of the cavity may not.
    let wall = surface.name == surface_names::ENDOCARDIUM || right;
    let pinched: Vec<Place> = match whole && wall {
        true => ends
            .into_iter()
            .filter(|(_, n)| *n > 2)
            .map(|(node, _)| at_node(mesh, node))
            .collect(),
        false => Vec::new(),
    };
    for (how, places) in [
        (Tangle::Branched, branched),
        (Tangle::Inconsistent, against),
        (Tangle::Pinched, pinched),
    ] {
        if !places.is_empty() {
            found.push(Defect::Tangled {
                name: surface.name.clone(),
                how,
                places,
            });
        }
    }
}

/// Openings of a cavity whose nodes do not all belong to the rim.
pub(super) fn openings_off_rim(mesh: &TetMesh, cavity: &Cavity, rim: &BTreeSet<u32>) -> Vec<Place> {
    let bare = cavity
        .openings
        .iter()
        .enumerate()
        .filter(|(_, o)| !o.iter().all(|node| rim.contains(node)));
    let place = |(k, opening): (usize, &Vec<u32>)| Place {
        item: Item::Opening(opening.len()),
        at_mm: cavity.opening_centre_mm(k, &mesh.nodes_mm),
    };
    bare.map(place).collect()
}

/// Checks openings and volume of the cavity. Returns whether it is closed.
fn endocardium(mesh: &TetMesh, expected: &Expected, found: &mut Vec<Defect>) -> bool {
    let Some(endocardium) = mesh
        .surface(surface_names::ENDOCARDIUM)
        .filter(|s| !s.triangles.is_empty())
    else {
        return false;
    };
    let Ok(cavity) = Cavity::behind(&endocardium.triangles) else {
        return false;
    };
    let volume = cavity.volume(&mesh.nodes_mm);
    if cavity.openings.is_empty() {
        let at_mm = middle(mesh, &endocardium.nodes());
        found.push(Defect::Closed {
            volume,
            places: vec![Place {
                item: Item::Spot,
                at_mm,
            }],
        });
    } else if let Some(rim) = mesh.surface(surface_names::RIM) {
        let rim: BTreeSet<u32> = rim.nodes().into_iter().collect();
        let places = openings_off_rim(mesh, &cavity, &rim);
        if !places.is_empty() {
            found.push(Defect::Hole { places });
        }
    }
    if let Some((measured, tolerance)) = expected.cavity {
        let near = (volume.0 - measured.0).abs() <= tolerance * measured.0;
        if !near {
            found.push(Defect::Cavity {
                found: volume,
                measured,
                tolerance,
            });
        }
    }
    cavity.openings.is_empty()
}

/// Whether two orderings of the same corners have the same orientation.
pub(crate) fn same_turn(a: [u32; 3], b: [u32; 3]) -> bool {
    (0..3).any(|turn| std::array::from_fn(|i| a[(i + turn) % 3]) == b)
}
