//! A block in motion under a pulse of pressure: what shows the order of the time integration.

use cardiotwin_linalg::parallel::SingleProcess;
use cardiotwin_mechanics::boundary::{Cavity, Robin, RobinDirection};
use cardiotwin_mechanics::dynamics::{Candidate, Dynamics, Rayleigh, State, Support};
use cardiotwin_mechanics::material::{ActiveLaw, Guccione, Law, Tissue, Volumetric, VolumetricLaw};
use cardiotwin_mechanics::step::{Closure, Passive, Solver, StepSettings, step};
use cardiotwin_mechanics::time_integration::GeneralisedAlpha;

use super::meshes::cuboid;

/// A block of 10 mm on springs and dashpots below, open "cavity" above: pressure pushes on its top.
pub fn block(rho: f64, damping: Rayleigh, dashpot: f64) -> Dynamics {
    block_of_muscle(rho, damping, dashpot, None)
}

/// The same of tissue that contracts along x.
pub fn block_of_muscle(
    rho: f64,
    damping: Rayleigh,
    dashpot: f64,
    active: Option<ActiveLaw>,
) -> Dynamics {
    let mesh = cuboid([3, 3, 3], |p| p.map(|x| 10.0 * x));
    let tissue = Tissue {
        law: Law::Guccione(Guccione::guccione1995(2.0)),
        volumetric: Volumetric {
            law: VolumetricLaw::LnSquared,
            kappa_kpa: 50.0,
        },
        active,
        density: 1.06,
    };
    let body = mesh.of_one_tissue(tissue);
    let robin = Robin::new(
        &mesh.sides[4],
        RobinDirection::All,
        body.reference(),
        body.pattern(),
    )
    .expect("faces");
    let cavity = Cavity::new(
        &mesh.sides[5],
        vec![],
        &[],
        body.reference(),
        body.pattern(),
        &SingleProcess,
    )
    .expect("faces");
    let mut dynamics = Dynamics::new(
        body,
        Box::new(SingleProcess),
        GeneralisedAlpha::with_spectral_radius(rho),
    );
    dynamics.damping = damping;
    dynamics.supports = vec![Support {
        robin,
        spring: 2.0,
        dashpot,
        rest: vec![],
    }];
    dynamics.cavity = Some(cavity);
    dynamics
}

pub fn at_rest(dynamics: &Dynamics) -> State {
    dynamics
        .start(vec![0.0; dynamics.body.reference().len()], vec![], 0.0)
        .expect("a sound body")
}

pub fn tight() -> StepSettings {
    StepSettings {
        relative_tolerance: 1e-11,
        least_pressure_kpa: 0.1,
        ..StepSettings::default()
    }
}

/// The states at the ends of `n` steps to `end_ms` under a pressure in time, the start first.
pub fn run(
    dynamics: &Dynamics,
    n: usize,
    end_ms: f64,
    pressure: impl Fn(f64) -> f64,
    now: State,
) -> Vec<State> {
    let dt = end_ms / n as f64;
    let mut solver = Solver::new();
    let mut states = vec![now];
    for k in 1..=n {
        let now = &states[k - 1];
        let mut candidate = Candidate::default();
        dynamics
            .scheme
            .predict(dt, &now.motion, &mut candidate.motion.u);
        let mut closure = Closure::Pressure(pressure(k as f64 * dt));
        let (force, _) = step(
            dynamics,
            now,
            dt,
            &mut candidate,
            &mut Passive,
            &mut closure,
            &mut solver,
            &tight(),
        )
        .expect("a step");
        let pressure_kpa = candidate.pressure_kpa;
        states.push(State {
            motion: candidate.motion,
            force,
            pressure_kpa,
        });
    }
    states
}

/// Distances of the displacement after 8 ms, in steps of `8 / n` ms for each `n`, from that in 512 steps \[mm\].
pub fn errors_in_time(rho: f64, steps: &[usize]) -> Vec<f64> {
    let dynamics = block(
        rho,
        Rayleigh {
            mass_per_ms: 0.1,
            stiffness_ms: 0.1,
        },
        3.0,
    );
    let pulse = |t: f64| 0.5 * (std::f64::consts::PI * t / 16.0).sin().powi(4);
    let last = |n: usize| {
        run(&dynamics, n, 8.0, pulse, at_rest(&dynamics))
            .pop()
            .expect("the last")
            .motion
            .u
    };
    let finest = last(512);
    let error = |n: usize| {
        last(n)
            .iter()
            .zip(&finest)
            .map(|(a, b)| (a - b).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    steps.iter().map(|n| error(*n)).collect()
}
