//! Reads and checks a patient's own mesh, and converts its tags and surface names to ours.

use std::collections::BTreeSet;

use cardiotwin_mesh::cavity::Cavity;
use cardiotwin_mesh::checks::Severity;
use cardiotwin_mesh::eikonal::Site;
use cardiotwin_mesh::files::{LengthUnit, MeshFileError};
use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres, SITE_RADIUS_MM};
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

/// A mesh ready for fibres and activation.
pub(super) struct Taken {
    /// The mesh with our tags and surface names; without fibres if the rule has to make them.
    pub(super) mesh: TetMesh,
    /// Activation times of its nodes \[ms\], if they were given.
    pub(super) times_ms: Option<Vec<f64>>,
    /// Sites at which activation begins.
    pub(super) sites: Vec<Site>,
    /// Volume of the cavity \[mL\].
    pub(super) cavity_ml: f64,
    /// Tags of the file whose tissue does not belong to the base, see [`tags::BESIDE`].
    pub(super) beside: BTreeSet<i32>,
    /// Volume of the contracting wall \[mL\].
    pub(super) wall_ml: f64,
    /// Volume of the right ventricle's cavity \[mL\], if a pressure is given for it.
    pub(super) right_cavity_ml: Option<f64>,
}

/// Reads and checks the mesh of a heart whose cavity volume in the image was measured as
/// `measured_ml`.
///
/// - `passive`: passive tissues with moduli of their own, by the file's tags; in the mesh they get
///   the tags of [`passive_tags::ours`]
/// - `sprung`: names of the surfaces with springs of their own
///
/// # Errors
/// [`TaskError`] when a file is missing or changed, [`FiniteElementError::OwnMesh`] with every
/// defect of the mesh, [`FiniteElementError::PassiveTag`] when a named tissue is missing.
pub(super) fn take(
    own: &OwnMesh,
    measured_ml: f64,
    passive: &PassiveTissues,
    sprung: &[&str],
) -> Result<Taken, TaskError> {
    for file in own.files.iter().chain(&own.activation_times) {
        read_verified(file)?;
    }
    let refused = |found: String| TaskError::FiniteElement(FiniteElementError::OwnMesh { found });
    let Some(first) = own.files.first() else {
        return Err(refused("no file, expected one or more".to_owned()));
    };
    let unit = LengthUnit::from_symbol(&own.unit).ok_or_else(|| {
        let known: Vec<&str> = LengthUnit::ALL.iter().map(|u| u.symbol()).collect();
        refused(format!(
            "unit {:?}, expected one of {}",
            own.unit,
            known.join(", ")
        ))
    })?;
    let unreadable = |error: MeshFileError| refused(error.to_string());
    let activation = match &own.activation_times {
        Some(file) => Activation::Times(&file.path),
        None => Activation::Sites(&own.activation_sites_mm),
    };
    let fibres = match own.fibres {
        MeshFibres::Auto => Fibres::Auto,
        MeshFibres::Mesh => Fibres::Mesh,
        MeshFibres::Rule => Fibres::Rule,
    };
    let left_ventricle = &own.left_ventricle;
    let right = own
        .right_ventricle
        .as_ref()
        .map(|right| right.surface.as_str());
    let asked = Asked {
        unit,
        left_ventricle,
        fibres,
        cavity: Some(Ml(measured_ml)),
        wall: None,
        activation,
        right_ventricle: right,
        sprung,
    };
    // `cardiotwin check` calls the same function, before any task waits in a queue.
    let taken = intake::read(&first.path, &asked).map_err(unreadable)?;
    if !taken.is_sound() {
        let errors = taken
            .defects
            .iter()
            .filter(|defect| defect.severity() == Severity::Error);
        let lines: Vec<String> = errors.map(|defect| format!("- {defect}")).collect();
        return Err(refused(format!(
            "{} cannot be computed with:\n{}",
            first.path.display(),
            lines.join("\n")
        )));
    }
    let (mut mesh, times) = (taken.mesh, taken.times_ms);
    let contracts = |tag: i32| own.left_ventricle.contains(&tag);
    passive_tags::check(
        passive,
        mesh.tags.iter().copied().filter(|tag| !contracts(*tag)),
    )
    .map_err(TaskError::FiniteElement)?;
    let beside = right.map_or_else(BTreeSet::new, |name| beside(&mut mesh, name, contracts));
    for tag in &mut mesh.tags {
        *tag = if contracts(*tag) {
            tags::LEFT_VENTRICLE
        } else {
            passive_tags::ours(passive, &beside, *tag)
        };
    }
    let order = Renumbering::reverse_cuthill_mckee(&mesh);
    let mesh = order.apply(&mesh);
    let times_ms = times.map(|t| order.nodes.iter().map(|old| t[*old as usize]).collect());
    let site = |at_mm: &[f64; 3]| Site {
        at_mm: *at_mm,
        radius_mm: SITE_RADIUS_MM,
        time: Ms(0.0),
    };
    let sites = own.activation_sites_mm.iter().map(site).collect();
    let volume_ml = |name: &str| {
        let triangles = mesh
            .surface(name)
            .map(|s| s.triangles.as_slice())
            .unwrap_or_default();
        Cavity::behind(triangles)
            .map(|cavity| cavity.volume(&mesh.nodes_mm).0)
            .map_err(|error| refused(error.to_string()))
    };
    let cavity_ml = volume_ml(surface_names::ENDOCARDIUM)?;
    let right_cavity_ml = right
        .map(|_| volume_ml(surface_names::RIGHT_VENTRICLE))
        .transpose()?;
    let wall_ml = mesh.tissue_volume(&[tags::LEFT_VENTRICLE]).0;
    Ok(Taken {
        wall_ml,
        mesh,
        times_ms,
        sites,
        cavity_ml,
        beside,
        right_cavity_ml,
    })
}

/// Gives the right ventricle's surface our name. Returns the tags of passive tissue that touches
/// the left ventricle's cavity nowhere: it belongs to the right ventricle's wall and not to a ring
/// at the base.
fn beside(mesh: &mut TetMesh, right: &str, contracts: impl Fn(i32) -> bool) -> BTreeSet<i32> {
    for surface in mesh
        .surfaces
        .iter_mut()
        .filter(|surface| surface.name == right)
    {
        surface.name = surface_names::RIGHT_VENTRICLE.to_owned();
    }
    let mut inner = vec![false; mesh.n_nodes()];
    for node in mesh
        .surface(surface_names::ENDOCARDIUM)
        .map(|s| s.nodes())
        .unwrap_or_default()
    {
        inner[node as usize] = true;
    }
    let reaches = |tet: &[u32; 4]| tet.iter().any(|node| inner[*node as usize]);
    let of_base: BTreeSet<i32> = (mesh.tets.iter().zip(&mesh.tags))
        .filter(|(tet, _)| reaches(tet))
        .map(|(_, tag)| *tag)
        .collect();
    mesh.tags
        .iter()
        .copied()
        .filter(|tag| !contracts(*tag) && !of_base.contains(tag))
        .collect()
}
