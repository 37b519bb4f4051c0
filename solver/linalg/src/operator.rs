//! A matrix as iterative solvers see it, whatever its storage.

use crate::parallel::VectorLayout;

/// A matrix that multiplies vectors over nodes.
pub trait Operator {
    /// Number of rows held here, one a node.
    fn n_rows(&self) -> usize;

    /// `y = A x` over owned rows; brings ghosts of `x` up to date first. Collective.
    fn multiply(&self, space: VectorLayout<'_>, x: &mut [f64], y: &mut [f64]);

    /// The 3×3 diagonal block of a row, of the whole matrix.
    fn diagonal(&self, row: usize) -> [f64; 9];
}
