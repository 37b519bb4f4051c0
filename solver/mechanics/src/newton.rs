//! Newton's method for the displacement of a body, with a line search that guards against inverted elements rather than
//! against every rise of the residual.

use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{
    BlockJacobi, CondensedMatrix, Direct, DirectError, KrylovEnding, KrylovReport, KrylovSettings,
    Multigrid, Preconditioner, SymmetricSweep, conjugate_gradients, gmres,
};

use crate::linear::Assembled as _;

/// Method by which linear systems are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinearSolver {
    /// Factorised symmetric half, GMRES for the rest. One process.
    Direct,
    /// CG (GMRES where the matrix is not positive definite) with block Jacobi.
    BlockJacobi,
    /// The same with block Jacobi and rigid motions of nested groups of nodes, for time steps of linear elements;
    /// [`Self::BlockJacobi`] for others.
    RigidLevels,
    /// The same with a symmetric sweep.
    SymmetricSweep,
    /// The same with algebraic multigrid, for linear elements; [`Self::Direct`] for others.
    Multigrid,
}

impl LinearSolver {
    /// Whether time steps with it can be distributed over ranks.
    #[must_use]
    pub fn is_parallel(self) -> bool {
        matches!(self, Self::BlockJacobi | Self::RigidLevels)
    }
}

/// Settings of Newton's method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonSettings {
    /// Tolerance of the residual, relative to the larger of the first residual and the external
    /// force.
    pub relative_tolerance: f64,
    /// Largest number of iterations.
    pub max_iterations: usize,
    /// Largest number of halvings of a step.
    pub max_halvings: usize,
    /// Growth of the residual beyond which a step is halved. Growth is normal: with stiff volume
    /// change the first iteration's residual is thirty times that of the start, and Newton
    /// converges all the same.
    pub largest_growth: f64,
    /// Share of its volume below which no element may shrink in a step; such a step is halved.
    pub smallest_volume_ratio: f64,
    /// Whether the tangent is taken at the nodal pressures that the last iteration foresaw ([`crate::step::StepSettings`]).
    pub mixed_newton: bool,
    /// Solver of the linear systems.
    pub linear: LinearSolver,
    /// Tolerance and limits of the Krylov method.
    pub krylov: KrylovSettings,
}

impl Default for NewtonSettings {
    fn default() -> Self {
        Self {
            relative_tolerance: 1e-8,
            max_iterations: 15,
            max_halvings: 6,
            largest_growth: 1e3,
            smallest_volume_ratio: 0.1,
            mixed_newton: true,
            linear: LinearSolver::Direct,
            krylov: KrylovSettings {
                relative_tolerance: 1e-6,
                ..KrylovSettings::default()
            },
        }
    }
}

/// Work of a solve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NewtonReport {
    /// Norm of the residual before each iteration and at the end \[mN\].
    pub residuals: Vec<f64>,
    /// Number of Krylov iterations, all together.
    pub krylov_iterations: usize,
    /// Number of steps that were halved.
    pub halvings: usize,
}

impl NewtonReport {
    /// Number of linear systems that were solved.
    #[must_use]
    pub fn iterations(&self) -> usize {
        self.residuals.len().saturating_sub(1)
    }
}

/// Reasons why Newton's method stopped without a solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NewtonError {
    /// The limit of iterations was reached.
    #[error(
        "Newton's method did not converge in {iterations} iterations: residual {residual:.3e} mN, expected at most \
         {wanted:.3e} mN"
    )]
    NotConverged {
        /// Number of iterations.
        iterations: usize,
        /// Residual of the last iteration \[mN\].
        residual: f64,
        /// Residual that the tolerance allows \[mN\].
        wanted: f64,
    },
    /// Even a short step inverts an element or blows up.
    #[error(
        "no admissible step: after {halvings} halvings element {element} would have volume ratio {volume_ratio:.3} and the \
         residual would be {residual:.3e} mN"
    )]
    NoStep {
        /// Number of halvings of the step.
        halvings: usize,
        /// Element of the smallest volume ratio.
        element: usize,
        /// Volume ratio of that element.
        volume_ratio: f64,
        /// Residual of the shortest step \[mN\].
        residual: f64,
    },
    /// The linear solver failed.
    #[error(
        "linear solver stopped after {iterations} iterations at a relative residual of {relative_residual:.1e}"
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
}

/// Smallest volume ratio of an evaluation, with its element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smallest {
    /// Smallest volume ratio `J` over the elements.
    pub volume_ratio: f64,
    /// Index of the element that has it.
    pub element: usize,
}

/// A nonlinear system for displacements. Implementations bring ghosts up to date and zero the residual of fixed components.
pub trait System {
    /// Vectors of the system.
    fn space(&self) -> VectorLayout<'_>;

    /// Residual at `u` into `r` \[mN\]; where an element is inverted `r` need not be filled. Collective.
    fn residual(&mut self, u: &mut [f64], r: &mut [f64]) -> Smallest;

    /// Residual and its derivative, constrained.
    fn linearise(&mut self, u: &mut [f64], r: &mut [f64], tangent: &mut CondensedMatrix);

    /// Lets the next derivative be that at the nodal pressures which a step of `change` from the last one would have to first
    /// order, if [`NewtonSettings::mixed_newton`] asks for it. Does nothing by default. Collective.
    fn foresee(&mut self, change: &mut [f64], tangent: &CondensedMatrix) {
        let _ = (change, tangent);
    }

    /// Norm of the external forces at `u` \[mN\], for the tolerance.
    fn external_force(&self) -> f64;

    /// Reference coordinates, for orderings.
    fn reference(&self) -> &[f64];
}

/// Matrices that outlive a solve.
#[derive(Debug)]
pub struct Workspace {
    /// Tangent of the last iteration.
    pub tangent: CondensedMatrix,
    direct: Option<Direct>,
}

impl Workspace {
    /// A workspace around a body's zero tangent.
    #[must_use]
    pub fn new(tangent: CondensedMatrix) -> Self {
        Self {
            tangent,
            direct: None,
        }
    }
}

/// Solves `system` from `u`, which holds the solution on success and an arbitrary iterate on failure. Collective.
///
/// # Errors
/// [`NewtonError`] when there is no convergence.
pub fn solve(
    system: &mut dyn System,
    u: &mut [f64],
    workspace: &mut Workspace,
    settings: &NewtonSettings,
) -> Result<NewtonReport, NewtonError> {
    let n = u.len();
    let (mut r, mut trial, mut trial_r) = (vec![0.0; n], u.to_vec(), vec![0.0; n]);
    let mut report = NewtonReport::default();
    let mut wanted = 0.0;
    loop {
        system.linearise(u, &mut r, &mut workspace.tangent);
        let norm = system.space().norm(&r);
        report.residuals.push(norm);
        if report.residuals.len() == 1 {
            wanted = (settings.relative_tolerance * norm.max(system.external_force()))
                .max(round_off(system, workspace));
        }
        if norm <= wanted {
            return Ok(report);
        }
        if report.iterations() >= settings.max_iterations {
            return Err(NewtonError::NotConverged {
                iterations: report.iterations(),
                residual: norm,
                wanted,
            });
        }
        let mut step = vec![0.0; n];
        let krylov = solve_linear(system, workspace, &r, &mut step, settings)?;
        report.krylov_iterations += krylov.iterations;
        let mut share = -1.0;
        let mut halvings = 0;
        loop {
            for k in 0..n {
                trial[k] = u[k] + share * step[k];
            }
            let smallest = system.residual(&mut trial, &mut trial_r);
            let whole = smallest.volume_ratio > settings.smallest_volume_ratio;
            let trial_norm = if whole {
                system.space().norm(&trial_r)
            } else {
                f64::INFINITY
            };
            if trial_norm <= settings.largest_growth * norm.max(wanted) {
                break;
            }
            if halvings >= settings.max_halvings {
                return Err(NewtonError::NoStep {
                    halvings,
                    element: smallest.element,
                    volume_ratio: smallest.volume_ratio,
                    residual: trial_norm,
                });
            }
            share *= 0.5;
            halvings += 1;
        }
        report.halvings += halvings;
        if settings.mixed_newton {
            step.iter_mut().for_each(|x| *x *= share);
            system.foresee(&mut step, &workspace.tangent);
        }
        u.copy_from_slice(&trial);
    }
}

/// Residual that rounding of the positions leaves; no tolerance can be below it.
fn round_off(system: &dyn System, workspace: &Workspace) -> f64 {
    let space = system.space();
    128.0 * f64::EPSILON * workspace.tangent.mean_diagonal(space) * space.norm(system.reference())
}

/// `K step = r`.
fn solve_linear(
    system: &dyn System,
    workspace: &mut Workspace,
    r: &[f64],
    step: &mut [f64],
    settings: &NewtonSettings,
) -> Result<KrylovReport, NewtonError> {
    let space = system.space();
    let tangent = &workspace.tangent;
    let with = |m: &dyn Preconditioner, step: &mut [f64]| {
        let first = conjugate_gradients(space, tangent, m, r, step, &settings.krylov);
        if first.ending == KrylovEnding::Converged {
            return first;
        }
        let next = gmres(space, tangent, m, r, step, &settings.krylov);
        KrylovReport {
            iterations: first.iterations + next.iterations,
            ..next
        }
    };
    let report = match settings.linear {
        LinearSolver::Direct => {
            if workspace.direct.is_none() {
                workspace.direct = Some(Direct::new(tangent, system.reference())?);
            }
            let direct = workspace.direct.as_mut().expect("made above");
            direct.factorise(tangent)?;
            gmres(space, tangent, &*direct, r, step, &settings.krylov)
        }
        LinearSolver::BlockJacobi | LinearSolver::RigidLevels => {
            with(&BlockJacobi::new(tangent), step)
        }
        LinearSolver::SymmetricSweep => with(&SymmetricSweep::new(tangent), step),
        LinearSolver::Multigrid => {
            let (pattern, block) = (tangent.pattern(), |slot| tangent.stiffness_block(slot));
            with(
                &Multigrid::new(space, pattern, &block, system.reference()),
                step,
            )
        }
    };
    // A step a little off costs an iteration of Newton; one that is not a solution at all costs the solve.
    if report.relative_residual.is_finite() && report.relative_residual < 0.1 {
        Ok(report)
    } else {
        Err(NewtonError::Linear {
            iterations: report.iterations,
            relative_residual: report.relative_residual,
        })
    }
}
