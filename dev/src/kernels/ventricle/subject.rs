//! The benchmark's generated ventricle at end-diastole.

use std::ops::ControlFlow;
use std::time::Instant;

use cardiotwin_mechanics::organ::{
    Anatomy, ElementKind, EndDiastole, PassiveFit, PassiveJob, RankParts, Search, SearchProgress,
    UnloadingSettings, VentricleParts, WallParameters,
};
use cardiotwin_mechanics::step::StepSettings;
use cardiotwin_mesh::TetMesh;
use cardiotwin_mesh::eikonal::{Conduction, activation_ms};
use cardiotwin_mesh::ellipsoid::{EllipsoidSpec, generate};
use cardiotwin_mesh::fibres::{FibreAngles, make};
use cardiotwin_mesh::order::Renumbering;
use cardiotwin_mesh::tags;
use cardiotwin_models::contraction::{Tanh, TanhParameters};
use cardiotwin_models::ventricle::GroupContraction;
use cardiotwin_units::{MMHG_PER_KPA, Ml, Ms};

use super::figures::{BenchError, Element, Ranks, failed};
use cardiotwin_worker::finite_element::passive::{Workers, found};
use cardiotwin_worker::stop::StopFlag;

/// Volumes of the cavity and of the wall.
const CAVITY_ML: f64 = 112.0;
const WALL_ML: f64 = 140.0;
/// Stiffness C \[kPa\] and end-diastolic pressure. The benchmark's step 0 only inflates to this
/// pressure.
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

/// The stop flag was raised before the beat.
#[derive(Debug, thiserror::Error)]
#[error("before the beat")]
struct Early;

fn going_on(stop: &StopFlag) -> Result<(), BenchError> {
    if stop.is_raised() {
        Err(failed("stopped on request")(Early))
    } else {
        Ok(())
    }
}

pub(super) fn wall() -> WallParameters {
    let mut wall = WallParameters::default();
    wall.muscle = wall.muscle.with_stiffness(STIFFNESS_KPA);
    wall
}

fn contraction() -> Result<GroupContraction, BenchError> {
    let tanh = TanhParameters {
        smax_ref_kpa: 100.0,
        t_cr_ms: 400.0,
        ..TanhParameters::default()
    };
    Ok(GroupContraction::tanh(
        Tanh::new(tanh).map_err(failed("no contraction model"))?,
    ))
}

/// Input of a rank other than 0.
pub(super) fn of_another_rank(
    wall: &WallParameters,
    cycle_length: Ms,
    settings: StepSettings,
) -> Result<RankParts<'_>, BenchError> {
    Ok(RankParts {
        wall,
        contraction: contraction()?,
        cycle_length,
        viscosity: None,
        settings,
    })
}

impl Subject {
    /// Makes the mesh and inflates it on the largest of `ranks`. Of several processes, rank 0 calls
    /// this and the others follow.
    pub fn new(
        nodes: usize,
        element: Element,
        ranks: &[Ranks<'_>],
        stop: &StopFlag,
        mut report: impl FnMut(&str),
    ) -> Result<Self, BenchError> {
        let begun = Instant::now();
        report("mesh, fibres, activation");
        let (mesh, times) = heart(nodes, stop)?;
        let kind = match element {
            Element::Linear => ElementKind::default(),
            Element::Pointwise => ElementKind::LINEAR_POINTWISE,
        };
        let anatomy =
            Anatomy::of(&mesh, &[tags::LEFT_VENTRICLE], kind).map_err(failed("no anatomy"))?;
        let (nodes, elements) = (mesh.n_nodes(), mesh.n_tets());
        drop(mesh);
        let seconds_mesh = begun.elapsed().as_secs_f64();

        report(&format!(
            "inflation of {nodes} nodes, {elements} tetrahedra"
        ));
        let begun = Instant::now();
        let mut workers = Workers::Threads(1);
        for ranks in ranks {
            workers = match (*ranks, workers) {
                (Ranks::Team(team), _) => Workers::Team(team),
                (Ranks::Threads(n), Workers::Threads(most)) => Workers::Threads(n.max(most)),
                (_, workers) => workers,
            };
        }
        let end_diastole = inflated(&anatomy, workers, stop)?;
        if let Workers::Team(team) = workers {
            // The other ranks now continue to the beat.
            team.dismiss();
        }
        let seconds_inflation = begun.elapsed().as_secs_f64();
        Ok(Self {
            nodes,
            elements,
            seconds_mesh,
            seconds_inflation,
            anatomy,
            times,
            wall: wall(),
            end_diastole,
        })
    }

    /// Input from which the ventricle is made.
    pub fn parts(
        &self,
        cycle_length: Ms,
        settings: StepSettings,
    ) -> Result<VentricleParts<'_>, BenchError> {
        Ok(VentricleParts {
            anatomy: &self.anatomy,
            wall: &self.wall,
            end_diastole: self.end_diastole.clone(),
            contraction: contraction()?,
            activation_ms: &self.times,
            cycle_length,
            pressure_terms: vec![],
            viscosity: None,
            settings,
        })
    }
}

/// A generated mesh with fibres, and its nodal activation times.
fn heart(nodes: usize, stop: &StopFlag) -> Result<(TetMesh, Vec<f64>), BenchError> {
    let spec = EllipsoidSpec::new(Ml(CAVITY_ML), Ml(WALL_ML), nodes);
    let made = generate(&spec).map_err(failed("cannot generate a ventricle"))?;
    let mut mesh = Renumbering::reverse_cuthill_mckee(&made.mesh).apply(&made.mesh);
    going_on(stop)?;
    let muscle = [tags::LEFT_VENTRICLE];
    make(&mut mesh, &muscle, &FibreAngles::default()).map_err(failed("no fibres"))?;
    going_on(stop)?;
    let conduction = Conduction::of_left_ventricle(&made.shape.fascicles());
    let times = activation_ms(&mesh, &conduction).map_err(failed("no activation"))?;
    going_on(stop)?;
    Ok((mesh, times))
}

/// End-diastole, with the image configuration taken as unloaded.
fn inflated(
    anatomy: &Anatomy,
    workers: Workers<'_>,
    stop: &StopFlag,
) -> Result<EndDiastole, BenchError> {
    let target = PassiveFit::ImageUnloaded {
        end_diastolic_pressure_kpa: END_DIASTOLIC_MMHG / MMHG_PER_KPA,
    };
    let job = PassiveJob {
        wall: wall(),
        target,
        slope: None,
        steepened_by: None,
    };
    let mut watch = |_: &SearchProgress| {
        if stop.is_raised() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let mut search = Search::watched(UnloadingSettings::for_anatomy(anatomy), &mut watch);
    let found = found(&job, anatomy, workers, &mut search);
    Ok(found.map_err(failed("no end-diastole"))?.end_diastole)
}
