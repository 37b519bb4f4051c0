//! Repair of nodes and elements: doubled, unused, inverted and disconnected ones.

use std::collections::{BTreeMap, HashSet};

use crate::checks::{doubled, pieces, used};
use crate::surface::sorted;
use crate::tet_mesh::{FACES, TetMesh};

/// Renumbers the nodes of all elements and triangles. Triangles that collapse are removed.
pub(super) fn renumber(mesh: &mut TetMesh, new: impl Fn(u32) -> u32) {
    for tet in &mut mesh.tets {
        *tet = tet.map(&new);
    }
    for surface in &mut mesh.surfaces {
        for triangle in &mut surface.triangles {
            *triangle = triangle.map(&new);
        }
        surface
            .triangles
            .retain(|[a, b, c]| a != b && b != c && c != a);
    }
}

/// Keeps the elements with `keep`, with their tags and frames.
pub(super) fn keep_elements(mesh: &mut TetMesh, keep: &[bool]) {
    let mut kept = keep.iter();
    mesh.tets.retain(|_| kept.next().copied().unwrap_or(false));
    let mut kept = keep.iter();
    mesh.tags.retain(|_| kept.next().copied().unwrap_or(false));
    if !mesh.frames.is_empty() {
        let mut kept = keep.iter();
        mesh.frames
            .retain(|_| kept.next().copied().unwrap_or(false));
    }
}

/// Merges coincident nodes and returns the number of removed ones.
pub(super) fn merge_doubled(mesh: &mut TetMesh) -> usize {
    let pairs: BTreeMap<u32, u32> = doubled(mesh).into_iter().collect();
    if !pairs.is_empty() {
        renumber(mesh, |node| pairs.get(&node).copied().unwrap_or(node));
    }
    pairs.len()
}

/// Removes elements that have a node twice, and all but one of the elements with the same nodes.
/// Returns their number.
pub(super) fn drop_collapsed(mesh: &mut TetMesh) -> usize {
    let mut seen = HashSet::new();
    let keep: Vec<bool> = mesh
        .tets
        .iter()
        .map(|tet| {
            let mut key = *tet;
            key.sort_unstable();
            key.windows(2).all(|two| two[0] != two[1]) && seen.insert(key)
        })
        .collect();
    keep_elements(mesh, &keep);
    keep.iter().filter(|k| !**k).count()
}

/// Turns all elements with a negative volume and returns their number.
pub(super) fn turn_inverted(mesh: &mut TetMesh) -> usize {
    let turned: Vec<usize> = (0..mesh.n_tets())
        .filter(|e| mesh.volume_mm3(*e) < 0.0)
        .collect();
    for e in &turned {
        mesh.tets[*e].swap(2, 3);
    }
    turned.len()
}

/// Removes pieces that are not connected with the largest one.
pub(super) fn keep_largest(mesh: &mut TetMesh) {
    let mut keep = vec![false; mesh.n_tets()];
    for e in pieces(mesh).first().into_iter().flatten() {
        keep[*e] = true;
    }
    keep_elements(mesh, &keep);
}

/// Removes nodes without elements and the triangles that use them. Returns the number of nodes.
pub(super) fn drop_unused(mesh: &mut TetMesh) -> usize {
    let used = used(mesh);
    let n_before = mesh.n_nodes();
    let mut new = vec![u32::MAX; n_before];
    let mut nodes_mm = Vec::with_capacity(n_before);
    for node in (0..n_before).filter(|node| used[*node]) {
        new[node] = nodes_mm.len() as u32;
        nodes_mm.push(mesh.nodes_mm[node]);
    }
    let n_unused = n_before - nodes_mm.len();
    if n_unused > 0 {
        for surface in &mut mesh.surfaces {
            surface.triangles.retain(|t| {
                t.iter()
                    .all(|node| new.get(*node as usize).is_some_and(|n| *n != u32::MAX))
            });
        }
        mesh.nodes_mm = nodes_mm;
        renumber(mesh, |node| new[node as usize]);
    }
    n_unused
}

/// Faces between elements whose tag satisfies `stays` and elements whose tag satisfies `goes`, with
/// normals out of the former.
pub(super) fn faces_between(
    mesh: &TetMesh,
    stays: &dyn Fn(&i32) -> bool,
    goes: &dyn Fn(&i32) -> bool,
) -> Vec<[u32; 3]> {
    let of = |chosen: &dyn Fn(&i32) -> bool| -> BTreeMap<[u32; 3], [u32; 3]> {
        let elements = mesh
            .tets
            .iter()
            .zip(&mesh.tags)
            .filter(|(_, tag)| chosen(tag));
        let faces = elements.flat_map(|(tet, _)| FACES.map(|face| face.map(|i| tet[i])));
        faces.map(|triangle| (sorted(triangle), triangle)).collect()
    };
    let gone = of(goes);
    of(stays)
        .into_iter()
        .filter(|(key, _)| gone.contains_key(key))
        .map(|(_, triangle)| triangle)
        .collect()
}
