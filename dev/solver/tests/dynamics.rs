//! Bodies in motion: order in time, tangent, energy, and the step that finds displacement and pressure together.

#[path = "../verification/mod.rs"]
mod verification;

use cardiotwin_linalg::Operator as _;
use cardiotwin_mechanics::dynamics::{Candidate, Dynamics, Rayleigh, State};
use cardiotwin_mechanics::element::kernel::ActivePoint;
use cardiotwin_mechanics::material::{ActiveConvention, ActiveLaw};
use cardiotwin_mechanics::newton::LinearSolver;
use cardiotwin_mechanics::step::{Closure, Passive, Solver, StepSettings, step};
use verification::motion::{at_rest, block, block_of_muscle, errors_in_time, run};

#[test]
fn motion_is_of_second_order_in_time() {
    for rho in [0.0, 0.5] {
        let errors = errors_in_time(rho, &[32, 64]);
        let order = (errors[0] / errors[1]).log2();
        assert!(
            order > 1.8 && errors[0] > 1e-8,
            "rho {rho}: order {order} ({errors:?})"
        );
    }
}

#[test]
fn tangent_is_the_slope_of_the_residual_in_displacement_and_pressure() {
    let mut dynamics = block(
        0.3,
        Rayleigh {
            mass_per_ms: 0.2,
            stiffness_ms: 0.3,
        },
        3.0,
    );
    dynamics.supports[0].rest = vec![0.1; dynamics.body.reference().len()];
    let n = dynamics.body.reference().len();
    let wave = |s: f64, size: f64| {
        (0..n)
            .map(|k| size * (s * k as f64).sin())
            .collect::<Vec<f64>>()
    };
    let mut now = at_rest(&dynamics);
    (now.motion.u, now.motion.v, now.motion.a) = (wave(0.3, 0.1), wave(0.7, 0.05), wave(1.1, 0.02));
    let (dt, u, d) = (1.3, wave(0.31, 0.12), wave(1.9, 1.0));
    let at = |h: f64, p: f64| {
        let mut c = Candidate {
            pressure_kpa: p,
            ..Candidate::default()
        };
        c.motion.u = u.iter().zip(&d).map(|(u, d)| u + h * d).collect();
        assert!(dynamics.complete(dt, &now, &mut c).volume_ratio > 0.3);
        let (mut force, mut r) = (vec![0.0; n], vec![0.0; n]);
        dynamics.residual(&now, &c, &mut force, &mut r);
        (c, r)
    };
    let (candidate, residual) = at(0.0, 0.0);
    let (mut force, mut r, mut got) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut tangent = dynamics.body.new_tangent();
    dynamics.linearise(dt, &now, &candidate, &mut force, &mut r, &mut tangent);
    assert!(
        r.iter()
            .zip(&residual)
            .all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + b.abs()))
    );
    tangent.multiply(dynamics.space(), &mut d.clone(), &mut got);
    let (plus, minus) = (at(1e-6, 0.0).1, at(-1e-6, 0.0).1);
    let scale = got.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    for k in 0..n {
        let slope = (plus[k] - minus[k]) / 2e-6;
        assert!(
            (got[k] - slope).abs() < 1e-6 * scale,
            "{k}: {} {slope}",
            got[k]
        );
    }
    let mut column = vec![];
    dynamics.pressure_column(&candidate, &mut column);
    let higher = at(0.0, 2.0).1;
    let weight = 1.0 - dynamics.scheme.alpha_f;
    for k in 0..n {
        assert!((higher[k] - residual[k] - 2.0 * weight * column[k]).abs() < 1e-9);
    }
}

/// Tension that grows with stretch, as that of cells does, and its slope \[kPa\].
fn tension(squared_stretch: f64) -> (f64, f64) {
    let lambda = squared_stretch.sqrt();
    (20.0 + 90.0 * (lambda - 1.0), 90.0)
}

/// The largest difference between tangent and central differences of the residual, over the largest entry of the tangent's
/// product, for muscle of this convention in motion: displacement, velocity and acceleration are `wave`s of these sizes. Next to it
/// the largest strain of the damping's time, to first order: the difference of two velocities over a cell's edge, times τ.
fn error_of_the_active_tangent(
    convention: ActiveConvention,
    wave: impl Fn(f64, f64) -> Vec<f64>,
) -> (f64, f64) {
    let law = ActiveLaw {
        convention,
        cross_fibre: 0.0,
        sheet_normal: 0.0,
    };
    let dynamics = block_of_muscle(
        0.3,
        Rayleigh {
            mass_per_ms: 0.2,
            stiffness_ms: 0.3,
        },
        3.0,
        Some(law),
    );
    let n = dynamics.body.reference().len();
    let mut now = at_rest(&dynamics);
    (now.motion.u, now.motion.v, now.motion.a) = (wave(0.3, 0.1), wave(0.7, 0.05), wave(1.1, 0.02));
    let (dt, u) = (1.3, wave(0.31, 0.12));
    let d: Vec<f64> = (0..n).map(|k| (1.9 * k as f64).sin()).collect();
    let at = |h: f64| {
        let mut c = Candidate::default();
        c.motion.u = u.iter().zip(&d).map(|(u, d)| u + h * d).collect();
        assert!(dynamics.complete(dt, &now, &mut c).volume_ratio > 0.3);
        c.active = (c.deformation.squared_stretch.iter())
            .map(|squared| {
                let [sa_kpa, slope_kpa] = [|t: (f64, f64)| t.0, |t: (f64, f64)| t.1]
                    .map(|of| squared.map(|c| of(tension(c))));
                ActivePoint { sa_kpa, slope_kpa }
            })
            .collect();
        let (mut force, mut r) = (vec![0.0; n], vec![0.0; n]);
        dynamics.residual(&now, &c, &mut force, &mut r);
        (c, r)
    };
    let (candidate, _) = at(0.0);
    let (mut force, mut r, mut got) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut tangent = dynamics.body.new_tangent();
    dynamics.linearise(dt, &now, &candidate, &mut force, &mut r, &mut tangent);
    tangent.multiply(dynamics.space(), &mut d.clone(), &mut got);
    let (plus, minus) = (at(1e-6).1, at(-1e-6).1);
    let scale = got.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    let v = &candidate.motion.v;
    let (least, most) = v
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
    let error = (0..n)
        .map(|k| (got[k] - (plus[k] - minus[k]) / 2e-6).abs() / scale)
        .fold(0.0, f64::max);
    (
        error,
        dynamics.damping.stiffness_ms * (most - least) / (10.0 / 3.0),
    )
}

#[test]
fn the_tangent_holds_what_tension_answers_to_the_true_stretch() {
    for convention in [
        ActiveConvention::SecondPiola,
        ActiveConvention::FirstPiola,
        ActiveConvention::PerSquaredStretch,
    ] {
        // Motion along the fibre alone turns none: the tangent is exact.
        let along = |s: f64, size: f64| {
            (0..192)
                .map(|k| {
                    if k % 3 == 0 {
                        size * (s * f64::from(k / 48)).sin()
                    } else {
                        0.0
                    }
                })
                .collect::<Vec<f64>>()
        };
        let (exact, _) = error_of_the_active_tangent(convention, along);
        assert!(exact < 1e-6, "{convention:?}: {exact:e}");
        // Any motion: off by the angle that fibres turn by in the damping's time.
        let any = |s: f64, size: f64| {
            (0..192)
                .map(|k| size * (s * f64::from(k)).sin())
                .collect::<Vec<f64>>()
        };
        let (near, strain) = error_of_the_active_tangent(convention, any);
        assert!(
            near < strain && strain < 0.05,
            "{convention:?}: {near:e} at a strain of {strain:e}"
        );
    }
}

#[test]
fn cells_see_the_stretch_of_the_displacement_and_tissue_that_of_the_damped_motion() {
    let dynamics = block_of_muscle(
        0.3,
        Rayleigh {
            mass_per_ms: 0.0,
            stiffness_ms: 0.5,
        },
        0.0,
        Some(ActiveLaw::PAPER),
    );
    let reference = dynamics.body.reference().to_vec();
    let stretched = |by: f64| -> Vec<f64> {
        reference
            .iter()
            .enumerate()
            .map(|(k, x)| if k % 3 == 0 { by * x } else { 0.0 })
            .collect()
    };
    let mut now = at_rest(&dynamics);
    (now.motion.u, now.motion.v) = (stretched(0.02), stretched(0.01));
    let mut candidate = Candidate::default();
    candidate.motion.u = stretched(0.03);
    dynamics.complete(1.0, &now, &mut candidate);
    let rate = (candidate
        .motion
        .v
        .iter()
        .step_by(3)
        .zip(reference.iter().step_by(3)))
    .find(|(_, x)| **x > 5.0)
    .map(|(v, x)| v / x)
    .expect("a node");
    assert!(rate > 0.005, "{rate}");
    let Candidate { deformation, .. } = &candidate;
    for (squared, ratio) in deformation
        .squared_stretch
        .iter()
        .flatten()
        .zip(deformation.volume_ratio.iter().flatten())
    {
        assert!((squared.sqrt() - 1.03).abs() < 1e-12, "{squared}");
        assert!((ratio - 1.03 - 0.5 * rate).abs() < 1e-9, "{ratio}");
    }
}

/// Kinetic, strain and spring energy.
fn energy(dynamics: &Dynamics, state: &State) -> f64 {
    let kinetic: f64 = (dynamics.masses().iter().enumerate())
        .map(|(n, m)| {
            0.5 * m
                * state.motion.v[3 * n..3 * n + 3]
                    .iter()
                    .map(|v| v * v)
                    .sum::<f64>()
        })
        .sum();
    let mut spring = vec![0.0; state.motion.u.len()];
    for s in &dynamics.supports {
        s.robin
            .add_forces(0.5 * s.spring, &state.motion.u, &mut spring);
    }
    let stored: f64 = spring.iter().zip(&state.motion.u).map(|(f, u)| f * u).sum();
    kinetic + stored + dynamics.body.strain_energy(&state.motion.u)
}

#[test]
fn energy_stays_without_damping_and_work_is_stored_or_dissipated_with_it() {
    // Undamped and at spectral radius one the energy of free vibration returns.
    let free = block(1.0, Rayleigh::NONE, 0.0);
    let mut start = at_rest(&free);
    for v in start.motion.v.iter_mut().skip(2).step_by(3) {
        *v = 0.05;
    }
    let states = run(&free, 60, 30.0, |_| 0.0, start);
    let first = energy(&free, &states[0]);
    for (k, s) in states.iter().enumerate() {
        assert!(
            (energy(&free, s) / first - 1.0).abs() < 0.01,
            "step {k}: {} of {first}",
            energy(&free, s)
        );
    }
    // Damped: the work of the pressure is stored or dissipated; here by dashpots alone, whose power is known.
    let damped = block(
        1.0,
        Rayleigh {
            mass_per_ms: 0.05,
            stiffness_ms: 0.0,
        },
        5.0,
    );
    let pulse = |t: f64| 0.5 * (std::f64::consts::PI * t / 20.0).sin().powi(2);
    let states = run(&damped, 200, 20.0, pulse, at_rest(&damped));
    let (mut work, mut lost) = (0.0, 0.0);
    for pair in states.windows(2) {
        let dt = 0.1;
        let power = |s: &State| {
            let n = s.motion.u.len();
            let (mut push, mut brake) = (vec![0.0; n], vec![0.0; n]);
            damped.cavity.as_ref().expect("made").add_forces(
                damped.comm.as_ref(),
                s.pressure_kpa,
                damped.body.reference(),
                &s.motion.u,
                &mut push,
            );
            damped.supports[0].robin.add_forces(
                damped.supports[0].dashpot,
                &s.motion.v,
                &mut brake,
            );
            for (node, m) in damped.masses().iter().enumerate() {
                (3 * node..3 * node + 3).for_each(|i| brake[i] += 0.05 * m * s.motion.v[i]);
            }
            let along = |f: &[f64]| f.iter().zip(&s.motion.v).map(|(f, v)| f * v).sum::<f64>();
            (-along(&push), along(&brake))
        };
        let ((w0, l0), (w1, l1)) = (power(&pair[0]), power(&pair[1]));
        work += 0.5 * dt * (w0 + w1);
        lost += 0.5 * dt * (l0 + l1);
    }
    let stored = energy(&damped, states.last().expect("the last"));
    assert!(lost > 0.0 && work > 0.0);
    assert!(
        (work - stored - lost).abs() < 0.01 * work,
        "work {work}, stored {stored}, dissipated {lost}"
    );
}

#[test]
fn a_step_finds_the_pressure_for_a_volume_with_every_linear_solver() {
    let dynamics = block(
        0.0,
        Rayleigh {
            mass_per_ms: 0.1,
            stiffness_ms: 0.1,
        },
        3.0,
    );
    let now = at_rest(&dynamics);
    let volume = dynamics.cavity_volume(&now.motion.u);
    let mut found = vec![];
    for linear in [
        LinearSolver::BlockJacobi,
        LinearSolver::SymmetricSweep,
        LinearSolver::Direct,
    ] {
        let settings = StepSettings {
            linear,
            relative_tolerance: 1e-9,
            volume_tolerance_mm3: 1e-7,
            ..StepSettings::default()
        };
        let mut candidate = Candidate::default();
        dynamics
            .scheme
            .predict(1.0, &now.motion, &mut candidate.motion.u);
        // A kink as a valve has it: above 0.2 kPa much less volume is left.
        let mut balance = |p: f64| {
            let below = (volume + 30.0 - 5.0 * p, -5.0);
            Ok(if p < 0.2 {
                below
            } else {
                (below.0 - 4000.0 * (p - 0.2), -4005.0)
            })
        };
        let mut solver = Solver::new();
        let (_, report) = step(
            &dynamics,
            &now,
            1.0,
            &mut candidate,
            &mut Passive,
            &mut Closure::Balance(&mut balance),
            &mut solver,
            &settings,
        )
        .expect("a step");
        assert!(report.iterations <= 6, "{linear:?}: {report:?}");
        let left = balance(candidate.pressure_kpa).expect("a volume").0;
        assert!(
            (dynamics.cavity_volume(&candidate.motion.u) - left).abs() < 1e-6,
            "{linear:?}"
        );
        found.push(candidate.pressure_kpa);
    }
    assert!(found[0] > 0.2, "beyond the kink: {found:?}");
    assert!(
        found.iter().all(|p| (p - found[0]).abs() < 1e-6),
        "{found:?}"
    );
}
