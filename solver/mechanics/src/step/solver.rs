//! The linear systems of a time step: storage of the tangent for each solver, and reuse from one system to the next.

use cardiotwin_linalg::conjugate_gradients::Entry;
use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{
    BlockJacobi, CondensedMatrix, Direct, KrylovEnding, KrylovReport, KrylovSettings, Multigrid,
    Operator, Preconditioner, RigidLevels, SingleBlockJacobi, SymmetricSweep, WithLevels,
    conjugate_gradients, gmres,
};

use super::recent::Recent;
use super::{StepError, StepReport, StepSettings};
use crate::body::Deformation;
use crate::dynamics::{Candidate, Dynamics, State};
use crate::linear::{Assembled, HalfTangent, PackedTangent};
use crate::newton::LinearSolver;

/// Tightest and loosest relative residual with an expensive preconditioner, since one more of its iterations costs less than
/// one of Newton's.
const EXPENSIVE: [f64; 2] = [1e-2, 0.1];
/// Loosest relative residual with another preconditioner.
const LOOSEST: f64 = 0.3;

/// Systems for which the levels of rigid motions are kept, since the tangent changes slowly.
const LEVELS_SERVE: u32 = 64;

/// Levels of rigid motions, with the time step of their matrix and the number of systems that they have served.
#[derive(Debug)]
struct KeptLevels {
    levels: RigidLevels,
    dt_ms: f64,
    served: u32,
}

/// Matrices and vectors kept between steps.
#[derive(Debug)]
pub struct Solver {
    matrix: Option<Matrix>,
    /// Copy of the tangent for products with it.
    half: Option<HalfTangent>,
    direct: Option<Direct>,
    multigrid: Option<Multigrid>,
    levels: Option<KeptLevels>,
    /// Nodal pressures at which the tangent is taken, if they are predicted.
    foreseen_kpa: Vec<f64>,
    /// Whether the kept factorisation or set-up took too many iterations.
    stale: bool,
    /// Last solution of `K y = q`, the start of the next solve.
    pub(super) response: Vec<f64>,
    /// Whether the last step converged at its prediction, as the next one then may, too.
    pub(super) predicted: bool,
    /// Corrections of the last steps.
    pub(super) recent: Recent,
}

/// The tangent, in the storage of its linear solver.
#[derive(Debug)]
enum Matrix {
    Full(CondensedMatrix),
    Packed(PackedTangent),
}

impl Matrix {
    fn new(dynamics: &Dynamics, linear: LinearSolver) -> Self {
        let packed = match linear {
            LinearSolver::BlockJacobi | LinearSolver::RigidLevels | LinearSolver::Multigrid => {
                dynamics.body.new_packed_tangent()
            }
            LinearSolver::Direct | LinearSolver::SymmetricSweep => None,
        };
        packed.map_or_else(|| Self::Full(dynamics.body.new_tangent()), Self::Packed)
    }

    fn assembled(&mut self) -> &mut dyn Assembled {
        match self {
            Self::Full(tangent) => tangent,
            Self::Packed(tangent) => tangent,
        }
    }

    /// The smallest relative residual that the storage's precision allows.
    fn least_tolerance(&self) -> f64 {
        match self {
            Self::Full(_) => 1e-10,
            Self::Packed(_) => 1e-5,
        }
    }
}

impl Solver {
    /// An empty workspace, for time steps with one and the same linear solver.
    #[must_use]
    pub fn new() -> Self {
        Self {
            matrix: None,
            half: None,
            direct: None,
            multigrid: None,
            levels: None,
            foreseen_kpa: vec![],
            stale: true,
            response: vec![],
            predicted: false,
            recent: Recent::default(),
        }
    }

    /// Number of vectors in the solver's memory.
    #[must_use]
    pub fn n_memories(&self) -> usize {
        usize::from(!self.response.is_empty()) + self.recent.vectors().count()
    }

    /// A vector of the solver's memory, three numbers a node: the response to pressure, if there is one, then the recent
    /// corrections. Empty beyond the last one.
    #[must_use]
    pub fn memory(&self, k: usize) -> Vec<f64> {
        let n_responses = usize::from(!self.response.is_empty());
        if k < n_responses {
            return self.response.clone();
        }
        let vector = self.recent.vectors().nth(k - n_responses);
        vector.map_or_else(Vec::new, |v| v.iter().map(|x| f64::from(*x)).collect())
    }

    /// Appends the next vector of another solver's [`Self::memory`] to this one's, which is empty at first.
    pub fn remember(&mut self, vector: &[f64]) {
        if self.response.is_empty() {
            self.response.extend_from_slice(vector);
        } else {
            self.recent.restore(vector);
        }
    }

    /// This rank's levels of rigid motions in numbers, with their use; empty without levels.
    #[must_use]
    pub fn levels(&self) -> Vec<f64> {
        let kept = self.levels.iter();
        kept.flat_map(|kept| {
            let mut numbers = vec![kept.dt_ms, f64::from(kept.served)];
            numbers.extend(kept.levels.numbers());
            numbers
        })
        .collect()
    }

    /// Takes over [`Self::levels`] of a solver for the same part of the same body; other numbers are ignored. Collective.
    pub fn take_levels(&mut self, dynamics: &Dynamics, numbers: &[f64]) {
        let (head, rest) = numbers.split_at(numbers.len().min(2));
        let levels = RigidLevels::from_numbers(dynamics.space(), dynamics.body.reference(), rest);
        self.levels = levels.filter(|_| head.len() == 2).map(|levels| KeptLevels {
            levels,
            dt_ms: head[0],
            served: head[1] as u32,
        });
    }

    /// Takes over the factorisation of another solver for a body with the same elements.
    pub fn take_over(&mut self, other: &mut Self) {
        (self.direct, self.multigrid) = (other.direct.take(), other.multigrid.take());
        self.foreseen_kpa = std::mem::take(&mut other.foreseen_kpa);
        self.stale = other.stale;
    }

    /// Discards all kept data, so that the next step depends on its start alone.
    pub fn forget(&mut self) {
        self.stale = true;
        self.predicted = false;
        self.levels = None;
        self.response.clear();
        self.recent.clear();
    }

    /// Evaluates residual and tangent at a complete candidate.
    pub(super) fn linearise(
        &mut self,
        dynamics: &Dynamics,
        dt_ms: f64,
        (now, candidate): (&State, &Candidate),
        (force, r): (&mut [f64], &mut [f64]),
        linear: LinearSolver,
    ) {
        let tangent = self
            .matrix
            .get_or_insert_with(|| Matrix::new(dynamics, linear))
            .assembled();
        dynamics.linearise(dt_ms, now, candidate, force, r, tangent);
        let positions = || -> Vec<f64> {
            let reference = dynamics.body.reference().iter();
            reference
                .zip(&candidate.motion.u)
                .map(|(x, u)| x + u)
                .collect()
        };
        if linear == LinearSolver::RigidLevels
            && let Some(entries) = tangent.entries()
        {
            let serves = |kept: &&mut KeptLevels| kept.dt_ms == dt_ms && kept.served < LEVELS_SERVE;
            match self.levels.as_mut().filter(serves) {
                Some(kept) => kept.served += 1,
                None => {
                    let (space, reference) = (dynamics.space(), dynamics.body.reference());
                    self.levels = Some(KeptLevels {
                        levels: RigidLevels::new(space, entries, reference, &positions()),
                        dt_ms,
                        served: 1,
                    });
                }
            }
        }
        if linear == LinearSolver::Multigrid && (self.stale || self.multigrid.is_none()) {
            let (pattern, block) = (tangent.pattern(), |slot| tangent.stiffness_block(slot));
            self.multigrid = Some(Multigrid::new(
                dynamics.space(),
                pattern,
                &block,
                &positions(),
            ));
            self.stale = false;
        }
        if linear == LinearSolver::RigidLevels
            && let Some(Matrix::Packed(tangent)) = &self.matrix
        {
            let pattern = || HalfTangent::zeros(dynamics.body.pattern().clone());
            self.half.get_or_insert_with(pattern).copy_from(tangent);
        }
    }

    /// Evaluates the tangent alone, at the predicted nodal pressures.
    pub(super) fn linearise_as_foreseen(
        &mut self,
        dynamics: &Dynamics,
        dt_ms: f64,
        now: &State,
        candidate: &mut Candidate,
        linear: LinearSolver,
    ) {
        let n = candidate.motion.u.len();
        self.foreseen_kpa
            .resize(candidate.deformation.nodal_pressure.len(), 0.0);
        std::mem::swap(
            &mut self.foreseen_kpa,
            &mut candidate.deformation.nodal_pressure,
        );
        self.linearise(
            dynamics,
            dt_ms,
            (now, candidate),
            (&mut vec![0.0; n], &mut vec![0.0; n]),
            linear,
        );
        std::mem::swap(
            &mut self.foreseen_kpa,
            &mut candidate.deformation.nodal_pressure,
        );
    }

    /// Predicts, to first order, the nodal pressures after subtracting `share` of `x` from the displacement.
    pub(super) fn foresee(
        &mut self,
        space: VectorLayout<'_>,
        deformation: &Deformation,
        share: f64,
        x: &mut [f64],
    ) {
        if deformation.nodal_pressure.is_empty() {
            return;
        }
        let volumes = self
            .matrix
            .as_mut()
            .expect("linearised before")
            .assembled()
            .vertex_volumes(space, x);
        self.foreseen_kpa.clear();
        self.foreseen_kpa.extend(
            (deformation
                .nodal_pressure
                .iter()
                .zip(&deformation.nodal_slope)
                .zip(volumes))
            .map(|((p, slope), volume)| p - share * slope * volume),
        );
    }

    /// Prepares a linear solver for the current tangent.
    pub(super) fn prepare<'a>(
        &'a mut self,
        dynamics: &'a Dynamics,
        settings: &'a StepSettings,
        report: &mut StepReport,
    ) -> Result<Linear<'a>, StepError> {
        if settings.linear == LinearSolver::Multigrid {
            let matrix = self.matrix.as_mut().expect("linearised before");
            let operator = &*matrix.assembled();
            let levels = self.multigrid.as_ref().expect("made with the tangent");
            let by = By::Multigrid(levels, &mut self.stale);
            return Ok(Linear {
                dynamics,
                settings,
                tolerances: EXPENSIVE,
                operator,
                by,
            });
        }
        let matrix = match self.matrix.as_ref().expect("linearised before") {
            Matrix::Full(tangent) if settings.linear == LinearSolver::Direct => {
                if self.direct.is_none() {
                    self.direct = Some(Direct::new(tangent, dynamics.body.reference())?);
                    self.stale = true;
                }
                let direct = self.direct.as_mut().expect("made above");
                let mut fresh = false;
                if self.stale {
                    direct.factorise(tangent)?;
                    report.factorisations += 1;
                    self.stale = false;
                    fresh = true;
                }
                let kept = Kept {
                    by: direct,
                    stale: &mut self.stale,
                    fresh,
                };
                return Ok(Linear {
                    dynamics,
                    settings,
                    tolerances: EXPENSIVE,
                    operator: tangent,
                    by: By::Direct(kept, tangent),
                });
            }
            matrix => matrix,
        };
        let tolerances = [matrix.least_tolerance(), LOOSEST];
        let (operator, by): (&dyn Operator, By<'a>) = match matrix {
            Matrix::Full(tangent) if settings.linear == LinearSolver::SymmetricSweep => {
                (tangent, By::Sweep(SymmetricSweep::new(tangent)))
            }
            Matrix::Full(tangent) => (tangent, By::Jacobi(BlockJacobi::new(tangent))),
            Matrix::Packed(tangent) => match (&self.levels, &self.half) {
                (Some(KeptLevels { levels, .. }), Some(half)) => {
                    let jacobi = SingleBlockJacobi::new(tangent);
                    (half, By::Levels(WithLevels { jacobi, levels }, half))
                }
                _ => (tangent, By::Jacobi(BlockJacobi::new(tangent))),
            },
        };
        Ok(Linear {
            dynamics,
            settings,
            tolerances,
            operator,
            by,
        })
    }
}

impl Default for Solver {
    fn default() -> Self {
        Self::new()
    }
}

/// A factorisation kept until it takes too many iterations.
struct Kept<'a> {
    by: &'a mut Direct,
    stale: &'a mut bool,
    fresh: bool,
}

enum By<'a> {
    Direct(Kept<'a>, &'a CondensedMatrix),
    Multigrid(&'a Multigrid, &'a mut bool),
    Jacobi(BlockJacobi),
    Levels(WithLevels<'a>, &'a HalfTangent),
    Sweep(SymmetricSweep<'a>),
}

/// The linear systems of one Newton iteration.
pub(super) struct Linear<'a> {
    dynamics: &'a Dynamics,
    settings: &'a StepSettings,
    /// Tightest and loosest relative residual of a solve.
    tolerances: [f64; 2],
    operator: &'a dyn Operator,
    by: By<'a>,
}

impl Linear<'_> {
    /// Solves `K x = b` from `x` to the relative residual `tolerance`, or the nearest one that the storage and the
    /// preconditioner allow.
    pub(super) fn solve(
        &mut self,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        report: &mut StepReport,
    ) -> Result<(), StepError> {
        let (space, [least, most]) = (self.dynamics.space(), self.tolerances);
        let limits = KrylovSettings {
            relative_tolerance: tolerance.clamp(least, most),
            ..self.settings.krylov
        };
        let dynamics = self.dynamics;
        let solve = |by: &dyn Preconditioner, x: &mut [f64], report: &mut StepReport| {
            let system = (self.operator, &Held { by, dynamics } as &dyn Preconditioner);
            krylov(space, system, system, (b, x), &limits, report)
        };
        match &mut self.by {
            By::Jacobi(m) => solve(m, x, report),
            By::Levels(m, half) => {
                let single = Held::<f32> { by: m, dynamics };
                let double = Held::<f64> { by: m, dynamics };
                krylov(
                    space,
                    (*half as &dyn Operator<f32>, &single),
                    (self.operator, &double),
                    (b, x),
                    &limits,
                    report,
                )
            }
            By::Sweep(m) => solve(m, x, report),
            By::Multigrid(levels, stale) => {
                let short = KrylovSettings {
                    max_iterations: 4 * self.settings.keep_until,
                    ..limits
                };
                let by = Held {
                    by: *levels,
                    dynamics,
                };
                let mut done = conjugate_gradients(space, self.operator, &by, b, x, &short);
                let mut iterations = done.iterations;
                if done.ending != KrylovEnding::Converged {
                    // Far from equilibrium the tangent may be indefinite.
                    x.fill(0.0);
                    done = gmres(space, self.operator, &by, b, x, &short);
                    iterations += done.iterations;
                }
                report.krylov_iterations += iterations;
                **stale |= iterations > self.settings.keep_until;
                if done.relative_residual < 0.3 {
                    return Ok(());
                }
                let KrylovReport {
                    iterations,
                    relative_residual,
                    ..
                } = done;
                Err(StepError::Linear {
                    iterations,
                    relative_residual,
                })
            }
            By::Direct(kept, tangent) => {
                let short = KrylovSettings {
                    max_iterations: self.settings.keep_until,
                    ..limits
                };
                // Far from equilibrium the current or the factorised tangent may be indefinite.
                let by = Held {
                    by: &*kept.by,
                    dynamics,
                };
                let done = gmres(space, self.operator, &by, b, x, &short);
                report.krylov_iterations += done.iterations;
                *kept.stale |= done.ending != KrylovEnding::Converged;
                if done.relative_residual < 0.1 {
                    return Ok(());
                }
                if !kept.fresh {
                    x.fill(0.0);
                    kept.by.factorise(tangent)?;
                    report.factorisations += 1;
                    kept.fresh = true;
                    *kept.stale = false;
                }
                solve(&*kept.by, x, report)
            }
        }
    }

    pub(super) fn residual_norm(&self, b: &[f64], x: &mut [f64]) -> f64 {
        let space = self.dynamics.space();
        let mut r = vec![0.0; b.len()];
        self.operator.multiply(space, x, &mut r);
        r.iter_mut().zip(b).for_each(|(r, b)| *r = b - *r);
        space.norm(&r)
    }
}

/// A preconditioner that leaves held components at rest. Their residual is zero, so that no later iteration would take a
/// motion of theirs back.
struct Held<'a, T = f64> {
    by: &'a dyn Preconditioner<T>,
    dynamics: &'a Dynamics,
}

impl<T: Default> Preconditioner<T> for Held<'_, T> {
    fn apply(&self, space: VectorLayout<'_>, r: &[T], z: &mut [T]) {
        self.by.apply(space, r, z);
        self.dynamics.hold(z);
    }
}

/// A matrix with its preconditioner.
type System<'a, T = f64> = (&'a dyn Operator<T>, &'a dyn Preconditioner<T>);

/// Conjugate gradients, followed by GMRES in double precision if they stop at an indefinite matrix.
fn krylov<T: Entry>(
    space: VectorLayout<'_>,
    (operator, preconditioner): System<'_, T>,
    in_double: System<'_>,
    (b, x): (&[f64], &mut [f64]),
    limits: &KrylovSettings,
    report: &mut StepReport,
) -> Result<(), StepError> {
    let mut done = conjugate_gradients(space, operator, preconditioner, b, x, limits);
    report.krylov_iterations += done.iterations;
    if done.ending != KrylovEnding::Converged {
        let (operator, preconditioner) = in_double;
        done = gmres(space, operator, preconditioner, b, x, limits);
        report.krylov_iterations += done.iterations;
    }
    if !(done.relative_residual < (10.0 * limits.relative_tolerance).min(0.5)) {
        let (iterations, relative_residual) = (done.iterations, done.relative_residual);
        return Err(StepError::Linear {
            iterations,
            relative_residual,
        });
    }
    Ok(())
}
