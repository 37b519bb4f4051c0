//! Bodies under prescribed loads: viscosity, and the balance of energy over a beat.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_mechanics::body::{Body, BodyInput, Deformation};
use cardiotwin_mechanics::boundary::{PressureSurface, Robin, RobinDirection};
use cardiotwin_mechanics::dynamics::{Candidate, Dynamics, State, Support, SurfaceLoad};
use cardiotwin_mechanics::element::kernel::{ActivePoint, VolumeChange};
use cardiotwin_mechanics::material::{ActiveLaw, HolzapfelOgden, Law, Tissue, Volumetric, VolumetricLaw};
use cardiotwin_mechanics::parallel::{Layout, SingleProcess, Space};
use cardiotwin_mechanics::prescribed::{Course, TimeCourse};
use cardiotwin_mechanics::step::{Closure, Passive, Solver, StepSettings, step};
use cardiotwin_mechanics::time_integration::GeneralisedAlpha;
use verification::meshes::{Mesh, cuboid};

const ETA_KPA_MS: f64 = 100.0;

/// A block of 10 mm of the benchmark's myocardium.
fn body(viscosity: f64) -> (Mesh, Body) {
    let mesh = cuboid([2, 2, 2], |p| p.map(|x| 10.0 * x));
    let tissue = Tissue {
        law: Law::HolzapfelOgden(HolzapfelOgden::arostica2025()),
        volumetric: Volumetric { law: VolumetricLaw::QuadraticLn, kappa_kpa: 1000.0 },
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
        volume: VolumeChange::Nodal { pointwise_share: 0.05 },
        layout: Layout::whole(mesh.nodes.len()),
    };
    let mut body = Body::linear(&input, &SingleProcess).expect("a proper mesh");
    body.set_viscosity(vec![viscosity]).expect("a viscosity");
    (mesh, body)
}

fn deform(body: &Body, u: &[f64]) -> Deformation {
    let mut deformation = Deformation::default();
    body.deform(u, &SingleProcess, &mut deformation);
    deformation
}

#[test]
fn viscous_power_is_viscosity_times_the_squared_rate_of_strain_and_its_tangent_is_exact_at_rest() {
    let (mesh, body) = body(ETA_KPA_MS);
    let n = 3 * mesh.nodes.len();
    // A homogeneous F and rate of F: Ė = sym(Fᵀ Ḟ).
    let f = [[1.1, 0.05, 0.0], [0.0, 0.95, 0.1], [0.02, 0.0, 0.97]];
    let rate = [[0.01, 0.02, 0.0], [0.005, -0.01, 0.003], [0.0, 0.004, 0.006]];
    let field = |a: &[[f64; 3]; 3], minus: f64| -> Vec<f64> {
        mesh.nodes
            .iter()
            .flat_map(|x| {
                let moved: [f64; 3] =
                    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * x[k]).sum::<f64>() - minus * x[i]);
                moved
            })
            .collect()
    };
    let (u, v) = (field(&f, 1.0), field(&rate, 0.0));
    let deformation = deform(&body, &u);
    let (mut still, mut moving) = (vec![0.0; n], vec![0.0; n]);
    body.add_forces(&u, &[], &deformation, &mut still);
    body.add_forces_in_motion(&u, &v, &[], &deformation, &mut moving);
    let power: f64 = (0..n).map(|k| (moving[k] - still[k]) * v[k]).sum();
    let squared: f64 = (0..3)
        .flat_map(|m| (0..3).map(move |k| (m, k)))
        .map(|(m, k)| (0..3).map(|i| 0.5 * (f[i][m] * rate[i][k] + f[i][k] * rate[i][m])).sum::<f64>().powi(2))
        .sum();
    assert!((power / (ETA_KPA_MS * squared * 1000.0) - 1.0).abs() < 1e-10, "{power}");

    let velocity_rate = 1.7;
    let mut tangent = body.new_tangent();
    let mut force = vec![0.0; n];
    let zero = vec![0.0; n];
    body.tangent_in_motion(&u, (&zero, velocity_rate), &[], &deformation, &mut force, &mut tangent);
    let mut d: Vec<f64> = (0..n).map(|k| (1.3 * k as f64).sin()).collect();
    let mut got = vec![0.0; n];
    tangent.multiply(Space { comm: &SingleProcess, layout: body.layout() }, &mut d, &mut got);
    let at = |h: f64| {
        let shifted: Vec<f64> = u.iter().zip(&d).map(|(u, d)| u + h * d).collect();
        let v: Vec<f64> = d.iter().map(|d| h * velocity_rate * d).collect();
        let mut out = vec![0.0; n];
        body.add_forces_in_motion(&shifted, &v, &[], &deform(&body, &shifted), &mut out);
        out
    };
    let (plus, minus) = (at(1e-6), at(-1e-6));
    let scale = got.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    for k in 0..n {
        assert!((got[k] - (plus[k] - minus[k]) / 2e-6).abs() < 1e-6 * scale, "{k}");
    }
    assert!(body_error().contains("viscosity_kPa_ms = -1"), "{}", body_error());
}

fn body_error() -> String {
    let error = body(0.0).1.set_viscosity(vec![-1.0]).expect_err("a negative viscosity");
    format!("{error}: {}", std::error::Error::source(&error).expect("the parameter"))
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
    dynamics.body.add_forces(u, &[], &deformation, &mut internal[0]);
    dynamics.body.add_forces(u, active, &deformation, &mut internal[1]);
    dynamics.body.add_forces_in_motion(u, v, &[], &deformation, &mut internal[2]);
    let passive = along(&internal[0]);
    let mut push = vec![0.0; n];
    for load in &dynamics.loads {
        load.surface.add_forces(load.pressure_kpa, dynamics.body.reference(), u, &mut push);
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

#[test]
fn over_a_beat_the_work_of_muscle_and_pressure_is_stored_or_dissipated_within_half_a_per_cent() {
    let (mesh, body) = body(ETA_KPA_MS);
    let all = |side: usize| {
        let robin =
            Robin::new(&mesh.sides[side], RobinDirection::All, body.reference(), body.pattern()).expect("faces");
        Support { robin, spring: 2.0, dashpot: 5.0, rest: vec![] }
    };
    let supports = vec![all(4)];
    let surface = PressureSurface::new(&mesh.sides[5], body.pattern()).expect("faces");
    let n_points = body.n_point_batches();
    let scheme = GeneralisedAlpha::with_weights(0.2, 0.4).expect("the benchmark's");
    let mut dynamics = Dynamics::new(body, Box::new(SingleProcess), scheme);
    dynamics.supports = supports;
    dynamics.loads = vec![SurfaceLoad { surface, pressure_kpa: 0.0 }];
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
    let points = |t: f64| vec![ActivePoint { sa_kpa: [stress.at(t); 8], slope_kpa: [0.0; 8] }; n_points];
    struct Given(Vec<ActivePoint>);
    impl cardiotwin_mechanics::step::PointStress for Given {
        fn evaluate(
            &mut self,
            dt_ms: f64,
            deformation: &Deformation,
            out: &mut Vec<ActivePoint>,
        ) -> Result<(), cardiotwin_models::contraction::ContractionError> {
            Passive.evaluate(dt_ms, deformation, out)?;
            out.extend_from_slice(&self.0);
            Ok(())
        }
    }
    let settings = StepSettings { relative_tolerance: 1e-8, max_iterations: 20, ..StepSettings::default() };
    let mut now = dynamics.start(vec![0.0; dynamics.body.reference().len()], vec![], 0.0).expect("sound");
    let mut solver = Solver::new(&dynamics);
    let (mut work, mut muscle_work, mut lost, mut turned_over) = (0.0, 0.0, 0.0, 0.0);
    let dt = 1.0;
    let mut last = powers(&dynamics, &now, &points(0.0));
    for k in 1..=end_ms as usize {
        let t = k as f64 * dt;
        dynamics.loads[0].pressure_kpa = pressure.at(t);
        let mut given = Given(points(t));
        let mut candidate = Candidate::default();
        dynamics.scheme.predict(dt, &now.motion, &mut candidate.motion.u);
        let mut closure = Closure::Pressure(0.0);
        let (force, _) = step(&dynamics, &now, dt, &mut candidate, &mut given, &mut closure, &mut solver, &settings)
            .expect("a step");
        now = State { motion: candidate.motion, force, pressure_kpa: 0.0 };
        let next = powers(&dynamics, &now, &given.0);
        let mean = |a: f64, b: f64| 0.5 * dt * (a + b);
        work += mean(last.pressure, next.pressure);
        muscle_work += mean(last.muscle, next.muscle);
        lost += mean(last.lost, next.lost);
        turned_over += mean(last.pressure.abs() + last.muscle.abs(), next.pressure.abs() + next.muscle.abs());
        last = next;
        let gap = work + muscle_work - lost - last.stored;
        assert!(gap.abs() < 0.005 * turned_over.max(10.0), "{t} ms: {gap} of {turned_over}");
    }
    println!(
        "pressure {work:.2}, muscle {muscle_work:.2}, dissipated {lost:.2}, stored {:.2}, {turned_over:.1}",
        last.stored
    );
    assert!(muscle_work > 0.0 && lost > 0.1 * turned_over, "{muscle_work} {lost} {turned_over}");
}
