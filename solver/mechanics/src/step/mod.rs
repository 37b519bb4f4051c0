//! One time step, solved for displacement and cavity pressure together.
//!
//! Newton's method solves the bordered system of momentum `r(u, p) = 0` and volume balance `V(u) = W(p)`, where `W` is the
//! volume that the circulation leaves in the cavity at pressure `p`. Each iteration solves `K x = r` and `K y = q`. Along `u −
//! x − y Δp` the volume is linear, and a bracketed Newton method solves the scalar balance exactly, kinks of the valves
//! included, so that valves that change state cannot make the iteration cycle.

mod recent;
mod solver;

use std::ops::ControlFlow;

use cardiotwin_linalg::parallel::{Communicator, Disagreement, VectorLayout, agree};
use cardiotwin_linalg::{DirectError, KrylovSettings};
use cardiotwin_models::circulation::CirculationError;
use cardiotwin_models::contraction::ContractionError;

use crate::body::Deformation;
use crate::dynamics::{Candidate, Dynamics, State, add_times};
use crate::element::kernel::ActivePoint;
use crate::newton::{LinearSolver, Smallest};
pub use solver::Solver;

/// Active stress at the integration points for a candidate deformation.
pub trait PointStress {
    /// Overwrites `out` with stress and slope of each point batch at the end of a step of `dt_ms`; leaves it empty for no
    /// stress.
    ///
    /// # Errors
    /// [`ContractionError`] of the first point that fails.
    fn evaluate(
        &mut self,
        dt_ms: f64,
        deformation: &Deformation,
        out: &mut Vec<ActivePoint>,
    ) -> Result<(), ContractionError>;
}

/// A body without active stress.
#[derive(Debug, Clone, Copy)]
pub struct Passive;

impl PointStress for Passive {
    fn evaluate(
        &mut self,
        _: f64,
        _: &Deformation,
        out: &mut Vec<ActivePoint>,
    ) -> Result<(), ContractionError> {
        out.clear();
        Ok(())
    }
}

/// Maps the cavity pressure at the step's end \[kPa\] to the remaining volume \[mm³\] and its slope, which is never positive.
pub type Balance<'a> = dyn FnMut(f64) -> Result<(f64, f64), CirculationError> + 'a;

/// Condition that determines the pressure at the step's end.
pub enum Closure<'a> {
    /// A prescribed pressure \[kPa\].
    Pressure(f64),
    /// The balance with the circulation.
    Balance(&'a mut Balance<'a>),
    /// The balance with the circulation on rank 0; for the other ranks.
    BalanceOfRank0,
}

impl Closure<'_> {
    /// Evaluates the circulation on rank 0 for all ranks; `None` for a prescribed pressure. Collective.
    fn ask(
        &mut self,
        comm: &dyn Communicator,
        work: impl FnOnce(&mut Balance<'_>) -> Result<f64, StepError>,
    ) -> Result<Option<f64>, StepError> {
        let own = match self {
            Closure::Pressure(_) => return Ok(None),
            Closure::Balance(balance) => Some(work(&mut **balance)),
            Closure::BalanceOfRank0 => None,
        };
        let mut word = match own {
            Some(Ok(value)) => [1.0, value],
            _ => [0.0; 2],
        };
        comm.broadcast(&mut word);
        match own {
            Some(result) => result.map(Some),
            None if word[0] == 1.0 => Ok(Some(word[1])),
            None => Err(StepError::Elsewhere {
                reason: "rank 0: circulation".to_owned(),
            }),
        }
    }
}

/// Settings of a time step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepSettings {
    /// Tolerance of the residual, relative to the scale of the forces.
    pub relative_tolerance: f64,
    /// Smallest scale of the forces, as a pressure on the endocardium \[kPa\]; it sets the scale at rest.
    pub least_pressure_kpa: f64,
    /// Tolerance of the volume balance \[mm³\].
    pub volume_tolerance_mm3: f64,
    /// Maximum number of Newton iterations.
    pub max_iterations: usize,
    /// Maximum number of halvings of an iteration's step.
    pub max_halvings: usize,
    /// Smallest volume ratio of an element; an iteration's step that goes below it is halved.
    pub smallest_volume_ratio: f64,
    /// Growth of the residual beyond which an iteration's step is halved. Growth is normal: with stiff volume change an early
    /// residual can be thirty times the first one, and Newton's method still converges.
    pub largest_growth: f64,
    /// Largest displacement of a node in an iteration \[mm\]: exponential laws amplify the error of a longer one.
    pub farthest_mm: f64,
    /// Whether the tangent uses the nodal pressures predicted by the last iteration rather than those of the current volumes. A
    /// second-order volume error acts as a pressure larger than the stiffness of a soft material and spoils the tangent. This
    /// is Newton's method of the mixed form, for long steps.
    ///
    /// Source: Magisano, Leonetti and Garcea 2017, Int J Numer Methods Eng 109:1237.
    pub mixed_newton: bool,
    /// Whether a beat's step starts from an extrapolation of motion and pressure rather than from the last step's end.
    pub extrapolate: bool,
    /// Number of recent steps' corrections whose combination is tried before anything is solved.
    pub kept_corrections: usize,
    /// Solver of the linear systems.
    pub linear: LinearSolver,
    /// Limits of the Krylov method; its tolerance follows from the residual.
    pub krylov: KrylovSettings,
    /// Iterations of a solve beyond which a factorisation or set-up is renewed.
    pub keep_until: usize,
}

impl Default for StepSettings {
    fn default() -> Self {
        Self {
            relative_tolerance: 1e-4,
            least_pressure_kpa: 0.5,
            volume_tolerance_mm3: 1e-2,
            max_iterations: 12,
            max_halvings: 4,
            smallest_volume_ratio: 0.1,
            largest_growth: f64::INFINITY,
            farthest_mm: f64::INFINITY,
            mixed_newton: false,
            extrapolate: true,
            kept_corrections: 8,
            linear: LinearSolver::RigidLevels,
            krylov: KrylovSettings::default(),
            keep_until: 12,
        }
    }
}

/// Work and final residuals of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepReport {
    /// Number of Newton iterations.
    pub iterations: usize,
    /// Number of Krylov iterations for both right-hand sides.
    pub krylov_iterations: usize,
    /// Number of factorisations of the tangent.
    pub factorisations: usize,
    /// Final residual relative to the scale of the forces.
    pub relative_residual: f64,
    /// Final error of the volume balance \[mm³\].
    pub volume_residual_mm3: f64,
}

/// Reasons why a step failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// Newton's method did not converge.
    #[error(
        "Newton's method did not converge in {iterations} iterations: relative residual {relative_residual:.1e}, \
         volume balance {volume_residual_mm3:.1e} mm³"
    )]
    NotConverged {
        /// Number of Newton iterations.
        iterations: usize,
        /// Residual relative to the scale of the forces.
        relative_residual: f64,
        /// Error of the volume balance \[mm³\].
        volume_residual_mm3: f64,
    },
    /// Even the shortest step inverts an element.
    #[error("element {element} would be inverted (volume ratio {volume_ratio:.3})")]
    Inverted {
        /// Number of the element.
        element: usize,
        /// Volume ratio of the element at the shortest step.
        volume_ratio: f64,
    },
    /// A quantity is infinite or NaN.
    #[error("{what} is not finite")]
    NotFinite {
        /// Name of the quantity.
        what: &'static str,
    },
    /// The linear solver did not converge.
    #[error(
        "linear solver: relative residual {relative_residual:.1e} after {iterations} iterations"
    )]
    Linear {
        /// Number of Krylov iterations.
        iterations: usize,
        /// Relative residual of the last one.
        relative_residual: f64,
    },
    /// The factorisation of the tangent failed.
    #[error("the direct linear solver failed")]
    Direct(#[from] DirectError),
    /// The circulation has no solution at the step's end.
    #[error("the circulation failed")]
    Circulation(#[from] CirculationError),
    /// The contraction model failed.
    #[error("the contraction model failed")]
    Contraction(#[from] ContractionError),
    /// The watcher stopped the step.
    #[error("stopped")]
    Stopped,
    /// Another rank failed in the step.
    #[error("{reason}")]
    Elsewhere {
        /// Description of the rank and its failure.
        reason: String,
    },
}

impl From<Disagreement<ContractionError>> for StepError {
    fn from(error: Disagreement<ContractionError>) -> Self {
        match error {
            Disagreement::Here(error) => Self::Contraction(error),
            Disagreement::Elsewhere(reason) => Self::Elsewhere { reason },
        }
    }
}

/// Sees the work so far before each linear system and decides whether the step continues, on all ranks alike. Collective.
pub type Watch<'a> = dyn FnMut(&StepReport) -> ControlFlow<()> + 'a;

/// Share of Newton's tolerance that a linear solve, or a guess without a solve, may leave: more would add up from step to step.
const LEFT: f64 = 0.3;

/// Takes a step of `dt_ms` from `now`. Newton's method starts at the displacement and pressure of `candidate`
/// ([`crate::time_integration::GeneralisedAlpha::predict`]), which holds the end on success. Returns the forces at the end.
/// Collective.
///
/// # Errors
/// [`StepError`]; `candidate` is then invalid.
#[expect(
    clippy::too_many_arguments,
    reason = "a step needs them all, each of its own kind"
)]
pub fn step(
    dynamics: &Dynamics,
    now: &State,
    dt_ms: f64,
    candidate: &mut Candidate,
    stress: &mut dyn PointStress,
    closure: &mut Closure<'_>,
    solver: &mut Solver,
    settings: &StepSettings,
) -> Result<(Vec<f64>, StepReport), StepError> {
    let watch = &mut |_: &StepReport| ControlFlow::Continue(());
    let given = (now, dt_ms);
    step_watched(
        dynamics, given, candidate, stress, closure, solver, settings, watch,
    )
}

/// [`step`] of `dt_ms` from a state, under a watcher. Collective.
///
/// # Errors
/// [`StepError`], [`StepError::Stopped`] if the watcher ended it; `candidate` is then invalid.
#[expect(
    clippy::too_many_arguments,
    reason = "a step needs them all, each of its own kind"
)]
pub fn step_watched(
    dynamics: &Dynamics,
    (now, dt_ms): (&State, f64),
    candidate: &mut Candidate,
    stress: &mut dyn PointStress,
    closure: &mut Closure<'_>,
    solver: &mut Solver,
    settings: &StepSettings,
    watch: &mut Watch<'_>,
) -> Result<(Vec<f64>, StepReport), StepError> {
    let space = dynamics.space();
    let n = now.motion.u.len();
    let mut report = StepReport::default();
    if let Closure::Pressure(p) = closure {
        candidate.pressure_kpa = *p;
    }
    let whole = |s: &Smallest| s.volume_ratio > settings.smallest_volume_ratio;
    let smallest = dynamics.complete(dt_ms, now, candidate);
    if !whole(&smallest) {
        // The prediction is inadmissible, so Newton's method starts from the step's start instead.
        candidate.motion.u.clone_from(&now.motion.u);
        let smallest = dynamics.complete(dt_ms, now, candidate);
        if !whole(&smallest) {
            let Smallest {
                element,
                volume_ratio,
            } = smallest;
            return Err(StepError::Inverted {
                element,
                volume_ratio,
            });
        }
    }
    let mut evaluate_stress = |candidate: &mut Candidate| {
        let Candidate {
            deformation,
            active,
            ..
        } = candidate;
        agree(space.comm, stress.evaluate(dt_ms, deformation, active))
    };
    evaluate_stress(candidate)?;
    let linearise =
        |solver: &mut Solver, candidate: &Candidate, force: &mut [f64], r: &mut [f64]| {
            let state = (now, candidate);
            solver.linearise(dynamics, dt_ms, state, (force, r), settings.linear);
        };
    let (mut force, mut r) = (vec![0.0; n], vec![0.0; n]);
    let (mut column, mut row) = (vec![], vec![]);
    let mut x = vec![0.0; n];
    // Displacement that was taken off the prediction, but for the response to pressure, and the residual there.
    let (mut correction, mut first) = (vec![0.0; n], vec![]);
    let (mut may_guess, mut is_guessed) = (!solver.recent.is_empty(), false);
    // Forces alone cost a fraction of the tangent, which is therefore evaluated only where needed.
    let mut linearised = !(solver.predicted || may_guess || settings.mixed_newton);
    if linearised {
        linearise(solver, candidate, &mut force, &mut r);
    } else {
        dynamics.residual(now, candidate, &mut force, &mut r);
    }
    loop {
        dynamics.pressure_column(candidate, &mut column);
        let norm = space.norm(&r);
        let scale = dynamics.force_scale(candidate, &column, &force, settings.least_pressure_kpa);
        report.relative_residual = norm / scale;
        let volume = dynamics.cavity_volume(&candidate.motion.u);
        let pressure_kpa = candidate.pressure_kpa;
        let left = closure.ask(space.comm, |balance| Ok(balance(pressure_kpa)?.0))?;
        report.volume_residual_mm3 = left.map_or(0.0, |left| volume - left);
        if !(norm.is_finite() && report.volume_residual_mm3.is_finite()) {
            return Err(StepError::NotFinite {
                what: "the residual",
            });
        }
        let is_unsolved = is_guessed && report.iterations == 0;
        let share = if is_unsolved { LEFT } else { 1.0 };
        if report.relative_residual <= share * settings.relative_tolerance
            && report.volume_residual_mm3.abs() <= settings.volume_tolerance_mm3
        {
            if report.iterations > 0 && settings.kept_corrections > 0 {
                let most = settings.kept_corrections;
                solver.recent.keep(&correction, &first, &r, most);
            }
            solver.predicted = report.iterations == 0;
            return Ok((force, report));
        }
        if report.iterations >= settings.max_iterations {
            let StepReport {
                iterations,
                relative_residual,
                volume_residual_mm3,
                ..
            } = report;
            return Err(StepError::NotConverged {
                iterations,
                relative_residual,
                volume_residual_mm3,
            });
        }
        if watch(&report).is_break() {
            return Err(StepError::Stopped);
        }
        if first.is_empty() {
            first.clone_from(&r);
        }
        let wanted = settings.relative_tolerance * scale;
        let start = candidate.motion.u.clone();
        if std::mem::take(&mut may_guess)
            && let Some(guess) = solver.recent.guess(space, &r, norm)
        {
            x.clone_from(&guess.correction);
            let mut change_kpa = 0.0;
            if left.is_some() && solver.response.len() == n {
                dynamics.volume_row(candidate, &mut row);
                let y = &solver.response;
                change_kpa =
                    pressure_change(space, closure, &row, (&x, y), (volume, pressure_kpa))?;
                add_times(change_kpa, y, &mut x);
            }
            candidate.subtract(&start, 1.0, &x);
            candidate.pressure_kpa = pressure_kpa + change_kpa;
            if whole(&dynamics.complete(dt_ms, now, candidate)) {
                evaluate_stress(candidate)?;
                linearised = guess.left > LEFT * wanted;
                if linearised {
                    linearise(solver, candidate, &mut force, &mut r);
                } else {
                    dynamics.residual(now, candidate, &mut force, &mut r);
                }
                if space.norm(&r) < norm {
                    correction = guess.correction;
                    is_guessed = true;
                    continue;
                }
            }
            candidate.motion.u.clone_from(&start);
            candidate.pressure_kpa = pressure_kpa;
            dynamics.complete(dt_ms, now, candidate);
            evaluate_stress(candidate)?;
            linearised = false;
        }
        if settings.mixed_newton {
            solver.linearise_as_foreseen(dynamics, dt_ms, now, candidate, settings.linear);
        } else if !linearised {
            linearise(solver, candidate, &mut force, &mut r);
        }
        let mut y = std::mem::take(&mut solver.response);
        let mut linear = solver.prepare(dynamics, settings, &mut report)?;
        x.fill(0.0);
        linear.solve(&r, &mut x, LEFT * wanted / norm, &mut report)?;
        let solution = x.clone();
        let mut change_kpa = 0.0;
        if left.is_some() {
            dynamics.volume_row(candidate, &mut row);
            let at = (volume, pressure_kpa);
            let unit = space.norm(&column);
            if y.len() != n {
                y = vec![0.0; n];
                linear.solve(&column, &mut y, 0.01, &mut report)?;
            }
            change_kpa = pressure_change(space, closure, &row, (&x, &y), at)?;
            // The response changes slowly; its error enters multiplied by the change of pressure, which sets the tolerance.
            let allowed = LEFT * wanted / change_kpa.abs().max(1e-3 * settings.least_pressure_kpa);
            if linear.residual_norm(&column, &mut y) > allowed {
                linear.solve(&column, &mut y, 0.5 * allowed / unit, &mut report)?;
                change_kpa = pressure_change(space, closure, &row, (&x, &y), at)?;
            }
            add_times(change_kpa, &y, &mut x);
        }
        solver.response = y;
        let mut share = 1.0;
        if settings.farthest_mm.is_finite() {
            let lengths = x
                .as_chunks::<3>()
                .0
                .iter()
                .map(|x| x[0].hypot(x[1]).hypot(x[2]));
            let mut farthest = [lengths.fold(0.0, f64::max)];
            dynamics.comm.max(&mut farthest);
            share = (settings.farthest_mm / farthest[0]).min(1.0);
        }
        let before = settings.mixed_newton.then(|| candidate.deformation.clone());
        for halving in 0.. {
            candidate.subtract(&start, share, &x);
            candidate.pressure_kpa = pressure_kpa + share * change_kpa;
            let smallest = dynamics.complete(dt_ms, now, candidate);
            if whole(&smallest) {
                evaluate_stress(candidate)?;
                dynamics.residual(now, candidate, &mut force, &mut r);
                let bounded = settings.largest_growth == f64::INFINITY
                    || space.norm(&r) <= settings.largest_growth * norm.max(wanted)
                    || halving >= settings.max_halvings;
                if bounded {
                    break;
                }
            } else if halving >= settings.max_halvings {
                let Smallest {
                    element,
                    volume_ratio,
                } = smallest;
                return Err(StepError::Inverted {
                    element,
                    volume_ratio,
                });
            }
            share *= 0.5;
        }
        add_times(share, &solution, &mut correction);
        if let Some(before) = before {
            solver.foresee(space, &before, share, &mut x);
        }
        report.iterations += 1;
        linearised = false;
    }
}

/// Change of the pressure after which cavity and circulation agree along `u − x − y Δp`; zero for a prescribed pressure.
/// Collective.
///
/// - `row`: derivative of the cavity's volume with respect to the displacement
/// - `volume`, `pressure_kpa`: at `u`
fn pressure_change(
    space: VectorLayout<'_>,
    closure: &mut Closure<'_>,
    row: &[f64],
    (x, y): (&[f64], &[f64]),
    (volume, pressure_kpa): (f64, f64),
) -> Result<f64, StepError> {
    let [along, response] = space.dots([(row, x), (row, y)]);
    let found = closure.ask(space.comm, |balance| {
        solve_balance(volume - along, -response, pressure_kpa, balance)
    })?;
    Ok(found.map_or(0.0, |found| found - pressure_kpa))
}

/// Pressure at which the cavity's volume, `volume + compliance · (p − start)`, equals the volume that the circulation leaves.
fn solve_balance(
    volume: f64,
    compliance: f64,
    start: f64,
    balance: &mut Balance<'_>,
) -> Result<f64, StepError> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut p = start;
    for _ in 0..100 {
        let (left, slope) = balance(p)?;
        let residual = volume + compliance * (p - start) - left;
        let gain = compliance - slope;
        if !residual.is_finite() || !(gain > 0.0) {
            return Err(StepError::NotFinite {
                what: "the volume balance",
            });
        }
        let newton = p - residual / gain;
        if (newton - p).abs() <= 1e-12 * (1.0 + p.abs()) || high - low <= 1e-13 * (1.0 + p.abs()) {
            return Ok(newton);
        }
        if residual < 0.0 {
            low = low.max(p);
        } else {
            high = high.min(p);
        }
        p = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
    }
    Ok(p)
}
