//! Energy over a beat of a block of the benchmark's myocardium, under active stress and pressure.

use cardiotwin_dev_solver::prescribed::{Course, TimeCourse};
use cardiotwin_linalg::parallel::{Layout, SingleProcess};
use cardiotwin_mechanics::body::{Body, BodyInput, Deformation};
use cardiotwin_mechanics::boundary::{PressureSurface, Robin, RobinDirection};
use cardiotwin_mechanics::dynamics::{Candidate, Dynamics, State, Support, SurfaceLoad};
use cardiotwin_mechanics::element::kernel::{ActivePoint, VolumeChange};
use cardiotwin_mechanics::material::{
    ActiveLaw, HolzapfelOgden, Law, Tissue, Volumetric, VolumetricLaw,
};
use cardiotwin_mechanics::step::{Closure, Passive, PointStress, Solver, StepSettings, step};
use cardiotwin_mechanics::time_integration::GeneralisedAlpha;
use cardiotwin_models::contraction::ContractionError;

use super::meshes::{Mesh, cuboid};

pub const ETA_KPA_MS: f64 = 100.0;

/// A block of 10 mm of the benchmark's myocardium.
pub fn body(viscosity: f64) -> (Mesh, Body) {
    let mesh = cuboid([2, 2, 2], |p| p.map(|x| 10.0 * x));
    let tissue = Tissue {
        law: Law::HolzapfelOgden(HolzapfelOgden::arostica2025()),
        volumetric: Volumetric {
            law: VolumetricLaw::QuadraticLn,
            kappa_kpa: 1000.0,
        },
        active: Some(ActiveLaw::BENCHMARK),
        density: 1.0,
    };
    let tissue_of = vec![0; mesh.tets.len()];
    let input = BodyInput {
        nodes: &mesh.nodes,
        n_vertices: mesh.nodes.len(),
        tets: &mesh.tets,
        tissues: vec![tissue],
        tissue_of: &tissue_of,
        frame: &|_, _| [[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]],
        volume: VolumeChange::Nodal {
            pointwise_share: 0.05,
        },
        layout: Layout::whole(mesh.nodes.len()),
        elements: &[],
    };
    let mut body = Body::linear(&input, &SingleProcess).expect("a proper mesh");
    body.set_viscosity(vec![viscosity]).expect("a viscosity");
    (mesh, body)
}

pub fn deform(body: &Body, u: &[f64]) -> Deformation {
    let mut deformation = Deformation::default();
    body.deform(u, &SingleProcess, &mut deformation);
    deformation
}

/// Energies \[µJ\] of the block at a state, and the power of loads and of what dissipates \[µJ/ms\].
struct Powers {
    stored: f64,
    pressure: f64,
    muscle: f64,
    lost: f64,
}

fn powers(dynamics: &Dynamics, state: &State, active: &[ActivePoint]) -> Powers {
    let (u, v) = (&state.motion.u, &state.motion.v);
    let n = u.len();
    let along = |f: &[f64]| f.iter().zip(v).map(|(f, v)| f * v).sum::<f64>();
    let deformation = deform(&dynamics.body, u);
    let mut internal = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    dynamics
        .body
        .add_forces(u, &[], &deformation, &mut internal[0]);
    dynamics
        .body
        .add_forces(u, active, &deformation, &mut internal[1]);
    dynamics
        .body
        .add_forces_in_motion(u, v, &[], &deformation, &mut internal[2]);
    let passive = along(&internal[0]);
    let mut push = vec![0.0; n];
    for load in &dynamics.loads {
        load.surface
            .add_forces(load.pressure_kpa, dynamics.body.reference(), u, &mut push);
    }
    let (mut spring, mut brake) = (vec![0.0; n], vec![0.0; n]);
    for s in &dynamics.supports {
        s.robin.add_forces(0.5 * s.spring, u, &mut spring);
        s.robin.add_forces(s.dashpot, v, &mut brake);
    }
    let kinetic: f64 = (dynamics.masses().iter().enumerate())
        .map(|(k, m)| 0.5 * m * v[3 * k..3 * k + 3].iter().map(|v| v * v).sum::<f64>())
        .sum();
    let springs: f64 = spring.iter().zip(u).map(|(f, u)| f * u).sum();
    Powers {
        stored: kinetic + springs + dynamics.body.strain_energy(u),
        pressure: -along(&push),
        muscle: passive - along(&internal[1]),
        lost: along(&internal[2]) - passive + along(&brake),
    }
}

/// Energies since the beginning of the beat \[µJ\].
#[derive(Debug, Clone, Copy)]
pub struct Balance {
    pub t_ms: f64,
    /// Work of the pressure.
    pub pressure: f64,
    /// Work of the active stress.
    pub muscle: f64,
    /// Dissipated by viscosity and dashpots.
    pub lost: f64,
    /// Kinetic, strain and springs'.
    pub stored: f64,
    /// Of the absolute values of both powers.
    pub turned_over: f64,
}

impl Balance {
    /// Energy that the balance misses, work minus loss and storage.
    pub fn gap(&self) -> f64 {
        self.pressure + self.muscle - self.lost - self.stored
    }
}

/// A prescribed active stress.
struct Given(Vec<ActivePoint>);
impl PointStress for Given {
    fn evaluate(
        &mut self,
        dt_ms: f64,
        deformation: &Deformation,
        out: &mut Vec<ActivePoint>,
    ) -> Result<(), ContractionError> {
        Passive.evaluate(dt_ms, deformation, out)?;
        out.extend_from_slice(&self.0);
        Ok(())
    }
}

/// The balance at the end of each step of a millisecond.
pub fn beat() -> Vec<Balance> {
    let (mesh, body) = body(ETA_KPA_MS);
    let all = |side: usize| {
        let robin = Robin::new(
            &mesh.sides[side],
            RobinDirection::All,
            body.reference(),
            body.pattern(),
        )
        .expect("faces");
        Support {
            robin,
            spring: 2.0,
            dashpot: 5.0,
            rest: vec![],
        }
    };
    let supports = vec![all(4)];
    let surface = PressureSurface::new(&mesh.sides[5], body.pattern()).expect("faces");
    let n_points = body.n_point_batches();
    let scheme = GeneralisedAlpha::with_weights(0.2, 0.4).expect("the benchmark's");
    let mut dynamics = Dynamics::new(body, Box::new(SingleProcess), scheme);
    dynamics.supports = supports;
    dynamics.loads = vec![SurfaceLoad {
        surface,
        pressure_kpa: 0.0,
    }];
    let end_ms = 400.0;
    let course = |kind| Course::new(kind, end_ms).expect("a course");
    let (t_s, value_kpa) = (vec![0.0, 0.1, 0.2, 0.3], vec![0.0, 4.0, 4.0, 0.0]);
    let pressure = course(TimeCourse::Table { t_s, value_kpa });
    let stress = course(TimeCourse::Activation {
        contractility_kpa: 60.0,
        rise_per_s: 10.0,
        fall_per_s: -30.0,
        on_s: 0.05,
        off_s: 0.25,
        switch_s: 0.01,
    });
    let points = |t: f64| {
        vec![
            ActivePoint {
                sa_kpa: [stress.at(t); 8],
                slope_kpa: [0.0; 8]
            };
            n_points
        ]
    };
    let settings = StepSettings {
        relative_tolerance: 1e-8,
        max_iterations: 20,
        ..StepSettings::default()
    };
    let mut now = dynamics
        .start(vec![0.0; dynamics.body.reference().len()], vec![], 0.0)
        .expect("sound");
    let mut solver = Solver::new();
    let (mut work, mut muscle_work, mut lost, mut turned_over) = (0.0, 0.0, 0.0, 0.0);
    let dt = 1.0;
    let mut rows = vec![];
    let mut last = powers(&dynamics, &now, &points(0.0));
    for k in 1..=end_ms as usize {
        let t = k as f64 * dt;
        dynamics.loads[0].pressure_kpa = pressure.at(t);
        let mut given = Given(points(t));
        let mut candidate = Candidate::default();
        dynamics
            .scheme
            .predict(dt, &now.motion, &mut candidate.motion.u);
        let mut closure = Closure::Pressure(0.0);
        let (force, _) = step(
            &dynamics,
            &now,
            dt,
            &mut candidate,
            &mut given,
            &mut closure,
            &mut solver,
            &settings,
        )
        .expect("a step");
        now = State {
            motion: candidate.motion,
            force,
            pressure_kpa: 0.0,
        };
        let next = powers(&dynamics, &now, &given.0);
        let mean = |a: f64, b: f64| 0.5 * dt * (a + b);
        work += mean(last.pressure, next.pressure);
        muscle_work += mean(last.muscle, next.muscle);
        lost += mean(last.lost, next.lost);
        turned_over += mean(
            last.pressure.abs() + last.muscle.abs(),
            next.pressure.abs() + next.muscle.abs(),
        );
        last = next;
        rows.push(Balance {
            t_ms: t,
            pressure: work,
            muscle: muscle_work,
            lost,
            stored: last.stored,
            turned_over,
        });
    }
    rows
}
