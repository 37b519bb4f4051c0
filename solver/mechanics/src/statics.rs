//! Equilibrium under a load that grows from nothing, in steps that are halved on failure and grown after success.

use cardiotwin_linalg::CondensedMatrix;
use cardiotwin_linalg::parallel::{Communicator, VectorLayout};

use crate::body::{Body, Deformation};
use crate::boundary::{PressureSurface, Robin};
use crate::element::kernel::ActivePoint;
use crate::linear::Assembled as _;
use crate::newton::{
    NewtonError, NewtonReport, NewtonSettings, Smallest, System, Workspace, solve,
};

/// Supports and full loads of a static problem.
#[derive(Debug)]
pub struct StaticProblem<'a> {
    /// Body in equilibrium.
    pub body: &'a Body,
    /// Communicator of the ranks, for sums over all of them.
    pub comm: &'a dyn Communicator,
    /// Surfaces with their pressure at full load \[kPa\].
    pub pressures: Vec<(PressureSurface, f64)>,
    /// Springs with their stiffness \[kPa/mm\].
    pub springs: Vec<(Robin, f64)>,
    /// Components of each node's displacement that are prescribed.
    pub fixed: Vec<[bool; 3]>,
    /// Prescribed displacement at full load \[mm\], three a node; empty for zero.
    pub prescribed: Vec<f64>,
    /// Active stress at full load, one a point batch; empty for none.
    pub active: Vec<ActivePoint>,
}

/// Settings of the load steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadSteps {
    /// First load step, as a share of the full load.
    pub first: f64,
    /// Largest load step, as a share of the full load.
    pub largest: f64,
    /// Smallest load step, below which none is halved.
    pub smallest: f64,
    /// A step grows by half after this many solves in a row of at most [`Self::quick`] iterations.
    pub grow_after: usize,
    /// Largest number of iterations of a quick solve.
    pub quick: usize,
    /// Settings of Newton's method in each load step.
    pub newton: NewtonSettings,
}

impl Default for LoadSteps {
    fn default() -> Self {
        Self {
            first: 0.1,
            largest: 1.0,
            smallest: 1e-3,
            grow_after: 2,
            quick: 6,
            newton: NewtonSettings::default(),
        }
    }
}

/// Work of a static solve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StaticReport {
    /// Work of Newton's method in each load step, in order.
    pub steps: Vec<NewtonReport>,
    /// Number of steps that failed and were halved.
    pub n_cut: usize,
}

impl StaticReport {
    /// Number of linear systems that were solved.
    #[must_use]
    pub fn iterations(&self) -> usize {
        self.steps.iter().map(NewtonReport::iterations).sum()
    }
}

/// The full load was not reached; the displacement is that of the last load that was.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("no equilibrium found beyond {load:.4} of the load, not even with a step of {step:.1e}")]
pub struct StaticError {
    /// Share of the load of the last equilibrium.
    pub load: f64,
    /// Load step that failed, as a share of the full load.
    pub step: f64,
    /// Failure of the smallest load step.
    pub source: NewtonError,
}

/// A static problem at one share of its load.
struct AtLoad<'a, 'b> {
    problem: &'a StaticProblem<'b>,
    load: f64,
    active: Vec<ActivePoint>,
    deformation: Deformation,
    /// Nodal pressures \[kPa\] and their slopes at the last linearisation.
    linearised: (Vec<f64>, Vec<f64>),
    /// Nodal pressures that the last iteration foresaw; empty for none.
    foreseen_kpa: Vec<f64>,
    external: f64,
}

impl AtLoad<'_, '_> {
    fn deform(&mut self, u: &mut [f64]) -> Smallest {
        self.space().update(u);
        self.problem
            .body
            .deform(u, self.problem.comm, &mut self.deformation);
        let (ratio, element) = self.deformation.smallest;
        // The smallest over ranks; NaN counts as inverted everywhere.
        let mut negative = [if ratio.is_nan() {
            f64::INFINITY
        } else {
            -ratio
        }];
        self.problem.comm.max(&mut negative);
        Smallest {
            volume_ratio: -negative[0],
            element,
        }
    }

    fn add_loads(&mut self, u: &[f64], r: &mut [f64]) {
        let reference = self.problem.body.reference();
        let mut load = vec![0.0; r.len()];
        for (surface, pressure) in &self.problem.pressures {
            surface.add_forces(self.load * pressure, reference, u, &mut load);
        }
        self.external = self.space().norm(&load);
        for (spring, k) in &self.problem.springs {
            spring.add_forces(*k, u, &mut load);
        }
        r.iter_mut().zip(&load).for_each(|(r, l)| *r += l);
        zero_fixed(&self.problem.fixed, r);
    }
}

fn zero_fixed(fixed: &[[bool; 3]], r: &mut [f64]) {
    for (r, fixed) in r.as_chunks_mut::<3>().0.iter_mut().zip(fixed) {
        for i in 0..3 {
            if fixed[i] {
                r[i] = 0.0;
            }
        }
    }
}

impl System for AtLoad<'_, '_> {
    fn space(&self) -> VectorLayout<'_> {
        VectorLayout {
            comm: self.problem.comm,
            layout: self.problem.body.layout(),
        }
    }

    fn residual(&mut self, u: &mut [f64], r: &mut [f64]) -> Smallest {
        let smallest = self.deform(u);
        if smallest.volume_ratio > 0.0 {
            r.fill(0.0);
            self.problem
                .body
                .add_forces(u, &self.active, &self.deformation, r);
            self.add_loads(u, r);
        }
        smallest
    }

    fn linearise(&mut self, u: &mut [f64], r: &mut [f64], tangent: &mut CondensedMatrix) {
        self.deform(u);
        self.linearised = (
            self.deformation.nodal_pressure.clone(),
            self.deformation.nodal_slope.clone(),
        );
        let body = self.problem.body;
        r.fill(0.0);
        if self.foreseen_kpa.is_empty() {
            body.tangent(u, &self.active, &self.deformation, r, tangent);
        } else {
            std::mem::swap(&mut self.deformation.nodal_pressure, &mut self.foreseen_kpa);
            body.tangent(u, &self.active, &self.deformation, r, tangent);
            std::mem::swap(&mut self.deformation.nodal_pressure, &mut self.foreseen_kpa);
            r.fill(0.0);
            body.add_forces(u, &self.active, &self.deformation, r);
        }
        self.add_loads(u, r);
        let reference = self.problem.body.reference();
        for (surface, pressure) in &self.problem.pressures {
            surface.add_tangent(self.load * pressure, reference, u, tangent);
        }
        for (spring, k) in &self.problem.springs {
            spring.add_tangent(*k, tangent);
        }
        let mean = tangent.mean_diagonal(self.space());
        tangent.constrain(&self.problem.fixed, mean);
    }

    fn foresee(&mut self, change: &mut [f64], tangent: &CondensedMatrix) {
        let volumes = tangent.vertex_volumes(self.space(), change);
        let (pressures, slopes) = &self.linearised;
        let foreseen = pressures
            .iter()
            .zip(slopes)
            .zip(volumes)
            .map(|((p, slope), volume)| p + slope * volume);
        self.foreseen_kpa = foreseen.collect();
    }

    fn external_force(&self) -> f64 {
        self.external
    }

    fn reference(&self) -> &[f64] {
        self.problem.body.reference()
    }
}

/// Loads the body from `u`, an equilibrium without load (zeros), to the full load. Collective.
///
/// # Errors
/// [`StaticError`] when the smallest load step fails; `u` then is the last equilibrium.
pub fn load(
    problem: &StaticProblem<'_>,
    u: &mut Vec<f64>,
    steps: &LoadSteps,
) -> Result<StaticReport, StaticError> {
    let mut workspace = Workspace::new(problem.body.new_tangent());
    let mut report = StaticReport::default();
    let (mut reached, mut step, mut quick) = (0.0, steps.first.min(1.0), 0);
    let mut before: Option<(f64, Vec<f64>)> = None;
    while reached < 1.0 {
        let step_now = if reached + step > 1.0 - 1e-9 {
            1.0 - reached
        } else {
            step
        };
        let target = reached + step_now;
        let mut system = AtLoad {
            problem,
            load: target,
            active: problem.active.iter().map(|a| scaled(a, target)).collect(),
            deformation: Deformation::default(),
            linearised: (vec![], vec![]),
            foreseen_kpa: vec![],
            external: 0.0,
        };
        let mut trial = start(
            &mut system,
            u,
            before
                .as_ref()
                .map(|(l, b)| (step_now / (reached - l), b.as_slice())),
            steps,
        );
        match solve(&mut system, &mut trial, &mut workspace, &steps.newton) {
            Ok(newton) => {
                quick = if newton.iterations() <= steps.quick {
                    quick + 1
                } else {
                    0
                };
                if quick >= steps.grow_after {
                    step = (1.5 * step).min(steps.largest);
                    quick = 0;
                }
                report.steps.push(newton);
                before = Some((reached, std::mem::replace(u, trial)));
                reached = target;
            }
            Err(source) => {
                report.n_cut += 1;
                (step, quick) = (0.5 * step_now, 0);
                if step < steps.smallest {
                    return Err(StaticError {
                        load: reached,
                        step: step_now,
                        source,
                    });
                }
            }
        }
    }
    Ok(report)
}

fn scaled(active: &ActivePoint, load: f64) -> ActivePoint {
    ActivePoint {
        sa_kpa: active.sa_kpa.map(|x| load * x),
        slope_kpa: active.slope_kpa.map(|x| load * x),
    }
}

/// Start of Newton's method: the last equilibrium, extrapolated by `ratio` times its last change
/// unless an element would be inverted by it, with prescribed components at their target.
fn start(
    system: &mut AtLoad<'_, '_>,
    u: &[f64],
    last: Option<(f64, &[f64])>,
    steps: &LoadSteps,
) -> Vec<f64> {
    let prescribe = |system: &AtLoad<'_, '_>, u: &mut [f64]| {
        for (node, fixed) in system.problem.fixed.iter().enumerate() {
            for i in 0..3 {
                if fixed[i] {
                    let full = system
                        .problem
                        .prescribed
                        .get(3 * node + i)
                        .copied()
                        .unwrap_or(0.0);
                    u[3 * node + i] = system.load * full;
                }
            }
        }
    };
    if let Some((ratio, before)) = last {
        let mut guess: Vec<f64> = u
            .iter()
            .zip(before)
            .map(|(u, b)| u + ratio * (u - b))
            .collect();
        prescribe(system, &mut guess);
        if system.deform(&mut guess).volume_ratio > steps.newton.smallest_volume_ratio {
            return guess;
        }
    }
    let mut guess = u.to_vec();
    prescribe(system, &mut guess);
    guess
}
