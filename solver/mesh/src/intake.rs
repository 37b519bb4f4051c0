//! Intake of a patient's own mesh, from its file to a ventricle. The checks and the computation use
//! the same function.

use std::path::Path;

use cardiotwin_units::Ml;

use crate::checks::{self, Defect, Expected, Item, Place, Severity};
use crate::files::{self, LengthUnit, MeshFileError, node_values};
use crate::find_surfaces::find_surfaces;
use crate::node_fibres::NodeFibres;
use crate::tet_mesh::{TetMesh, surface_names};
use crate::vec3::Vec3;

/// Largest accepted relative difference between the volumes of the mesh's cavity and of the
/// measurement.
pub const CAVITY_TOLERANCE: f64 = 0.1;
/// Largest relative difference between the contracting tissue and the stated wall volume that gives
/// no warning.
pub const WALL_TOLERANCE: f64 = 0.25;
/// Radius of an activation site \[mm\].
pub const SITE_RADIUS_MM: f64 = 3.0;
/// Surfaces that every ventricle must have.
pub const NEEDED: [&str; 3] = [
    surface_names::ENDOCARDIUM,
    surface_names::EPICARDIUM,
    surface_names::RIM,
];

/// Source of the fibres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fibres {
    /// The mesh's own fibres if it has any, otherwise the rule.
    Auto,
    /// The mesh's own fibres.
    Mesh,
    /// The rule, even if the mesh has fibres.
    Rule,
}

/// Source of the activation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Activation<'a> {
    /// A file with the nodes' activation times.
    Times(&'a Path),
    /// Positions of the sites where activation begins \[mm\].
    Sites(&'a [Vec3]),
    /// No check of the activation, only of the mesh.
    Unasked,
}

/// Information about a mesh besides its file.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked<'a> {
    /// Unit of the coordinates.
    pub unit: LengthUnit,
    /// Tags of contracting tissue; if empty, tags are not checked.
    pub left_ventricle: &'a [i32],
    /// Source of the fibres.
    pub fibres: Fibres,
    /// Expected volume of the cavity.
    pub cavity: Option<Ml>,
    /// Expected volume of the contracting wall.
    pub wall: Option<Ml>,
    /// Source of the activation.
    pub activation: Activation<'a>,
    /// Name of the right ventricle's endocardium, if a pressure acts on it.
    pub right_ventricle: Option<&'a str>,
    /// Names of surfaces with springs of their own.
    pub sprung: &'a [&'a str],
}

/// A mesh as read, completed with surfaces, and its defects.
#[derive(Debug, Clone, PartialEq)]
pub struct Intake {
    /// The mesh. Missing surfaces have been found if possible; fibre frames are missing if a rule
    /// has to make them.
    pub mesh: TetMesh,
    /// Activation times of its nodes \[ms\], if a file gives them.
    pub times_ms: Option<Vec<f64>>,
    /// Whether surfaces were missing in the file and found on the mesh.
    pub surfaces_found: bool,
    /// All defects, errors before warnings.
    pub defects: Vec<Defect>,
}

impl Intake {
    /// Whether computations with the mesh are possible.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.defects
            .iter()
            .all(|defect| defect.severity() != Severity::Error)
    }
}

/// Path under which [`files::read`] finds a mesh: the stem for any of its CARP files, otherwise the
/// file itself.
#[must_use]
pub fn readable_path(file: &Path) -> std::path::PathBuf {
    match file.extension().and_then(|e| e.to_str()) {
        Some("pts" | "elem" | "lon") => file.with_extension(""),
        _ => file.to_owned(),
    }
}

/// Reads a mesh and finds all its defects.
///
/// # Errors
/// [`MeshFileError`] if the mesh's file cannot be read or parsed.
pub fn read(file: &Path, asked: &Asked) -> Result<Intake, MeshFileError> {
    let (mesh, names) = files::read_naming_directions(&readable_path(file), asked.unit)?;
    let mut intake = look(mesh, asked);
    let is_rule = asked.fibres == Fibres::Auto && intake.mesh.frames.is_empty();
    if is_rule && !names.is_empty() {
        // The last of the warnings, so that errors stay first.
        intake.defects.push(Defect::UnreadDirections { names });
    }
    Ok(intake)
}

/// openCARP's activation time of nodes that are never activated.
const NEVER_MS: f64 = -1.0;

/// Activation times of the contracting tissue's nodes; infinite at all other nodes, whatever the
/// file contains.
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
    // Other files may count times from any instant; −1 is then a valid time.
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

/// Finds all defects of a mesh. Missing surfaces are searched first.
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
        // Times as `export --opencarp` writes them.
        let times = of_muscle(&mesh, &[1], vec![5.0, 6.0, 7.0, 8.0, -1.0]).unwrap();
        assert_eq!(times, [5.0, 6.0, 7.0, 8.0, f64::INFINITY]);
        let never = of_muscle(&mesh, &[1], vec![-1.0, 6.0, 7.0, 8.0, -1.0]).unwrap_err();
        assert!(
            never
                .to_string()
                .contains("1 node of contracting tissue with the time -1"),
            "{never}"
        );
        // Times that do not begin at zero, so that −1 is a valid one.
        assert_eq!(
            of_muscle(&mesh, &[1], vec![-1.0, -3.0, 7.0, 8.0, 0.0]).unwrap()[..2],
            [-1.0, -3.0]
        );
    }
}
