//! The contraction model of Land 2017 in a cube: its stress depends on the rate of stretch, and a scheme that takes it at the
//! stretch of the step before is unstable without the term of Regazzoni and Quarteroni 2021, Comput Methods Appl Mech Eng
//! 373:113506: the shorter the step, the more so.

use super::meshes::cuboid;
use cardiotwin_linalg::parallel::SingleProcess;
use cardiotwin_mechanics::body::Deformation;
use cardiotwin_mechanics::boundary::PressureSurface;
use cardiotwin_mechanics::dynamics::{Candidate, Dynamics, State, SurfaceLoad};
use cardiotwin_mechanics::element::BATCH;
use cardiotwin_mechanics::element::kernel::ActivePoint;
use cardiotwin_mechanics::material::{ActiveLaw, Guccione, Law, Tissue, Volumetric, VolumetricLaw};
use cardiotwin_mechanics::newton::LinearSolver;
use cardiotwin_mechanics::step::{Closure, PointStress, Solver, StepSettings, step};
use cardiotwin_mechanics::time_integration::GeneralisedAlpha;
use cardiotwin_models::contraction::{
    Contraction, ContractionError, Land2017, Land2017Parameters, NodeStep,
};
use cardiotwin_units::Stretch;

/// Stretch at which the cells' stress is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coupling {
    /// At the end of the step, with the model's own answer, as in the ventricle.
    Implicit,
    /// At the stretch of the step before, `Sa + K_a (λ − λ_n)` in residual and tangent.
    Stabilised,
    /// At the stretch of the step before, without a correction.
    Staggered,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// Both ends are held.
    Isometric,
    /// One end is held, with a small tension at the other.
    Shortening,
}

struct Cells {
    model: Land2017,
    coupling: Coupling,
    t_ms: f64,
    states: Vec<f64>,
    trial: Vec<f64>,
    before: Vec<f64>,
    now: Vec<f64>,
    next: Vec<f64>,
}

/// Calcium \[µM\]: half of the cells begin 10 ms later, so that there is motion inside where both ends are held.
fn calcium(t_ms: f64, point: usize) -> f64 {
    let t = t_ms - if point.is_multiple_of(2) { 2.0 } else { 12.0 };
    if t <= 0.0 {
        0.1
    } else {
        0.1 + 0.9 * (1.0 - (-t / 10.0).exp())
    }
}

impl PointStress for Cells {
    fn evaluate(
        &mut self,
        dt_ms: f64,
        deformation: &Deformation,
        out: &mut Vec<ActivePoint>,
    ) -> Result<(), ContractionError> {
        out.clear();
        let n = self.model.n_states();
        for (idx, squared) in deformation.squared_stretch.iter().enumerate() {
            let mut point = ActivePoint::NONE;
            for (lane, squared) in squared.iter().enumerate() {
                let k = idx * BATCH + lane;
                let lambda = squared.sqrt();
                self.next[k] = lambda;
                let implicit = self.coupling == Coupling::Implicit;
                let (from, to) = if implicit {
                    (self.now[k], lambda)
                } else {
                    (self.before[k], self.now[k])
                };
                let cell = NodeStep {
                    since_activation_ms: self.t_ms,
                    dt_ms,
                    ca_start_um: calcium(self.t_ms - dt_ms, idx),
                    ca_end_um: calcium(self.t_ms, idx),
                    lambda_prev: from,
                    lambda: to,
                };
                let range = k * n..(k + 1) * n;
                let stress = self.model.try_step(
                    &cell,
                    &self.states[range.clone()],
                    &mut self.trial[range.clone()],
                )?;
                let state: [f64; 6] = std::array::from_fn(|i| self.trial[range.start + i]);
                let stiffness = self.model.active_stiffness(&state, Stretch(self.now[k])).0;
                (point.sa_kpa[lane], point.slope_kpa[lane]) = match self.coupling {
                    Coupling::Implicit => (stress.sa_kpa, stress.dsa_dlambda_kpa),
                    Coupling::Stabilised => (
                        stress.sa_kpa + stiffness * (lambda - self.now[k]),
                        stiffness,
                    ),
                    Coupling::Staggered => (stress.sa_kpa, 0.0),
                };
            }
            out.push(point);
        }
        Ok(())
    }
}

impl Cells {
    fn commit(&mut self) {
        std::mem::swap(&mut self.states, &mut self.trial);
        std::mem::swap(&mut self.before, &mut self.now);
        self.now.clone_from(&self.next);
    }
}

/// Mean stretch at the end of each step; shorter where a step failed.
pub fn contract(load: Load, coupling: Coupling, dt_ms: f64, end_ms: f64) -> Vec<f64> {
    let mesh = cuboid([2, 2, 2], |p| p);
    let tissue = Tissue {
        law: Law::Guccione(Guccione {
            c_kpa: 2.0,
            b_f: 8.0,
            b_t: 2.0,
            b_fs: 4.0,
        }),
        volumetric: Volumetric {
            law: VolumetricLaw::LnSquared,
            kappa_kpa: 100.0,
        },
        active: Some(ActiveLaw::PAPER),
        // Next to no inertia, which would hide the instability.
        density: 1e-4,
    };
    let body = mesh.of_one_tissue(tissue);
    let n_points = body.n_point_batches() * BATCH;
    let end = PressureSurface::new(&mesh.sides[1], body.pattern()).expect("faces");
    let mut dynamics = Dynamics::new(
        body,
        Box::new(SingleProcess),
        GeneralisedAlpha::with_spectral_radius(0.0),
    );
    let held = |x: &[f64; 3]| x[0] < 1e-9 || (load == Load::Isometric && x[0] > 1.0 - 1e-9);
    dynamics.fixed = mesh
        .nodes
        .iter()
        .map(|x| [held(x), held(x), held(x)])
        .collect();
    dynamics.loads = vec![SurfaceLoad {
        surface: end,
        pressure_kpa: 0.0,
    }];
    let model = Land2017::new(Land2017Parameters::default()).expect("its own defaults");
    let mut rest = vec![0.0; model.n_states()];
    model.rest(&mut rest);
    let states = rest.repeat(n_points);
    let ones = vec![1.0; n_points];
    let mut cells = Cells {
        model,
        coupling,
        t_ms: 0.0,
        trial: states.clone(),
        states,
        before: ones.clone(),
        now: ones.clone(),
        next: ones,
    };
    let mut now: State = dynamics
        .start(vec![0.0; dynamics.body.reference().len()], vec![], 0.0)
        .expect("sound");
    let mut solver = Solver::new();
    let settings = StepSettings {
        relative_tolerance: 1e-7,
        linear: LinearSolver::Direct,
        keep_until: 3,
        max_iterations: 25,
        ..StepSettings::default()
    };
    let mut mean = vec![1.0];
    for k in 1..=(end_ms / dt_ms).round() as usize {
        cells.t_ms = k as f64 * dt_ms;
        if load == Load::Shortening {
            dynamics.loads[0].pressure_kpa = -0.5 * (cells.t_ms / 2.0).min(1.0);
        }
        let mut candidate = Candidate::default();
        dynamics
            .scheme
            .predict(dt_ms, &now.motion, &mut candidate.motion.u);
        let mut closure = Closure::Pressure(0.0);
        let done = step(
            &dynamics,
            &now,
            dt_ms,
            &mut candidate,
            &mut cells,
            &mut closure,
            &mut solver,
            &settings,
        );
        let Ok((force, _)) = done else { break };
        cells.commit();
        now = State {
            motion: candidate.motion,
            force,
            pressure_kpa: 0.0,
        };
        // One half of the cube is enough to see motion where its ends are held.
        mean.push(
            cells.now.iter().step_by(BATCH).step_by(2).sum::<f64>() / n_points as f64
                * (2 * BATCH) as f64,
        );
    }
    mean
}

/// The largest turn of the stretch from one step to the next, per step.
pub fn roughness(lambda: &[f64]) -> f64 {
    lambda
        .windows(3)
        .map(|w| (w[2] - 2.0 * w[1] + w[0]).abs())
        .fold(0.0, f64::max)
}
