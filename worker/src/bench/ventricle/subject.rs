//! The generated ventricle of the bench, at its end-diastole.

use std::time::Instant;

use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, EndDiastole, PassiveState, Search, UnloadingSettings, VentricleParts, WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::TetMesh;
use cardiotwin_mesh::eikonal::{Conduction, ENDOCARDIAL_SPEED, Speeds, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{Angles, Longitudinal, fields, frames};
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::ventricle::GroupContraction;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Ms};

use super::{BenchError, Element, failed};
use crate::team::Team;

/// Cavity and wall of the generated ventricle.
const CAVITY_ML: f64 = 112.0;
const WALL_ML: f64 = 140.0;
/// Stiffness C \[kPa\] and pressure of the inflation: step 0 does no more here.
const STIFFNESS_KPA: f64 = 0.8;
const END_DIASTOLIC_MMHG: f64 = 9.0;

/// Anatomy, activation and end-diastole.
pub(super) struct Subject {
    pub nodes: usize,
    pub elements: usize,
    pub seconds_mesh: f64,
    pub seconds_inflation: f64,
    anatomy: Anatomy,
    times: Vec<f64>,
    wall: WallParameters,
    end_diastole: EndDiastole,
}

impl Subject {
    /// Makes the mesh, and inflates it: of several processes rank 0 alone, for all.
    pub fn new(
        nodes: usize,
        element: Element,
        team: Option<&Team>,
        mut report: impl FnMut(&str),
    ) -> Result<Self, BenchError> {
        let begun = Instant::now();
        report("mesh, fibres, activation");
        let (mesh, times) = heart(nodes)?;
        let kind = match element {
            Element::Linear => ElementKind::LINEAR_NODAL,
            Element::Pointwise => ElementKind::LINEAR_POINTWISE,
        };
        let anatomy = Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], kind).map_err(failed("no anatomy"))?;
        let (nodes, elements) = (mesh.n_nodes(), mesh.n_tets());
        drop(mesh);
        let seconds_mesh = begun.elapsed().as_secs_f64();

        report(&format!("inflation of {nodes} nodes, {elements} tetrahedra"));
        let begun = Instant::now();
        let mut wall = WallParameters::default();
        wall.muscle.c_kpa = STIFFNESS_KPA;
        let comm = team.map(Team::comm);
        let end_diastole = match comm.as_ref().filter(|comm| comm.rank() > 0) {
            None => inflated(&anatomy, &wall)?,
            // The image is taken for unloaded: displacements are all that rank 0 found.
            Some(_) => EndDiastole {
                unloaded: anatomy.nodes.clone(),
                anchor: vec![0.0; 3 * nodes],
                u: vec![0.0; 3 * nodes],
                pressure_kpa: END_DIASTOLIC_MMHG / MMHG_PER_KPA,
            },
        };
        let mut subject = Self {
            nodes,
            elements,
            seconds_mesh,
            seconds_inflation: begun.elapsed().as_secs_f64(),
            anatomy,
            times,
            wall,
            end_diastole,
        };
        if let Some(comm) = comm {
            comm.order(&mut [1.0]);
            comm.broadcast(&mut subject.end_diastole.u);
        }
        Ok(subject)
    }

    /// What a ventricle is made from.
    pub fn parts(&self, cycle_length: Ms, settings: StepSettings) -> Result<VentricleParts<'_>, BenchError> {
        let tanh = TanhParameters { smax_ref_kpa: 100.0, t_cr_ms: 400.0, ..TanhParameters::default() };
        Ok(VentricleParts {
            anatomy: &self.anatomy,
            wall: &self.wall,
            end_diastole: self.end_diastole.clone(),
            contraction: GroupContraction::tanh(Tanh::new(tanh).map_err(failed("no contraction model"))?),
            activation_ms: &self.times,
            cycle_length,
            pressure_terms: vec![],
            viscosity: None,
            settings,
        })
    }
}

/// A generated mesh with fibres, and its activation times.
fn heart(nodes: usize) -> Result<(TetMesh, Vec<f64>), BenchError> {
    let spec = EllipsoidSpec::new(Ml(CAVITY_ML), Ml(WALL_ML), nodes);
    let made = generate(&spec).map_err(failed("cannot generate a ventricle"))?;
    let mut mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
    let muscle = [tags::LEFT_VENTRICLE];
    let found = fields(&mesh, &muscle, Longitudinal::FromBase).map_err(failed("no fibres"))?;
    mesh.frames = frames(&mesh, &muscle, &found, &Angles::default());
    let conduction = Conduction {
        speeds: Speeds::default(),
        endocardial_speed: Some(ENDOCARDIAL_SPEED),
        tags: muscle.to_vec(),
        sites: made.shape.fascicles().to_vec(),
    };
    let times = activation_ms(&mesh, &conduction).map_err(failed("no activation"))?;
    Ok((mesh, times))
}

/// End-diastole of the image taken for unloaded.
fn inflated(anatomy: &Anatomy, wall: &WallParameters) -> Result<EndDiastole, BenchError> {
    let mut search = Search::new(UnloadingSettings::for_anatomy(anatomy));
    let mut state = PassiveState::unloaded_image(anatomy, wall).map_err(failed("no wall"))?;
    state.inflate(END_DIASTOLIC_MMHG / MMHG_PER_KPA, &mut search).map_err(failed("no end-diastole"))?;
    Ok(state.into())
}
