//! Single kernels of a time step, for measurements of their speed.

use cardiotwin_linalg::{KrylovSettings, SingleBlockJacobi, conjugate_gradients};

use crate::body::Deformation;
use crate::dynamics::{Candidate, Dynamics, State};
use crate::element::BATCH;
use crate::element::kernel::ActivePoint;
use crate::linear::{HalfTangent, PackedTangent};
use crate::time_integration::Motion;

/// A kernel of a time step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// Volume ratios, stretches and nodal pressures.
    Deform,
    /// Internal forces of the elements.
    Forces,
    /// Internal forces and stiffness of the elements, scattered into the tangent.
    Tangent,
    /// The given number of conjugate-gradient iterations with block Jacobi, on the matrix of a step of 1 ms.
    Krylov(u32),
}

impl Kernel {
    pub(super) fn encoded(self) -> [f64; 2] {
        match self {
            Self::Deform => [0.0; 2],
            Self::Forces => [1.0, 0.0],
            Self::Tangent => [2.0, 0.0],
            Self::Krylov(n) => [3.0, f64::from(n)],
        }
    }

    pub(super) fn decoded([code, n]: [f64; 2]) -> Self {
        match code as u32 {
            0 => Self::Deform,
            1 => Self::Forces,
            2 => Self::Tangent,
            _ => Self::Krylov(n as u32),
        }
    }
}

/// Buffers of the kernels, made for the first one.
#[derive(Debug)]
pub(super) struct Bench {
    candidate: Candidate,
    force: Vec<f64>,
    residual: Vec<f64>,
    tangent: PackedTangent,
    /// Its copy for products.
    half: HalfTangent,
    /// Whether the tangent belongs to a time step.
    linearised: bool,
}

const STEP_MS: f64 = 1.0;

impl Bench {
    /// Buffers at the committed displacement under a constant active stress; `None` for elements without a tangent in single
    /// precision. Collective.
    pub(super) fn new(dynamics: &Dynamics, now: &State) -> Option<Self> {
        let u = now.motion.u.clone();
        let n = u.len();
        let mut candidate = Candidate {
            motion: Motion {
                u,
                ..Motion::default()
            },
            pressure_kpa: now.pressure_kpa,
            active: vec![
                ActivePoint {
                    sa_kpa: [40.0; BATCH],
                    slope_kpa: [20.0; BATCH]
                };
                dynamics.body.n_point_batches()
            ],
            deformation: Deformation::default(),
            ..Candidate::default()
        };
        let tangent = dynamics.body.new_packed_tangent()?;
        dynamics.complete(STEP_MS, now, &mut candidate);
        Some(Self {
            candidate,
            force: vec![0.0; n],
            residual: vec![0.0; n],
            tangent,
            half: HalfTangent::zeros(dynamics.body.pattern().clone()),
            linearised: false,
        })
    }

    /// Runs a kernel, then waits for all ranks. Collective.
    pub(super) fn run(&mut self, kernel: Kernel, dynamics: &Dynamics, now: &State) {
        let (body, comm) = (&dynamics.body, dynamics.comm.as_ref());
        let Self {
            candidate,
            force,
            residual,
            tangent,
            half,
            linearised,
        } = self;
        let Candidate {
            shifted,
            active,
            deformation,
            ..
        } = candidate;
        match kernel {
            Kernel::Deform => body.deform(shifted, comm, deformation),
            Kernel::Forces => body.add_forces(shifted, active, deformation, force),
            Kernel::Tangent => {
                body.tangent(shifted, active, deformation, force, tangent);
                *linearised = false;
            }
            Kernel::Krylov(n) => {
                if !*linearised {
                    dynamics.linearise(STEP_MS, now, candidate, force, residual, tangent);
                    half.copy_from(tangent);
                    *linearised = true;
                }
                let mut x = vec![0.0; force.len()];
                let jacobi = SingleBlockJacobi::new(tangent);
                let settings = KrylovSettings {
                    relative_tolerance: 0.0,
                    max_iterations: n as usize,
                    ..KrylovSettings::default()
                };
                conjugate_gradients::<f32>(
                    dynamics.space(),
                    half,
                    &jacobi,
                    &candidate.load,
                    &mut x,
                    &settings,
                );
            }
        }
        comm.sum(&mut [0.0]);
    }

    /// Bytes that a product with the tangent reads and writes, for `n_local` nodes.
    pub(super) fn bytes_of_product(&self, n_local: usize) -> usize {
        self.half.bytes_of_product(n_local)
    }
}
