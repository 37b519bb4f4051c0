//! Cheap preconditioners: block Jacobi, and a symmetric sweep over the nodes of a rank.

use crate::parallel::VectorLayout;
use crate::{CondensedMatrix, Operator};

/// An approximate inverse of a matrix for vectors with entries `T`. It is linear, and it must be symmetric for CG and MINRES.
pub trait Preconditioner<T = f64> {
    /// `z ≈ A⁻¹ r` over owned nodes.
    fn apply(&self, space: VectorLayout<'_>, r: &[T], z: &mut [T]);
}

/// Inverse of a 3×3 block. For a singular block it is the identity divided by the mean of the
/// block's diagonal, or the identity itself if this mean is zero.
fn inverse(b: &[f64; 9]) -> [f64; 9] {
    let cof = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        b[3 * r1 + c1] * b[3 * r2 + c2] - b[3 * r1 + c2] * b[3 * r2 + c1]
    };
    let det: f64 = (0..3).map(|c| b[c] * cof(0, c)).sum();
    let trace = b[0] + b[4] + b[8];
    if det.abs() > 1e-14 * trace.abs().powi(3) {
        std::array::from_fn(|k| cof(k % 3, k / 3) / det)
    } else {
        let d = if trace == 0.0 { 1.0 } else { 3.0 / trace.abs() };
        std::array::from_fn(|k| if k % 4 == 0 { d } else { 0.0 })
    }
}

fn times(b: &[f64; 9], v: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| b[3 * i] * v[0] + b[3 * i + 1] * v[1] + b[3 * i + 2] * v[2])
}

/// Inverses of the nodes' diagonal blocks.
#[derive(Debug, Clone)]
pub struct BlockJacobi {
    inverses: Vec<[f64; 9]>,
}

impl BlockJacobi {
    /// Inverts the diagonal blocks of `matrix`.
    #[must_use]
    pub fn new(matrix: &dyn Operator) -> Self {
        Self {
            inverses: (0..matrix.n_rows())
                .map(|r| inverse(&matrix.diagonal(r)))
                .collect(),
        }
    }
}

impl Preconditioner for BlockJacobi {
    fn apply(&self, _space: VectorLayout<'_>, r: &[f64], z: &mut [f64]) {
        let (r, _) = r.as_chunks::<3>();
        let (z, _) = z.as_chunks_mut::<3>();
        for ((inverse, r), z) in self.inverses.iter().zip(r).zip(z) {
            *z = times(inverse, r);
        }
    }
}

/// [`BlockJacobi`] of a symmetric matrix in single precision: the upper triangles of the inverses, row by row.
#[derive(Debug, Clone)]
pub struct SingleBlockJacobi {
    inverses: Vec<[f32; 6]>,
}

impl SingleBlockJacobi {
    /// Inverts the diagonal blocks of `matrix`.
    #[must_use]
    pub fn new(matrix: &dyn Operator) -> Self {
        let upper = |row: usize| {
            let b = inverse(&matrix.diagonal(row));
            let mean = |i: usize, j: usize| (0.5 * (b[3 * i + j] + b[3 * j + i])) as f32;
            [
                mean(0, 0),
                mean(0, 1),
                mean(0, 2),
                mean(1, 1),
                mean(1, 2),
                mean(2, 2),
            ]
        };
        Self {
            inverses: (0..matrix.n_rows()).map(upper).collect(),
        }
    }
}

impl Preconditioner<f32> for SingleBlockJacobi {
    fn apply(&self, _space: VectorLayout<'_>, r: &[f32], z: &mut [f32]) {
        let (r, _) = r.as_chunks::<3>();
        let (z, _) = z.as_chunks_mut::<3>();
        for ((b, r), z) in self.inverses.iter().zip(r).zip(z) {
            *z = [
                b[0] * r[0] + b[1] * r[1] + b[2] * r[2],
                b[1] * r[0] + b[3] * r[1] + b[4] * r[2],
                b[2] * r[0] + b[4] * r[1] + b[5] * r[2],
            ];
        }
    }
}

/// Symmetric block Gauss–Seidel over the nodes of a rank, with one forward and one backward sweep,
/// `(D+L) D⁻¹ (D+U)`. It uses the off-diagonal blocks of `K` and the diagonal blocks of the whole
/// matrix.
#[derive(Debug)]
pub struct SymmetricSweep<'a> {
    tangent: &'a CondensedMatrix,
    diagonal: Vec<[f64; 9]>,
    inverses: Vec<[f64; 9]>,
}

impl<'a> SymmetricSweep<'a> {
    /// Prepares the sweeps of `tangent`.
    #[must_use]
    pub fn new(tangent: &'a CondensedMatrix) -> Self {
        let diagonal: Vec<[f64; 9]> = (0..tangent.stiffness.pattern.n_rows())
            .map(|r| tangent.diagonal(r))
            .collect();
        let inverses = diagonal.iter().map(inverse).collect();
        Self {
            tangent,
            diagonal,
            inverses,
        }
    }
}

impl Preconditioner for SymmetricSweep<'_> {
    fn apply(&self, _space: VectorLayout<'_>, r: &[f64], z: &mut [f64]) {
        let pattern = &self.tangent.stiffness.pattern;
        let blocks = &self.tangent.stiffness.blocks;
        let (r, _) = r.as_chunks::<3>();
        let (z, _) = z.as_chunks_mut::<3>();
        for row in 0..pattern.n_rows() {
            let mut sum = r[row];
            for k in pattern
                .row(row)
                .take_while(|k| (pattern.column[*k] as usize) < row)
            {
                let t = times(&blocks[k], &z[pattern.column[k] as usize]);
                (0..3).for_each(|i| sum[i] -= t[i]);
            }
            z[row] = times(&self.inverses[row], &sum);
        }
        for row in (0..pattern.n_rows()).rev() {
            let mut sum = times(&self.diagonal[row], &z[row]);
            for k in pattern
                .row(row)
                .rev()
                .take_while(|k| pattern.column[*k] as usize > row)
            {
                if (pattern.column[k] as usize) < pattern.n_rows() {
                    let t = times(&blocks[k], &z[pattern.column[k] as usize]);
                    (0..3).for_each(|i| sum[i] -= t[i]);
                }
            }
            z[row] = times(&self.inverses[row], &sum);
        }
    }
}
