//! Motion under prescribed loads, or equilibrium at full load.

use std::ops::ControlFlow;

use cardiotwin_linalg::parallel::SingleProcess;
use cardiotwin_models::contraction::ContractionError;

use super::problem::Setup;
use cardiotwin_mechanics::body::Deformation;
use cardiotwin_mechanics::dynamics::{Candidate, Dynamics, Rayleigh, State, Support, SurfaceLoad};
use cardiotwin_mechanics::element::BATCH;
use cardiotwin_mechanics::element::kernel::ActivePoint;
use cardiotwin_mechanics::statics::{LoadSteps, StaticError, StaticProblem, StaticReport, load};
use cardiotwin_mechanics::step::{Closure, PointStress, Solver, StepError, StepSettings, step};
use cardiotwin_mechanics::time_integration::GeneralisedAlpha;

/// Time steps and sampling of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Length of a time step \[ms\].
    pub dt_ms: f64,
    /// Time at which the run ends \[ms\].
    pub end_ms: f64,
    /// Number of steps between samples.
    pub sample_every: usize,
    /// Maximum number of halvings of a failing step.
    pub max_halvings: u32,
}

/// Displacements and volumes at an instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Time of the sample \[ms\].
    pub t_ms: f64,
    /// Displacement of each probe \[mm\].
    pub probes_mm: Vec<[f64; 3]>,
    /// Volume of each cavity \[mm³\].
    pub cavities_mm3: Vec<f64>,
}

/// Work of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RunCost {
    /// Number of steps taken.
    pub steps: usize,
    /// Number of steps that failed and were halved.
    pub n_cut: usize,
    /// Number of Newton iterations.
    pub newton_iterations: usize,
    /// Number of iterations of the linear solver.
    pub krylov_iterations: usize,
    /// Number of factorisations of the tangent.
    pub factorisations: usize,
}

/// Reasons why a run did not reach its end.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RunError {
    /// An element is inverted in the reference configuration.
    #[error(
        "element {element} of the reference configuration is inverted (volume ratio {volume_ratio:.3})"
    )]
    Start {
        /// Index of the element.
        element: usize,
        /// Volume ratio of the element.
        volume_ratio: f64,
    },
    /// The smallest step failed.
    #[error("no time step beyond {t_ms:.3} ms converged, not even one of {dt_ms:.1e} ms")]
    Step {
        /// Time that was reached \[ms\].
        t_ms: f64,
        /// Length of the step that failed \[ms\].
        dt_ms: f64,
        /// Failure of that step.
        source: StepError,
    },
}

struct Uniform {
    sa_kpa: f64,
    n: usize,
}

impl PointStress for Uniform {
    fn evaluate(
        &mut self,
        _: f64,
        _: &Deformation,
        out: &mut Vec<ActivePoint>,
    ) -> Result<(), ContractionError> {
        out.clear();
        if self.sa_kpa != 0.0 {
            out.resize(
                self.n,
                ActivePoint {
                    sa_kpa: [self.sa_kpa; BATCH],
                    slope_kpa: [0.0; BATCH],
                },
            );
        }
        Ok(())
    }
}

fn sample(setup: &SetupView<'_>, t_ms: f64, u: &[f64]) -> Sample {
    let probes_mm = (setup.probes.iter())
        .map(|nodes| {
            std::array::from_fn(|i| nodes.iter().map(|(n, w)| w * u[3 * *n as usize + i]).sum())
        })
        .collect();
    let cavities_mm3 = setup
        .cavities
        .iter()
        .map(|c| c.volume(&SingleProcess, setup.reference, u))
        .collect();
    Sample {
        t_ms,
        probes_mm,
        cavities_mm3,
    }
}

struct SetupView<'a> {
    probes: &'a [Vec<(u32, f64)>],
    cavities: &'a [cardiotwin_mechanics::boundary::Cavity],
    reference: &'a [f64],
}

/// Moves the body from rest in its stress-free reference configuration to the end of the schedule. `each` receives a sample at
/// time zero and after every [`Schedule::sample_every`] steps; [`ControlFlow::Break`] stops the run.
///
/// # Errors
/// [`RunError`] with the time reached.
pub fn run(
    setup: Setup,
    scheme: GeneralisedAlpha,
    damping: Rayleigh,
    schedule: &Schedule,
    settings: &StepSettings,
    each: &mut dyn FnMut(&Sample, &RunCost) -> ControlFlow<()>,
) -> Result<RunCost, RunError> {
    let Setup {
        body,
        supports,
        fixed,
        pressures,
        active,
        cavities,
        probes,
    } = setup;
    let n_points = body.n_point_batches();
    let (surfaces, courses): (Vec<_>, Vec<_>) = pressures.into_iter().unzip();
    let mut dynamics = Dynamics::new(body, Box::new(SingleProcess), scheme);
    dynamics.damping = damping;
    dynamics.fixed = fixed;
    dynamics.supports = supports
        .into_iter()
        .map(|(robin, spring, dashpot)| Support {
            robin,
            spring,
            dashpot,
            rest: vec![],
        })
        .collect();
    dynamics.loads = surfaces
        .into_iter()
        .zip(&courses)
        .map(|(surface, course)| SurfaceLoad {
            surface,
            pressure_kpa: course.at(0.0),
        })
        .collect();
    let mut stress = Uniform {
        sa_kpa: active.at(0.0),
        n: n_points,
    };
    let mut points = vec![];
    if stress.sa_kpa != 0.0 {
        points.resize(
            n_points,
            ActivePoint {
                sa_kpa: [stress.sa_kpa; BATCH],
                slope_kpa: [0.0; BATCH],
            },
        );
    }
    let mut now = dynamics
        .start(vec![0.0; dynamics.body.reference().len()], points, 0.0)
        .map_err(|s| RunError::Start {
            element: s.element,
            volume_ratio: s.volume_ratio,
        })?;
    let mut solver = Solver::new();
    let mut cost = RunCost::default();
    let view = |d: &Dynamics, t: f64, u: &[f64]| {
        sample(
            &SetupView {
                probes: &probes,
                cavities: &cavities,
                reference: d.body.reference(),
            },
            t,
            u,
        )
    };
    if each(&view(&dynamics, 0.0, &now.motion.u), &cost).is_break() {
        return Ok(cost);
    }
    let n_steps = (schedule.end_ms / schedule.dt_ms).round() as usize;
    for k in 1..=n_steps {
        let (start, end) = ((k - 1) as f64 * schedule.dt_ms, k as f64 * schedule.dt_ms);
        let (mut t, mut halvings) = (start, 0);
        while t < end - 1e-9 * schedule.dt_ms {
            let dt = (schedule.dt_ms / f64::from(1_u32 << halvings)).min(end - t);
            for (load, course) in dynamics.loads.iter_mut().zip(&courses) {
                load.pressure_kpa = course.at(t + dt);
            }
            stress.sa_kpa = active.at(t + dt);
            let mut candidate = Candidate::default();
            dynamics
                .scheme
                .predict(dt, &now.motion, &mut candidate.motion.u);
            let mut closure = Closure::Pressure(0.0);
            match step(
                &dynamics,
                &now,
                dt,
                &mut candidate,
                &mut stress,
                &mut closure,
                &mut solver,
                settings,
            ) {
                Ok((force, report)) => {
                    cost.steps += 1;
                    cost.newton_iterations += report.iterations;
                    cost.krylov_iterations += report.krylov_iterations;
                    cost.factorisations += report.factorisations;
                    now = State {
                        motion: candidate.motion,
                        force,
                        pressure_kpa: 0.0,
                    };
                    t += dt;
                }
                Err(source) => {
                    cost.n_cut += 1;
                    if halvings >= schedule.max_halvings {
                        return Err(RunError::Step {
                            t_ms: t,
                            dt_ms: dt,
                            source,
                        });
                    }
                    halvings += 1;
                    solver.forget();
                }
            }
        }
        if k % schedule.sample_every == 0
            && each(&view(&dynamics, end, &now.motion.u), &cost).is_break()
        {
            return Ok(cost);
        }
    }
    Ok(cost)
}

/// Solves for equilibrium at the loads of `end_ms`, which grow together from zero.
///
/// # Errors
/// [`StaticError`] with the share of the load reached.
pub fn settle(
    setup: &Setup,
    end_ms: f64,
    steps: &LoadSteps,
) -> Result<(Sample, StaticReport), StaticError> {
    let sa = setup.active.at(end_ms);
    let point = ActivePoint {
        sa_kpa: [sa; BATCH],
        slope_kpa: [0.0; BATCH],
    };
    let problem = StaticProblem {
        body: &setup.body,
        comm: &SingleProcess,
        pressures: setup
            .pressures
            .iter()
            .map(|(s, course)| (s.clone(), course.at(end_ms)))
            .collect(),
        springs: setup
            .supports
            .iter()
            .map(|(robin, spring, _)| (robin.clone(), *spring))
            .collect(),
        fixed: if setup.fixed.is_empty() {
            vec![[false; 3]; setup.body.n_nodes()]
        } else {
            setup.fixed.clone()
        },
        prescribed: vec![],
        active: if sa == 0.0 {
            vec![]
        } else {
            vec![point; setup.body.n_point_batches()]
        },
    };
    let mut u = vec![0.0; setup.body.reference().len()];
    let report = load(&problem, &mut u, steps)?;
    let view = SetupView {
        probes: &setup.probes,
        cavities: &setup.cavities,
        reference: setup.body.reference(),
    };
    Ok((sample(&view, end_ms, &u), report))
}
