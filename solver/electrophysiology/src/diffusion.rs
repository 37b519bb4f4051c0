//! Anisotropic diffusion of the potential on linear tetrahedra.

use cardiotwin_linalg::conjugate_gradients::{Directions, Measure, SymmetricSystem, iterate};
use cardiotwin_linalg::vec3::{Vec3, dot};
use cardiotwin_linalg::{Csr, Pattern};
use cardiotwin_mesh::tet_mesh::{Frame, shape_gradients};
use rayon::prelude::*;

/// Number of rows that a thread takes at once. Sums are computed chunk by chunk and added in order,
/// so that results do not depend on the number of threads.
const CHUNK: usize = 2048;

/// Number of iterations after which a solve counts as stalled; a sound mesh takes fewer than ten.
const MOST_ITERATIONS: usize = 500;

/// The conjugate gradients did not converge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stalled {
    /// Estimate of the remaining error \[mV\].
    pub error: f64,
    /// Number of iterations that were made.
    pub iterations: usize,
}

/// Solver for ∂V/∂t = ∇·(D ∇V) without flux at the boundary: Galerkin's method with linear elements
/// and a lumped mass matrix, and the Crank-Nicolson method in time. Both are of second order.
#[derive(Debug, Clone)]
pub struct Diffusion {
    /// Volumes of the nodes \[mm³\].
    mass: Vec<f64>,
    /// ∫ ∇φᵢ · D ∇φⱼ \[mm³/ms\].
    stiffness: Csr,
    /// mass + Δt/2 stiffness.
    matrix: Csr,
    /// Inverse of the matrix's diagonal.
    inverse: Vec<f64>,
    /// Sum of the matrix's diagonal.
    weight: f64,
    step_ms: f64,
    change: Vec<f64>,
    directions: Directions,
}

/// Root mean square of the preconditioned residual at which the solve of a step ends \[mV\].
const TOLERANCE_MV: f64 = 1e-7;

impl Diffusion {
    /// Solver on the elements `tets` between nodes at `nodes_mm`, with tissue directions `frames`,
    /// diffusivities along fibre, sheet and normal \[mm²/ms\], and steps of `step_ms`. Every node
    /// must belong to an element, and every element must have a positive volume.
    #[must_use]
    pub fn new(
        nodes_mm: &[Vec3],
        tets: &[[u32; 4]],
        frames: &[Frame],
        diffusivities_mm2_ms: [f64; 3],
        step_ms: f64,
    ) -> Self {
        let mut mass = vec![0.0; nodes_mm.len()];
        let mut stiffness = Csr::zeros(Pattern::of_elements(
            nodes_mm.len(),
            tets.iter().map(|tet| (&tet[..], &tet[..])),
        ));
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
                    stiffness.add(*row, *column, volume * flux);
                }
            }
        }
        let matrix = stiffness.scaled_plus_diagonal(0.5 * step_ms, &mass);
        let diagonal = matrix.diagonal();
        let weight = diagonal.iter().sum();
        let inverse = diagonal.iter().map(|d| 1.0 / d).collect();
        Self {
            mass,
            stiffness,
            matrix,
            inverse,
            weight,
            step_ms,
            change: vec![0.0; nodes_mm.len()],
            directions: Directions::new(nodes_mm.len()),
        }
    }

    /// Advances the potential by one step. Returns the number of solver iterations.
    ///
    /// # Errors
    /// [`Stalled`] if the solver does not converge; the potential is then unchanged.
    pub fn step(&mut self, v_mv: &mut [f64]) -> Result<usize, Stalled> {
        // Solves (M + Δt/2 K) W = −Δt K V for the change W over the step, starting from zero.
        multiply(&self.stiffness, v_mv, &mut self.directions.r);
        for value in &mut self.directions.r {
            *value *= -self.step_ms;
        }
        self.change.fill(0.0);
        let goal = TOLERANCE_MV * TOLERANCE_MV * self.weight;
        let system = Jacobi {
            matrix: &self.matrix,
            inverse: &self.inverse,
        };
        let (change, directions) = (&mut self.change, &mut self.directions);
        let ended = iterate(&system, change, directions, MOST_ITERATIONS, |squared| {
            squared <= goal || !squared.is_finite()
        });
        let is_met = ended.squared_size <= goal;
        if !is_met {
            return Err(Stalled {
                error: (ended.squared_size / self.weight).sqrt(),
                iterations: ended.iterations,
            });
        }
        for (v, change) in v_mv.iter_mut().zip(&self.change) {
            *v += change;
        }
        Ok(ended.iterations)
    }

    /// ∫ V \[mV mm³\], which diffusion conserves.
    #[must_use]
    pub fn integral(&self, v_mv: &[f64]) -> f64 {
        self.mass.iter().zip(v_mv).map(|(m, v)| m * v).sum()
    }
}

/// `y = A x`.
fn multiply(a: &Csr, x: &[f64], y: &mut [f64]) {
    if y.len() <= CHUNK {
        a.multiply_rows(0, x, y);
    } else {
        y.par_chunks_mut(CHUNK)
            .enumerate()
            .for_each(|(k, y)| a.multiply_rows(k * CHUNK, x, y));
    }
}

/// A matrix with a Jacobi preconditioner. The norm of residuals is that of the preconditioned ones,
/// weighted with the diagonal.
struct Jacobi<'a> {
    matrix: &'a Csr,
    inverse: &'a [f64],
}

impl SymmetricSystem for Jacobi<'_> {
    type Number = f64;

    fn precondition(&self, r: &[f64], z: &mut [f64]) {
        for ((z, r), inverse) in z.iter_mut().zip(r).zip(self.inverse) {
            *z = inverse * r;
        }
    }

    fn multiply(&self, p: &mut [f64], q: &mut [f64]) {
        multiply(self.matrix, p, q);
    }

    fn dot(&self, p: &[f64], q: &[f64]) -> f64 {
        let chunks = p.chunks(CHUNK).zip(q.chunks(CHUNK));
        chunks
            .map(|(p, q)| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>())
            .sum()
    }

    fn measure(&self, r: &[f64], z: &[f64]) -> Measure {
        let rz = self.dot(r, z);
        Measure {
            rz,
            squared_size: rz,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_potential_that_is_not_finite_stalls() {
        let nodes = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
        ];
        let frame = Frame {
            fibre: [1.0, 0.0, 0.0],
            sheet: [0.0, 1.0, 0.0],
            normal: [0.0, 0.0, 1.0],
        };
        let tets = [[0, 1, 2, 3]];
        let mut diffusion = Diffusion::new(&nodes, &tets, &[frame], [0.1; 3], 0.1);
        let mut v_mv = [-80.0, 20.0, -80.0, -80.0];
        assert!(diffusion.step(&mut v_mv).is_ok_and(|n| n <= 6));
        v_mv[0] = f64::NAN;
        assert!(diffusion.step(&mut v_mv).is_err());
    }
}
