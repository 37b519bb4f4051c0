//! A patient's own mesh, from its file to a ventricle: one way in for whoever checks it and for whoever computes with it.

use std::path::Path;

use cardiotwin_units::Ml;

use crate::checks::{self, Defect, Expected, Item, Place, Severity};
use crate::files::{self, LengthUnit, MeshFileError, node_values};
use crate::find_surfaces::find_surfaces;
use crate::node_fibres::NodeFibres;
use crate::tet_mesh::{TetMesh, surface_names};
use crate::vec3::Vec3;

/// How far the mesh's cavity may be from the measured volume, a share of it.
pub const CAVITY_TOLERANCE: f64 = 0.1;
/// How far the contracting tissue may be from the stated wall volume before a word is said, a share of it.
pub const WALL_TOLERANCE: f64 = 0.25;
/// Radius of a site of activation \[mm\].
pub const SITE_RADIUS_MM: f64 = 3.0;
/// Surfaces without which there is no ventricle.
pub const NEEDED: [&str; 3] = [
    surface_names::ENDOCARDIUM,
    surface_names::EPICARDIUM,
    surface_names::RIM,
];

/// Where fibres are to come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fibres {
    /// The mesh's own where it has some.
    Auto,
    /// The mesh's own.
    Mesh,
    /// A rule, whatever the mesh has.
    Rule,
}

/// Where activation is to come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Activation<'a> {
    /// Times of the nodes, from a file.
    Times(&'a Path),
    /// Places where it begins, mm.
    Sites(&'a [Vec3]),
    /// Not looked at: the mesh alone is asked about.
    Unasked,
}

/// What is known about a mesh beside its file.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked<'a> {
    /// Unit of its coordinates.
    pub unit: LengthUnit,
    /// Tags of contracting tissue; none given: tags are not looked at.
    pub left_ventricle: &'a [i32],
    /// Fibres.
    pub fibres: Fibres,
    /// Volume that the cavity should have.
    pub cavity: Option<Ml>,
    /// Volume that the contracting wall should have.
    pub wall: Option<Ml>,
    /// Activation.
    pub activation: Activation<'a>,
    /// Surface of the right ventricle's endocardium, where it has a pressure.
    pub right_ventricle: Option<&'a str>,
    /// Surfaces with springs of their own.
    pub sprung: &'a [&'a str],
}

/// A mesh as it was read, with surfaces, and what is wrong with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Intake {
    /// The mesh: surfaces that were missing are found where they can be; without frames where a rule is to make them.
    pub mesh: TetMesh,
    /// Activation times of its nodes \[ms\], where there is a file of them.
    pub times_ms: Option<Vec<f64>>,
    /// Whether the surfaces were found on the mesh, for lack of some in the file.
    pub surfaces_found: bool,
    /// Everything that is wrong, errors before warnings.
    pub defects: Vec<Defect>,
}

impl Intake {
    /// Whether it can be computed with.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.defects
            .iter()
            .all(|defect| defect.severity() != Severity::Error)
    }
}

/// The path that [`files::read`] takes for a file of a mesh: the stem of CARP files, whichever of them is named.
#[must_use]
pub fn readable_path(file: &Path) -> std::path::PathBuf {
    match file.extension().and_then(|e| e.to_str()) {
        Some("pts" | "elem" | "lon") => file.with_extension(""),
        _ => file.to_owned(),
    }
}

/// Reads a mesh and looks for everything that is wrong with it.
///
/// # Errors
/// [`MeshFileError`] where the mesh's file is none.
pub fn read(file: &Path, asked: &Asked) -> Result<Intake, MeshFileError> {
    Ok(look(files::read(&readable_path(file), asked.unit)?, asked))
}

/// What openCARP has for nodes that are never activated.
const NEVER_MS: f64 = -1.0;

/// Times of the contracting tissue's nodes; infinite for all others, whatever their file says.
fn of_muscle(mesh: &TetMesh, muscle: &[i32], mut times: Vec<f64>) -> Result<Vec<f64>, Defect> {
    let mut contracts = vec![muscle.is_empty(); times.len()];
    for (tet, _) in mesh
        .tets
        .iter()
        .zip(&mesh.tags)
        .filter(|(_, tag)| muscle.contains(tag))
    {
        for node in tet {
            if let Some(own) = contracts.get_mut(*node as usize) {
                *own = true;
            }
        }
    }
    // Elsewhere a file may count its times from any moment; −1 among them is a time like another.
    let counts_from_zero = times
        .iter()
        .zip(&contracts)
        .all(|(t, own)| !own || *t == NEVER_MS || *t >= 0.0);
    let never = |node: &usize| counts_from_zero && contracts[*node] && times[*node] == NEVER_MS;
    let at_mm = |node: usize| mesh.nodes_mm.get(node).copied().unwrap_or_default();
    let places: Vec<Place> = (0..times.len())
        .filter(never)
        .map(|node| Place {
            item: Item::Node(node as u32),
            at_mm: at_mm(node),
        })
        .collect();
    if !places.is_empty() {
        let nodes = if places.len() == 1 { "node" } else { "nodes" };
        let found = format!(
            "{} {nodes} of contracting tissue with the time {NEVER_MS}",
            places.len()
        );
        return Err(Defect::Times {
            found,
            expected: "a time of activation for each".to_owned(),
            places,
        });
    }
    times
        .iter_mut()
        .zip(&contracts)
        .filter(|(_, own)| !**own)
        .for_each(|(t, _)| *t = f64::INFINITY);
    Ok(times)
}

/// Looks for everything that is wrong with a mesh, whose missing surfaces are found first.
#[must_use]
pub fn look(mut mesh: TetMesh, asked: &Asked) -> Intake {
    let mut not_found = None;
    let lacks = |mesh: &TetMesh| NEEDED.iter().any(|name| mesh.surface(name).is_none());
    let in_range = mesh
        .tets
        .iter()
        .flatten()
        .all(|node| (*node as usize) < mesh.n_nodes());
    let mut surfaces_found = false;
    if lacks(&mesh) && in_range && !mesh.tets.is_empty() {
        match find_surfaces(&mesh) {
            Ok(found) => {
                let known = |name: &str| NEEDED.contains(&name);
                mesh.surfaces.retain(|s| !known(&s.name));
                mesh.surfaces.extend(found);
                surfaces_found = true;
            }
            Err(error) => not_found = Some(error.to_string()),
        }
    }
    if asked.fibres == Fibres::Rule {
        mesh.frames.clear();
        mesh.fibres = NodeFibres::PerElement;
    }
    let expected = Expected {
        muscle_tags: asked.left_ventricle,
        fibres: asked.fibres == Fibres::Mesh
            || (asked.fibres == Fibres::Auto && !mesh.frames.is_empty()),
        surfaces: &NEEDED,
        right_ventricle: asked.right_ventricle,
        sprung: asked.sprung,
        surfaces_not_found: not_found,
        cavity: asked.cavity.map(|volume| (volume, CAVITY_TOLERANCE)),
        wall: asked.wall.map(|volume| (volume, WALL_TOLERANCE)),
    };
    let mut defects = checks::check(&mesh, asked.unit, &expected);
    let mut times_ms = None;
    let readable = !defects.iter().any(|defect| {
        matches!(
            defect,
            Defect::Empty
                | Defect::Length { .. }
                | Defect::NodeOutOfRange { .. }
                | Defect::NotFinite { .. }
        )
    });
    match asked.activation {
        Activation::Times(file) => match node_values::read(file, mesh.n_nodes()) {
            Ok(times) => match of_muscle(&mesh, asked.left_ventricle, times) {
                Ok(times) => times_ms = Some(times),
                Err(defect) => defects.push(defect),
            },
            Err(error) => defects.push(Defect::Times {
                found: error.to_string(),
                expected: "a file of activation times".to_owned(),
                places: vec![],
            }),
        },
        Activation::Sites([]) => defects.push(Defect::NoStart),
        Activation::Sites(sites) if readable => {
            defects.extend(checks::activation(
                &mesh,
                asked.left_ventricle,
                sites,
                SITE_RADIUS_MM,
            ));
        }
        Activation::Sites(_) | Activation::Unasked => {}
    }
    defects.sort_by_key(Defect::severity);
    Intake {
        mesh,
        times_ms,
        surfaces_found,
        defects,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_passive_tissue_do_not_count_and_muscle_without_one_is_a_defect() {
        let mesh = TetMesh {
            nodes_mm: vec![[0.0; 3]; 5],
            tets: vec![[0, 1, 2, 3], [1, 2, 3, 4]],
            tags: vec![1, 2],
            frames: vec![],
            fibres: NodeFibres::PerElement,
            surfaces: vec![],
        };
        // As `export --opencarp` writes them.
        let times = of_muscle(&mesh, &[1], vec![5.0, 6.0, 7.0, 8.0, -1.0]).unwrap();
        assert_eq!(times, [5.0, 6.0, 7.0, 8.0, f64::INFINITY]);
        let never = of_muscle(&mesh, &[1], vec![-1.0, 6.0, 7.0, 8.0, -1.0]).unwrap_err();
        assert!(
            never
                .to_string()
                .contains("1 node of contracting tissue with the time -1"),
            "{never}"
        );
        // Times from another moment than zero: −1 is one of them.
        assert_eq!(
            of_muscle(&mesh, &[1], vec![-1.0, -3.0, 7.0, 8.0, 0.0]).unwrap()[..2],
            [-1.0, -3.0]
        );
    }
}
