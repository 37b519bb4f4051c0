//! Whether a mesh can be computed with: every defect at once, each with where, what and what to do.

use crate::cavity::Cavity;
use crate::files::LengthUnit;
use crate::find_surfaces::Groups;
use crate::quality::mean_ratio;
use crate::surface::{SurfaceDefect, boundary, openings, sorted};
use crate::tet_mesh::{FACES, TetMesh, surface_names};
use crate::vec3::{norm, sub};
use cardiotwin_units::Ml;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Mean ratio below which an element is degenerate.
pub const DEGENERATE: f64 = 0.02;
/// Largest extent of a left ventricle, mm: from a mouse's to a dilated human one with its aortic root.
pub const EXTENT_MM: std::ops::RangeInclusive<f64> = 3.0..=400.0;
/// How far a fibre's length may be from one.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What a mesh is to be checked against.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Expected<'a> {
    /// Tags of contracting tissue; each has to occur.
    pub muscle_tags: &'a [i32],
    /// Whether contracting elements need directions.
    pub fibres: bool,
    /// Surfaces that have to be there.
    pub surfaces: &'a [&'a str],
    /// Measured volume of the cavity and the relative difference that is accepted.
    pub cavity: Option<(Ml, f64)>,
}

/// Something that is wrong with a mesh. Elements and nodes are numbered from zero.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the message of each variant says what its values are")]
pub enum Defect {
    #[error("the mesh has no elements, expected tetrahedra")]
    Empty,
    #[error("{what} has {found} entries, expected {expected}, one for each element")]
    Length { what: &'static str, found: usize, expected: usize },
    #[error("element {element} names node {node}, but the mesh has {n_nodes} nodes")]
    NodeOutOfRange { element: usize, node: u32, n_nodes: usize },
    #[error("node {node} lies at {at:?} mm, expected finite numbers")]
    NotFinite { node: usize, at: [f64; 3] },
    #[error(
        "{n} of {of} elements are inverted, the first is element {element} with {volume_mm3:.3e} mm³; expected positive \
         volumes: repair the mesh or the order of its corners"
    )]
    Inverted { n: usize, of: usize, element: usize, volume_mm3: f64 },
    #[error(
        "{n} elements are degenerate, the worst is element {element} at ({}) mm with a mean ratio of {ratio:.1e}; \
         expected at least {DEGENERATE}: mesh again or smooth there",
        at_mm(at)
    )]
    Degenerate { n: usize, element: usize, ratio: f64, at: [f64; 3] },
    #[error("{n} nodes belong to no element, the first is node {node}; expected none: remove them")]
    Unreferenced { n: usize, node: usize },
    #[error("the face of nodes {nodes:?} belongs to {n_tets} elements, expected 1 or 2: elements overlap")]
    Overlap { nodes: [u32; 3], n_tets: usize },
    #[error("the mesh falls into {n_parts} unconnected parts, expected one: merge doubled nodes or remove loose parts")]
    Unconnected { n_parts: usize },
    #[error("no element has the tag {tag}; tags there are {found:?}: correct the tag map")]
    NoTag { tag: i32, found: Vec<i32> },
    #[error(
        "the mesh is {extent_mm:.3e} mm across, expected {:.0} to {:.0} mm for a left ventricle{}", EXTENT_MM.start(),
        EXTENT_MM.end(), unit_hint(*likely)
    )]
    Size { extent_mm: f64, likely: Option<&'static str> },
    #[error("there is no surface {name}; surfaces there are {found:?}: name it in the tag map, or let it be found")]
    NoSurface { name: String, found: Vec<String> },
    #[error("surface {name}: {defect}")]
    Surface { name: String, defect: SurfaceDefect },
    #[error(
        "surface {name}: {n} triangles are no boundary faces of the mesh, the first is {triangle:?}; expected faces of \
         one element each: extract the surface from this mesh again"
    )]
    OffBoundary { name: String, n: usize, triangle: [u32; 3] },
    #[error(
        "surface {name}: {n} of {of} triangles have their normals into the tissue, the first is {triangle:?}; expected \
         all out of it: turn them over"
    )]
    Inward { name: String, n: usize, of: usize, triangle: [u32; 3] },
    #[error("the triangle {triangle:?} belongs to the surfaces {first} and {second}, expected one")]
    TwoSurfaces { first: String, second: String, triangle: [u32; 3] },
    #[error(
        "the endocardium has a hole of {n_nodes} nodes around ({}) mm that the rim does not border: triangles are missing \
         there",
        at_mm(at)
    )]
    Hole { n_nodes: usize, at: [f64; 3] },
    #[error("the cavity is {found:.1}, expected {measured:.1} within {:.0} %: check unit, state and rim of the mesh", tolerance * 100.0)]
    Cavity { found: Ml, measured: Ml, tolerance: f64 },
    #[error("the mesh has no fibres, expected one for each contracting element: give a file or a rule")]
    NoFibres,
    #[error(
        "{n} contracting elements have no unit fibre, the first is element {element} with a length of {length}; expected 1"
    )]
    FibreLength { n: usize, element: usize, length: f64 },
}

fn at_mm(at: &[f64; 3]) -> String {
    format!("{:.2}, {:.2}, {:.2}", at[0], at[1], at[2])
}

fn unit_hint(likely: Option<&'static str>) -> String {
    likely
        .map_or(String::new(), |unit| format!(": its coordinates look like {unit}; set the mesh's unit to \"{unit}\""))
}

/// All defects, in the order of the list above. `unit` is what the coordinates were read as: it enters the advice where
/// the heart is too large or too small.
#[must_use]
pub fn check(mesh: &TetMesh, unit: LengthUnit, expected: &Expected) -> Vec<Defect> {
    let mut found = shape(mesh);
    if found.iter().any(|d| {
        matches!(d, Defect::Empty | Defect::Length { .. } | Defect::NodeOutOfRange { .. } | Defect::NotFinite { .. })
    }) {
        return found; // nothing else can be asked
    }
    let sound = found.is_empty();
    topology(mesh, &mut found);
    for tag in expected.muscle_tags {
        if !mesh.tags.contains(tag) {
            let tags: BTreeSet<i32> = mesh.tags.iter().copied().collect();
            found.push(Defect::NoTag { tag: *tag, found: tags.into_iter().collect() });
        }
    }
    size(mesh, unit, &mut found);
    surfaces(mesh, expected, sound, &mut found);
    fibres(mesh, expected, &mut found);
    found
}

fn shape(mesh: &TetMesh) -> Vec<Defect> {
    if mesh.tets.is_empty() {
        return vec![Defect::Empty];
    }
    let mut found = Vec::new();
    for (what, length) in [("tags", mesh.tags.len()), ("fibres", mesh.frames.len())] {
        if length != mesh.n_tets() && !(what == "fibres" && length == 0) {
            found.push(Defect::Length { what, found: length, expected: mesh.n_tets() });
        }
    }
    let n_nodes = mesh.n_nodes();
    for (element, tet) in mesh.tets.iter().enumerate() {
        if let Some(node) = tet.iter().find(|node| **node as usize >= n_nodes) {
            found.push(Defect::NodeOutOfRange { element, node: *node, n_nodes });
            return found;
        }
    }
    if let Some(node) = mesh.nodes_mm.iter().position(|x| x.iter().any(|c| !c.is_finite())) {
        found.push(Defect::NotFinite { node, at: mesh.nodes_mm[node] });
        return found;
    }
    let inverted: Vec<usize> = (0..mesh.n_tets()).filter(|e| mesh.volume_mm3(*e) < 0.0).collect();
    if let Some(element) = inverted.first().copied() {
        let volume_mm3 = mesh.volume_mm3(element);
        found.push(Defect::Inverted { n: inverted.len(), of: mesh.n_tets(), element, volume_mm3 });
    }
    let flat: Vec<(usize, f64)> = (0..mesh.n_tets())
        .map(|e| (e, mean_ratio(mesh.corners(e)).abs()))
        .filter(|(_, ratio)| *ratio < DEGENERATE)
        .collect();
    if let Some((element, ratio)) = flat.iter().min_by(|a, b| a.1.total_cmp(&b.1)).copied() {
        found.push(Defect::Degenerate { n: flat.len(), element, ratio, at: mesh.centroid_mm(element) });
    }
    found
}

fn topology(mesh: &TetMesh, found: &mut Vec<Defect>) {
    let mut used = vec![false; mesh.n_nodes()];
    let mut parts = Groups::new(mesh.n_nodes());
    for tet in &mesh.tets {
        for node in tet {
            used[*node as usize] = true;
            parts.join(tet[0] as usize, *node as usize);
        }
    }
    let loose: Vec<usize> = (0..mesh.n_nodes()).filter(|node| !used[*node]).collect();
    if let Some(node) = loose.first() {
        found.push(Defect::Unreferenced { n: loose.len(), node: *node });
    }
    let mut faces: Vec<[u32; 3]> =
        mesh.tets.iter().flat_map(|tet| FACES.map(|face| sorted(face.map(|i| tet[i])))).collect();
    faces.sort_unstable();
    if let Some(same) = faces.chunk_by(|a, b| a == b).find(|same| same.len() > 2) {
        found.push(Defect::Overlap { nodes: same[0], n_tets: same.len() });
    }
    let n_parts = (0..mesh.n_nodes()).filter(|node| used[*node] && parts.of(*node) == *node).count();
    if n_parts > 1 {
        found.push(Defect::Unconnected { n_parts });
    }
}

fn size(mesh: &TetMesh, unit: LengthUnit, found: &mut Vec<Defect>) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for x in &mesh.nodes_mm {
        for k in 0..3 {
            low[k] = low[k].min(x[k]);
            high[k] = high[k].max(x[k]);
        }
    }
    let extent_mm = norm(sub(high, low));
    if !EXTENT_MM.contains(&extent_mm) {
        // in human hearts' size, so that µm is not taken for the cm of a mouse
        let in_file = extent_mm * unit.per_mm();
        let likely = LengthUnit::ALL.into_iter().find(|other| (50.0..=250.0).contains(&(in_file / other.per_mm())));
        found.push(Defect::Size { extent_mm, likely: likely.map(LengthUnit::symbol) });
    }
}

fn surfaces(mesh: &TetMesh, expected: &Expected, sound: bool, found: &mut Vec<Defect>) {
    for name in expected.surfaces {
        if mesh.surface(name).is_none_or(|surface| surface.triangles.is_empty()) {
            let names = mesh.surfaces.iter().map(|surface| surface.name.clone()).collect();
            found.push(Defect::NoSurface { name: (*name).to_owned(), found: names });
        }
    }
    let outward: HashMap<[u32; 3], [u32; 3]> =
        boundary(mesh).iter().map(|face| (sorted(face.triangle), face.triangle)).collect();
    let mut owner: BTreeMap<[u32; 3], &str> = BTreeMap::new();
    for surface in &mesh.surfaces {
        let name = || surface.name.clone();
        let (mut off, mut inward) = (Vec::new(), Vec::new());
        for triangle in &surface.triangles {
            match outward.get(&sorted(*triangle)) {
                None => off.push(*triangle),
                Some(face) if !same_turn(*face, *triangle) => inward.push(*triangle),
                Some(_) => {}
            }
            if let Some(first) = owner.insert(sorted(*triangle), &surface.name) {
                found.push(Defect::TwoSurfaces { first: first.to_owned(), second: name(), triangle: *triangle });
                return;
            }
        }
        if let Some(triangle) = off.first() {
            found.push(Defect::OffBoundary { name: name(), n: off.len(), triangle: *triangle });
        }
        if let Some(triangle) = inward.first().filter(|_| sound) {
            let (n, of) = (inward.len(), surface.triangles.len());
            found.push(Defect::Inward { name: name(), n, of, triangle: *triangle });
        }
        // a rim may touch itself where it is one element wide; walls may not
        if let Err(defect) = openings(&surface.triangles)
            && (!matches!(defect, SurfaceDefect::Pinched { .. }) || surface.name == surface_names::ENDOCARDIUM)
        {
            found.push(Defect::Surface { name: name(), defect });
        }
    }
    endocardium(mesh, expected, found);
}

fn endocardium(mesh: &TetMesh, expected: &Expected, found: &mut Vec<Defect>) {
    let Some(endocardium) = mesh.surface(surface_names::ENDOCARDIUM) else { return };
    let Ok(cavity) = Cavity::behind(&endocardium.triangles) else { return };
    if let Some(rim) = mesh.surface(surface_names::RIM) {
        let rim: BTreeSet<u32> = rim.nodes().into_iter().collect();
        for (k, opening) in cavity.openings.iter().enumerate() {
            if !opening.iter().all(|node| rim.contains(node)) {
                let at = cavity.opening_centre_mm(k, &mesh.nodes_mm);
                found.push(Defect::Hole { n_nodes: opening.len(), at });
            }
        }
    }
    if let Some((measured, tolerance)) = expected.cavity {
        let volume = cavity.volume(&mesh.nodes_mm);
        let near = (volume.0 - measured.0).abs() <= tolerance * measured.0;
        if !near {
            found.push(Defect::Cavity { found: volume, measured, tolerance });
        }
    }
}

fn fibres(mesh: &TetMesh, expected: &Expected, found: &mut Vec<Defect>) {
    if !expected.fibres {
        return;
    }
    if mesh.frames.is_empty() {
        found.push(Defect::NoFibres);
        return;
    }
    let wrong: Vec<(usize, f64)> = (0..mesh.n_tets())
        .filter(|e| expected.muscle_tags.is_empty() || expected.muscle_tags.contains(&mesh.tags[*e]))
        .map(|e| (e, norm(mesh.frames[e].fibre)))
        .filter(|(_, length)| length.is_nan() || (length - 1.0).abs() > UNIT_TOLERANCE)
        .collect();
    if let Some((element, length)) = wrong.first() {
        found.push(Defect::FibreLength { n: wrong.len(), element: *element, length: *length });
    }
}

/// Whether two orderings of the same corners turn the same way.
fn same_turn(a: [u32; 3], b: [u32; 3]) -> bool {
    (0..3).any(|turn| std::array::from_fn(|i| a[(i + turn) % 3]) == b)
}

#[cfg(test)]
mod tests;
