//! Checks whether a mesh is fit for computation. All defects are found at once, each with its
//! places, the expected state and the remedy.

mod defect;
mod expected;
mod fibres;
mod further;
mod limits;
mod places;
mod surfaces;
#[cfg(test)]
mod tests;

pub use defect::{Defect, Item, Place, Severity, Tangle};
pub use expected::Expected;
pub use limits::{DEGENERATE, EXTENT_MM, POOR_WARNING};
pub(crate) use surfaces::same_turn;

use crate::adjacency::Adjacency;
use crate::files::LengthUnit;
use crate::find_surfaces::Groups;
use crate::quality::mean_ratio;
use crate::surface::{boundary, sorted};
use crate::tet_mesh::{FACES, TetMesh};
use crate::vec3::{Vec3, add, norm, scale, sub};
use cardiotwin_units::Ml;
use places::{at_edge, at_element, at_node, at_triangle};
use std::collections::{BTreeMap, HashMap};

/// Nodes count as doubled if their distance is less than this share of the mean edge.
pub(crate) const DOUBLED: f64 = 1e-4;

/// Finds all defects. `unit` is the unit in which the coordinates were read; the advice for a heart
/// of the wrong size mentions it.
#[must_use]
pub fn check(mesh: &TetMesh, unit: LengthUnit, expected: &Expected) -> Vec<Defect> {
    let mut found = readable(mesh);
    if !found.is_empty() {
        return found; // no further check is possible
    }
    shape(mesh, &mut found);
    let sound = found
        .iter()
        .all(|defect| !matches!(defect, Defect::Inverted { .. } | Defect::Degenerate { .. }));
    topology(mesh, &mut found);
    tags(mesh, expected, &mut found);
    size(mesh, unit, &mut found);
    surfaces::check(mesh, expected, sound, &mut found);
    further::check(mesh, expected, &mut found);
    fibres::check(mesh, expected, &mut found);
    found
}

fn readable(mesh: &TetMesh) -> Vec<Defect> {
    if mesh.tets.is_empty() {
        return vec![Defect::Empty];
    }
    let mut found = Vec::new();
    for (what, length) in [("tags", mesh.tags.len()), ("fibres", mesh.frames.len())] {
        if length != mesh.n_tets() && !(what == "fibres" && length == 0) {
            found.push(Defect::Length {
                what,
                found: length,
                expected: mesh.n_tets(),
            });
        }
    }
    let n_nodes = mesh.n_nodes();
    for (element, tet) in mesh.tets.iter().enumerate() {
        if let Some(node) = tet.iter().find(|node| **node as usize >= n_nodes) {
            found.push(Defect::NodeOutOfRange {
                element,
                node: *node,
                n_nodes,
            });
            break;
        }
    }
    let not_finite = |node: &usize| mesh.nodes_mm[*node].iter().any(|c| !c.is_finite());
    let nodes: Vec<u32> = (0..n_nodes)
        .filter(not_finite)
        .map(|node| node as u32)
        .collect();
    if !nodes.is_empty() {
        found.push(Defect::NotFinite { nodes });
    }
    found
}

fn shape(mesh: &TetMesh, found: &mut Vec<Defect>) {
    let (mut inverted, mut flat, mut poor) = (Vec::new(), Vec::new(), Vec::new());
    for e in 0..mesh.n_tets() {
        let ratio = mean_ratio(mesh.corners(e));
        if ratio.abs() < DEGENERATE {
            flat.push((ratio.abs(), e));
        } else if ratio < 0.0 {
            inverted.push((mesh.volume_mm3(e), e));
        } else if ratio < POOR_WARNING {
            poor.push((ratio, e));
        }
    }
    let of = mesh.n_tets();
    let worst_first = |list: &mut Vec<(f64, usize)>| -> Option<(f64, Vec<Place>)> {
        list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Some((
            list.first()?.0,
            list.iter().map(|(_, e)| at_element(mesh, *e)).collect(),
        ))
    };
    if let Some((worst_mm3, places)) = worst_first(&mut inverted) {
        found.push(Defect::Inverted {
            of,
            worst_mm3,
            places,
        });
    }
    if let Some((worst, places)) = worst_first(&mut flat) {
        found.push(Defect::Degenerate { worst, places });
    }
    if let Some((worst, places)) = worst_first(&mut poor) {
        found.push(Defect::Poor { of, worst, places });
    }
}

fn topology(mesh: &TetMesh, found: &mut Vec<Defect>) {
    let mut push = |places: Vec<Place>, defect: fn(Vec<Place>) -> Defect| {
        if !places.is_empty() {
            found.push(defect(places));
        }
    };
    let used = used(mesh);
    let loose = (0..mesh.n_nodes())
        .filter(|node| !used[*node])
        .map(|node| at_node(mesh, node as u32));
    push(loose.collect(), |places| Defect::Unreferenced { places });
    let doubled = doubled(mesh)
        .into_iter()
        .map(|(node, _)| at_node(mesh, node));
    push(doubled.collect(), |places| Defect::Doubled { places });
    let mut faces: Vec<[u32; 3]> = mesh
        .tets
        .iter()
        .flat_map(|tet| FACES.map(|face| sorted(face.map(|i| tet[i]))))
        .collect();
    faces.sort_unstable();
    let overlaps = faces
        .chunk_by(|a, b| a == b)
        .filter(|same| same.len() > 2)
        .map(|same| at_triangle(mesh, same[0]));
    let overlaps: Vec<Place> = overlaps.collect();
    // Overlapping elements make the boundary meaningless.
    let plain = overlaps.is_empty();
    push(overlaps, |places| Defect::Overlap { places });
    if plain {
        let touching = branched_edges(mesh)
            .into_iter()
            .map(|edge| at_edge(mesh, edge));
        push(touching.collect(), |places| Defect::Touching { places });
    }
    let pieces = pieces(mesh);
    if let Some((largest, loose)) = pieces.split_first().filter(|(_, loose)| !loose.is_empty()) {
        let place = |elements: &Vec<usize>| {
            let sum = elements
                .iter()
                .fold([0.0; 3], |sum, e| add(sum, mesh.centroid_mm(*e)));
            Place {
                item: Item::Piece(elements.len()),
                at_mm: scale(sum, 1.0 / elements.len() as f64),
            }
        };
        found.push(Defect::Unconnected {
            largest: largest.len(),
            places: loose.iter().map(place).collect(),
        });
    }
}

/// Whether each node belongs to an element.
pub(crate) fn used(mesh: &TetMesh) -> Vec<bool> {
    let mut used = vec![false; mesh.n_nodes()];
    for node in mesh.tets.iter().flatten() {
        used[*node as usize] = true;
    }
    used
}

/// Elements of each piece of the mesh that is connected by nodes, the largest piece first.
pub(crate) fn pieces(mesh: &TetMesh) -> Vec<Vec<usize>> {
    let mut groups = Groups::new(mesh.n_nodes());
    for tet in &mesh.tets {
        for node in tet {
            groups.join(tet[0] as usize, *node as usize);
        }
    }
    let mut of_group: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (e, tet) in mesh.tets.iter().enumerate() {
        of_group
            .entry(groups.of(tet[0] as usize))
            .or_default()
            .push(e);
    }
    let mut pieces: Vec<Vec<usize>> = of_group.into_values().collect();
    pieces.sort_by_key(|elements| std::cmp::Reverse(elements.len()));
    pieces
}

/// Nodes that coincide with another node, paired with that node; nodes without an element are
/// ignored.
pub(crate) fn doubled(mesh: &TetMesh) -> Vec<(u32, u32)> {
    let cell_mm = (DOUBLED * mesh.mean_edge_mm()).max(f64::MIN_POSITIVE);
    let cell = |x: Vec3| x.map(|c| (c / cell_mm).floor() as i64);
    let used = used(mesh);
    let mut in_cell: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut found = Vec::new();
    for node in (0..mesh.n_nodes() as u32).filter(|node| used[*node as usize]) {
        let x = mesh.nodes_mm[node as usize];
        let [i, j, k] = cell(x);
        let around = (0..27).map(|n| [i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1]);
        let near = around.filter_map(|cell| in_cell.get(&cell)).flatten();
        match near
            .into_iter()
            .find(|other| norm(sub(x, mesh.nodes_mm[**other as usize])) <= cell_mm)
        {
            Some(other) => found.push((node, *other)),
            None => in_cell.entry([i, j, k]).or_default().push(node),
        }
    }
    found
}

/// Edges of the boundary with more than two boundary triangles, ascending.
pub(crate) fn branched_edges(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let faces = boundary(mesh);
    let mut edges: Vec<[u32; 2]> = faces
        .iter()
        .flat_map(|face| crate::surface::edges(face.triangle))
        .map(|(a, b)| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges
        .chunk_by(|a, b| a == b)
        .filter(|same| same.len() > 2)
        .map(|same| same[0])
        .collect()
}

fn tags(mesh: &TetMesh, expected: &Expected, found: &mut Vec<Defect>) {
    let mut there: BTreeMap<i32, usize> = BTreeMap::new();
    for tag in &mesh.tags {
        *there.entry(*tag).or_default() += 1;
    }
    for tag in expected
        .muscle_tags
        .iter()
        .filter(|tag| !there.contains_key(*tag))
    {
        found.push(Defect::NoTag {
            tag: *tag,
            found: there.iter().map(|(tag, n)| (*tag, *n)).collect(),
        });
    }
    if let Some((stated, tolerance)) = expected.wall {
        let muscle: f64 = (0..mesh.n_tets())
            .filter(|e| expected.muscle_tags.contains(&mesh.tags[*e]))
            .map(|e| mesh.volume_mm3(e).abs())
            .sum();
        let wall = Ml(muscle * 1e-3);
        if wall.0 > 0.0 && (wall.0 - stated.0).abs() > tolerance * stated.0 {
            found.push(Defect::Wall {
                found: wall,
                stated,
                tolerance,
            });
        }
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
        // Only human sizes count, so that µm is not taken for the cm of a mouse.
        let in_file = extent_mm * unit.per_mm();
        let likely = LengthUnit::ALL
            .into_iter()
            .find(|other| (50.0..=250.0).contains(&(in_file / other.per_mm())));
        found.push(Defect::Size {
            extent_mm,
            likely: likely.map(LengthUnit::symbol),
        });
    }
}

/// Defects of the activation: sites without contracting tissue near them, or invalid times.
#[must_use]
pub fn activation(
    mesh: &TetMesh,
    muscle_tags: &[i32],
    sites_mm: &[Vec3],
    radius_mm: f64,
) -> Vec<Defect> {
    let around = Adjacency::node_to_tets(mesh.n_nodes(), &mesh.tets);
    let contracts = |node: usize| {
        around
            .row(node)
            .iter()
            .any(|e| muscle_tags.contains(&mesh.tags[*e as usize]))
    };
    let muscle: Vec<u32> = (0..mesh.n_nodes())
        .filter(|node| contracts(*node))
        .map(|node| node as u32)
        .collect();
    let mut found = Vec::new();
    for (site, at_mm) in sites_mm.iter().enumerate() {
        let to = |node: &u32| norm(sub(mesh.nodes_mm[*node as usize], *at_mm));
        let nearest = muscle
            .iter()
            .map(|node| (to(node), *node))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance_mm, node)) =
            nearest.filter(|(distance, _)| *distance > radius_mm.max(mesh.mean_edge_mm()))
        {
            found.push(Defect::Site {
                site,
                distance_mm,
                place: at_node(mesh, node),
            });
        }
    }
    found
}
