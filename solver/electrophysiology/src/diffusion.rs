//! Anisotropic diffusion of the potential on linear tetrahedra.

use crate::sparse::{ConjugateGradients, Stalled, SymmetricMatrix};
use cardiotwin_mesh::tet_mesh::{Frame, shape_gradients};
use cardiotwin_mesh::vec3::{Vec3, dot};

/// ∂V/∂t = ∇·(D ∇V) without flux at the boundary: Galerkin's method with linear elements and a lumped mass matrix, the
/// Crank-Nicolson method in time. Second order in both.
#[derive(Debug, Clone)]
pub struct Diffusion {
    /// Volumes of nodes, mm³.
    mass: Vec<f64>,
    /// ∫ ∇φᵢ · D ∇φⱼ, mm³/ms.
    stiffness: SymmetricMatrix,
    /// mass + Δt/2 stiffness.
    matrix: SymmetricMatrix,
    solver: ConjugateGradients,
    step_ms: f64,
    change: Vec<f64>,
    right: Vec<f64>,
}

/// Root mean square of the preconditioned residual at which a step's solve ends, mV.
const TOLERANCE_MV: f64 = 1e-7;

impl Diffusion {
    /// On elements `tets` between nodes at `nodes_mm`, each with its tissue's directions, for diffusivities along fibre,
    /// sheet and normal in mm²/ms and steps of `step_ms`. Every node belongs to an element, every element has a positive
    /// volume.
    #[must_use]
    pub fn new(
        nodes_mm: &[Vec3],
        tets: &[[u32; 4]],
        frames: &[Frame],
        diffusivities_mm2_ms: [f64; 3],
        step_ms: f64,
    ) -> Self {
        let mut mass = vec![0.0; nodes_mm.len()];
        let mut stiffness = SymmetricMatrix::zeros(nodes_mm.len(), tets);
        for (tet, frame) in tets.iter().zip(frames) {
            let (gradients, volume) = shape_gradients(tet.map(|node| nodes_mm[node as usize]));
            let axes = [frame.fibre, frame.sheet, frame.normal];
            let along = gradients.map(|gradient| axes.map(|axis| dot(axis, gradient)));
            for (i, row) in tet.iter().enumerate() {
                mass[*row as usize] += 0.25 * volume;
                for (j, column) in tet.iter().enumerate() {
                    let flux: f64 = (0..3)
                        .map(|k| diffusivities_mm2_ms[k] * along[i][k] * along[j][k])
                        .sum();
                    stiffness.add(*row as usize, *column, volume * flux);
                }
            }
        }
        let matrix = stiffness.scaled_plus_diagonal(0.5 * step_ms, &mass);
        let solver = ConjugateGradients::new(&matrix);
        let zeros = vec![0.0; nodes_mm.len()];
        Self {
            mass,
            stiffness,
            matrix,
            solver,
            step_ms,
            change: zeros.clone(),
            right: zeros,
        }
    }

    /// One step. Returns the iterations of the solver.
    ///
    /// # Errors
    /// [`Stalled`], and the potential is as before.
    pub fn step(&mut self, v_mv: &mut [f64]) -> Result<usize, Stalled> {
        // for the change W over the step: (M + Δt/2 K) W = −Δt K V
        self.stiffness.times(v_mv, &mut self.right);
        for value in &mut self.right {
            *value *= -self.step_ms;
        }
        self.change.fill(0.0);
        let iterations =
            self.solver
                .solve(&self.matrix, &self.right, &mut self.change, TOLERANCE_MV)?;
        for (v, change) in v_mv.iter_mut().zip(&self.change) {
            *v += change;
        }
        Ok(iterations)
    }

    /// ∫ V, mV mm³: what diffusion keeps.
    #[must_use]
    pub fn integral(&self, v_mv: &[f64]) -> f64 {
        self.mass.iter().zip(v_mv).map(|(m, v)| m * v).sum()
    }
}
