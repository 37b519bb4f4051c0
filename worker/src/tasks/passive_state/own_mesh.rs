//! A patient's own mesh: read with the content that was planned, checked, its tags and surfaces made ours.

use cardiotwin_mesh::NodeFibres;
use cardiotwin_mesh::checks::{Expected, check};
use cardiotwin_mesh::eikonal::Site;
use cardiotwin_mesh::files::{self, LengthUnit, MeshFileError, node_values};
use cardiotwin_mesh::find_surfaces::find_surfaces;
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names};
use cardiotwin_schemas::finite_element::{MeshFibres, OwnMesh};
use cardiotwin_schemas::muscle::PassiveTissues;
use cardiotwin_units::{Ml, Ms};

use super::passive_tags;
use crate::error::TaskError;
use crate::finite_element::FiniteElementError;
use crate::inputs::read_verified;

/// How far the mesh's cavity may be from the measured volume, a share of it.
const CAVITY_TOLERANCE: f64 = 0.1;
/// Radius of a site of activation \[mm\].
const SITE_RADIUS_MM: f64 = 3.0;
/// Surfaces without which there is no ventricle.
const NEEDED: [&str; 3] = [surface_names::ENDOCARDIUM, surface_names::EPICARDIUM, surface_names::RIM];

/// A mesh ready for fibres and activation.
pub(super) struct Taken {
    /// With our tags and surfaces; without frames where the rule is to make them.
    pub(super) mesh: TetMesh,
    /// Activation times of its nodes \[ms\], where they were given.
    pub(super) times_ms: Option<Vec<f64>>,
    /// Where activation begins.
    pub(super) sites: Vec<Site>,
    /// Volume of the cavity \[mL\].
    pub(super) cavity_ml: f64,
}

/// Reads and checks the mesh of a heart whose cavity was measured to hold `measured_ml` when it was imaged.
///
/// - `passive`: passive tissues with moduli of their own, by the mesh's tags; in the mesh they have [`passive_tags::ours`]
///
/// # Errors
/// [`TaskError`] when a file is missing or changed, [`FiniteElementError::OwnMesh`] with every defect of the mesh,
/// [`FiniteElementError::PassiveTag`] where a named tissue is missing.
pub(super) fn take(own: &OwnMesh, measured_ml: f64, passive: &PassiveTissues) -> Result<Taken, TaskError> {
    for file in own.files.iter().chain(&own.activation_times) {
        read_verified(file)?;
    }
    let refused = |found: String| TaskError::FiniteElement(FiniteElementError::OwnMesh { found });
    let Some(first) = own.files.first() else { return Err(refused("no file, expected one or more".to_owned())) };
    let unit = LengthUnit::from_symbol(&own.unit).ok_or_else(|| {
        let known: Vec<&str> = LengthUnit::ALL.iter().map(|u| u.symbol()).collect();
        refused(format!("unit {:?}, expected one of {}", own.unit, known.join(", ")))
    })?;
    let unreadable = |error: MeshFileError| refused(error.to_string());
    let of_carp = first.path.extension().is_some_and(|e| e == "pts");
    let named = if of_carp { first.path.with_extension("") } else { first.path.clone() };
    let mut mesh = files::read(&named, unit).map_err(unreadable)?;
    if NEEDED.iter().any(|name| mesh.surface(name).is_none()) {
        let found = find_surfaces(&mesh).map_err(|error| refused(error.to_string()))?;
        mesh.surfaces.retain(|s| s.name == surface_names::SEPTUM);
        mesh.surfaces.extend(found);
    }
    if own.fibres == MeshFibres::Rule {
        mesh.frames.clear();
        mesh.fibres = NodeFibres::PerElement;
    }
    let expected = Expected {
        muscle_tags: &own.left_ventricle,
        fibres: own.fibres == MeshFibres::Mesh,
        surfaces: &NEEDED,
        cavity: Some((Ml(measured_ml), CAVITY_TOLERANCE)),
    };
    let defects: Vec<String> = check(&mesh, unit, &expected).iter().map(|defect| format!("- {defect}")).collect();
    if !defects.is_empty() {
        return Err(refused(format!("{} cannot be computed with:\n{}", first.path.display(), defects.join("\n"))));
    }
    let contracts = |tag: i32| own.left_ventricle.contains(&tag);
    passive_tags::check(passive, mesh.tags.iter().copied().filter(|tag| !contracts(*tag)))
        .map_err(TaskError::FiniteElement)?;
    for tag in &mut mesh.tags {
        *tag = if contracts(*tag) { tags::LEFT_VENTRICLE } else { passive_tags::ours(passive, *tag) };
    }
    let times = match &own.activation_times {
        Some(file) => Some(node_values::read(&file.path, mesh.n_nodes()).map_err(unreadable)?),
        None if own.activation_sites_mm.is_empty() => {
            return Err(refused("neither activation times nor sites, expected one of them".to_owned()));
        }
        None => None,
    };
    let order = Renumbering::reverse_cuthill_mckee(&mesh);
    let mesh = order.apply(&mesh);
    let times_ms = times.map(|t| order.nodes.iter().map(|old| t[*old as usize]).collect());
    let site = |at_mm: &[f64; 3]| Site { at_mm: *at_mm, radius_mm: SITE_RADIUS_MM, time: Ms(0.0) };
    let sites = own.activation_sites_mm.iter().map(site).collect();
    let endocardium = mesh.surface(surface_names::ENDOCARDIUM).map(|s| s.triangles.as_slice()).unwrap_or_default();
    let cavity_ml = cardiotwin_mesh::cavity::Cavity::behind(endocardium)
        .map_err(|error| refused(error.to_string()))?
        .volume(&mesh.nodes_mm)
        .0;
    Ok(Taken { mesh, times_ms, sites, cavity_ml })
}
