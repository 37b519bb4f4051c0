//! One time step: displacement and cavity pressure together.
//!
//! Newton's method on the bordered system of momentum `r(u, p) = 0` and volume balance `V(u) = W(p)`, with `W` the volume
//! that the circulation leaves in the cavity at pressure `p`. Each iteration solves for two right-hand sides, `K x = r` and
//! `K y = q`; along `u − x − y Δp` the volume is linear, and the scalar balance with the circulation, kinks of its valves
//! included, is then solved exactly by a bracketed Newton method: valves that change state cannot make it cycle.

mod solver;

use cardiotwin_linalg::parallel::{Communicator, Disagreement, agree};
use cardiotwin_linalg::{DirectError, KrylovSettings};
use cardiotwin_models::circulation::CirculationError;
use cardiotwin_models::contraction::ContractionError;

use crate::body::Deformation;
use crate::dynamics::{Candidate, Dynamics, State};
use crate::element::kernel::ActivePoint;
use crate::newton::{LinearSolver, Smallest};
pub use solver::Solver;

/// Active stress at the integration points for a candidate deformation.
pub trait PointStress {
    /// Fills `out`, one a point batch, with stress and slope at the end of a step of `dt_ms`; leaves it empty for none.
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

/// No active stress.
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

/// Volume \[mm³\] that remains in the cavity at the step's end for a pressure \[kPa\], and its slope, never positive.
pub type Balance<'a> = dyn FnMut(f64) -> Result<(f64, f64), CirculationError> + 'a;

/// What decides on the pressure at the step's end.
pub enum Closure<'a> {
    /// It is given \[kPa\].
    Pressure(f64),
    /// The circulation.
    Balance(&'a mut Balance<'a>),
    /// The circulation, which rank 0 has: for the other ranks.
    BalanceOfRank0,
}

impl Closure<'_> {
    /// What rank 0 makes of the circulation, on all ranks; `None` for a given pressure. Collective.
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

/// Settings of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepSettings {
    /// Residual over the scale of the forces at which it has converged.
    pub relative_tolerance: f64,
    /// Smallest scale of the forces, a pressure \[kPa\] on the endocardium: what the residual is compared with at rest.
    pub least_pressure_kpa: f64,
    /// Volume balance at which it has converged \[mm³\].
    pub volume_tolerance_mm3: f64,
    /// Most iterations.
    pub max_iterations: usize,
    /// Most halvings of an iteration's step.
    pub max_halvings: usize,
    /// An iteration's step is halved when an element's volume would shrink below this share.
    pub smallest_volume_ratio: f64,
    /// An iteration's step is halved when the residual would grow by more than this factor. It may grow by a good deal: with stiff
    /// volume change the residual of an early iteration is thirty times the start's, and Newton's method converges all the same.
    pub largest_growth: f64,
    /// Farthest that an iteration moves a node \[mm\]: exponential laws answer a larger step by a larger error.
    pub farthest_mm: f64,
    /// Whether the tangent is taken at the nodal pressures that the last iteration foresaw, not at those of the volumes as
    /// they are: what a volume is off by, to second order, is a pressure beyond the stiffness of a soft material, and spoils
    /// the tangent. Newton's method of the mixed form; for long steps.
    ///
    /// Source: Magisano, Leonetti and Garcea 2017, Int J Numer Methods Eng 109:1237.
    pub foresee_pressures: bool,
    /// Whether a beat's step begins where its predecessor's motion and change of pressure lead; otherwise where that ended.
    pub extrapolate: bool,
    /// Linear solver.
    pub linear: LinearSolver,
    /// Limits of the Krylov method; its tolerance follows from the residual.
    pub krylov: KrylovSettings,
    /// Factorisations and set-ups are kept until a solve takes more iterations than this.
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
            foresee_pressures: false,
            extrapolate: true,
            linear: LinearSolver::BlockJacobi,
            krylov: KrylovSettings::default(),
            keep_until: 12,
        }
    }
}

/// What a step cost.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepReport {
    /// Newton iterations.
    pub iterations: usize,
    /// Krylov iterations of both right-hand sides.
    pub krylov_iterations: usize,
    /// Factorisations.
    pub factorisations: usize,
    /// Residual at the end over the scale of the forces.
    pub relative_residual: f64,
    /// Volume balance at the end \[mm³\].
    pub volume_residual_mm3: f64,
}

/// Why a step failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StepError {
    /// Out of iterations.
    #[error(
        "Newton did not converge in {iterations} iterations: relative residual {relative_residual:.1e}, \
         volume balance {volume_residual_mm3:.1e} mm³"
    )]
    NotConverged {
        /// Iterations made.
        iterations: usize,
        /// Residual over the scale of the forces.
        relative_residual: f64,
        /// Volume balance.
        volume_residual_mm3: f64,
    },
    /// Every step, however short, inverts an element.
    #[error("element {element} would be inverted (volume ratio {volume_ratio:.3})")]
    Inverted {
        /// Element.
        element: usize,
        /// Its volume ratio at the shortest step.
        volume_ratio: f64,
    },
    /// Something is not a number.
    #[error("{what} is not finite")]
    NotFinite {
        /// What.
        what: &'static str,
    },
    /// The linear solver did not converge.
    #[error(
        "linear solver: relative residual {relative_residual:.1e} after {iterations} iterations"
    )]
    Linear {
        /// Iterations made.
        iterations: usize,
        /// Residual that it reached.
        relative_residual: f64,
    },
    /// The factorisation failed.
    #[error("factorisation")]
    Direct(#[from] DirectError),
    /// The circulation failed.
    #[error("circulation")]
    Circulation(#[from] CirculationError),
    /// The contraction model failed.
    #[error("contraction model")]
    Contraction(#[from] ContractionError),
    /// Another rank failed.
    #[error("{reason}")]
    Elsewhere {
        /// Which, and why.
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

/// Loosest relative residual of a linear solve.
const LOOSEST: f64 = 0.1;

/// Takes a step of `dt_ms` from `now`. `candidate` is the end on success: its displacement and pressure are where Newton
/// starts (see [`crate::time_integration::GeneralisedAlpha::predict`]). Returns the forces there too. Collective.
///
/// # Errors
/// [`StepError`]; `candidate` then is of no use.
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
    let space = dynamics.space();
    let n = now.motion.u.len();
    let mut report = StepReport::default();
    if let Closure::Pressure(p) = closure {
        candidate.pressure_kpa = *p;
    }
    let whole = |s: &Smallest| s.volume_ratio > settings.smallest_volume_ratio;
    let smallest = dynamics.complete(dt_ms, now, candidate);
    if !whole(&smallest) {
        // Not from the prediction, then: from where the step starts.
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
    agree(
        space.comm,
        stress.evaluate(dt_ms, &candidate.deformation, &mut candidate.active),
    )?;
    let (mut force, mut r) = (vec![0.0; n], vec![0.0; n]);
    let (mut column, mut row) = (vec![], vec![]);
    let mut x = vec![0.0; n];
    // Forces alone cost a fraction of the tangent: it is made where it is needed.
    let mut linearised = !solver.predicted && !settings.foresee_pressures;
    if linearised {
        solver.linearise(
            dynamics,
            dt_ms,
            (now, candidate),
            (&mut force, &mut r),
            settings.linear,
        );
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
        if report.relative_residual <= settings.relative_tolerance
            && report.volume_residual_mm3.abs() <= settings.volume_tolerance_mm3
        {
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
        if settings.foresee_pressures {
            solver.linearise_as_foreseen(dynamics, dt_ms, now, candidate, settings.linear);
        } else if !linearised {
            solver.linearise(
                dynamics,
                dt_ms,
                (now, candidate),
                (&mut force, &mut r),
                settings.linear,
            );
        }
        let wanted = settings.relative_tolerance * scale;
        let tolerance = (0.3 * wanted / norm).clamp(1e-10, LOOSEST);
        let mut y = std::mem::take(&mut solver.response);
        let mut linear = solver.prepare(dynamics, settings, &mut report)?;
        x.fill(0.0);
        linear.solve(&r, &mut x, tolerance, &mut report)?;
        let mut change_kpa = 0.0;
        if left.is_some() {
            dynamics.volume_row(candidate, &mut row);
            let along = space.dot(&row, &x);
            let mut change = |y: &[f64]| -> Result<f64, StepError> {
                let compliance = -space.dot(&row, y);
                let solve = |balance: &mut Balance<'_>| {
                    solve_balance(volume - along, compliance, pressure_kpa, balance)
                };
                Ok(closure
                    .ask(space.comm, solve)?
                    .map_or(0.0, |found| found - pressure_kpa))
            };
            let unit = space.norm(&column);
            if y.len() != n {
                y = vec![0.0; n];
                linear.solve(&column, &mut y, 0.01, &mut report)?;
            }
            change_kpa = change(&y)?;
            // The response changes slowly, and is off by no more than what the change of pressure makes of its error.
            let allowed = 0.3 * wanted / change_kpa.abs().max(1e-3 * settings.least_pressure_kpa);
            if linear.residual_norm(&column, &mut y) > allowed {
                linear.solve(
                    &column,
                    &mut y,
                    (0.5 * allowed / unit).clamp(1e-10, LOOSEST),
                    &mut report,
                )?;
                change_kpa = change(&y)?;
            }
            for (x, y) in x.iter_mut().zip(&y) {
                *x += change_kpa * y;
            }
        }
        solver.response = y;
        let start = candidate.motion.u.clone();
        let start_kpa = candidate.pressure_kpa;
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
        let before = settings
            .foresee_pressures
            .then(|| candidate.deformation.clone());
        for halving in 0.. {
            for k in 0..n {
                candidate.motion.u[k] = start[k] - share * x[k];
            }
            candidate.pressure_kpa = start_kpa + share * change_kpa;
            let smallest = dynamics.complete(dt_ms, now, candidate);
            if whole(&smallest) {
                agree(
                    space.comm,
                    stress.evaluate(dt_ms, &candidate.deformation, &mut candidate.active),
                )?;
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
        if let Some(before) = before {
            solver.foresee(space, &before, share, &mut x);
        }
        report.iterations += 1;
        linearised = false;
    }
}

/// The pressure at which the cavity's volume, `volume + compliance · (p − start)`, is what the circulation leaves in it.
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
