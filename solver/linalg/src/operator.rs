//! Interface between matrices and iterative solvers, independent of the storage.

use crate::parallel::VectorLayout;

/// A matrix that multiplies nodal vectors with entries `T`.
pub trait Operator<T = f64> {
    /// Number of rows on this rank, one for each owned node.
    fn n_rows(&self) -> usize;

    /// `y = A x` over owned rows. Updates the ghosts of `x` first. Collective.
    fn multiply(&self, space: VectorLayout<'_>, x: &mut [T], y: &mut [T]);

    /// 3×3 diagonal block of a row of the whole matrix.
    fn diagonal(&self, row: usize) -> [f64; 9];
}
