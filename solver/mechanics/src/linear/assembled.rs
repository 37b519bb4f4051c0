//! What assembly and solvers ask of a matrix, whatever its storage.

use super::{PackedTangent, Pattern, Tangent};
use crate::parallel::Space;

/// A matrix that multiplies vectors over nodes.
pub trait Operator {
    /// `y = A x` over owned rows; brings ghosts of `x` up to date first. Collective.
    fn multiply(&self, space: Space<'_>, x: &mut [f64], y: &mut [f64]);

    /// The 3×3 diagonal block of a row, of the whole matrix.
    fn diagonal(&self, row: usize) -> [f64; 9];
}

/// Where elements put their stiffness.
#[derive(Debug)]
pub enum Sink<'a> {
    /// In double precision, for factorisations and tight solves.
    Full(&'a mut Tangent),
    /// In single precision, for the Krylov solvers of time steps.
    Packed(&'a mut PackedTangent),
}

/// A tangent that is put together from elements, surfaces and masses.
pub trait Assembled: Operator {
    /// Where its blocks are.
    fn pattern(&self) -> &Pattern;

    /// Sets all entries to zero, and the vertices' bulk stiffness \[kPa/mm³\], one a vertex.
    fn clear(&mut self, bulk: &[f64]);

    /// A block of the stiffness alone, row-major.
    fn stiffness_block(&self, slot: usize) -> [[f32; 3]; 3];

    /// `Gᵀ x`, the change of the vertices' volumes \[mm³\], ghosts up to date; empty without nodal volume change. Brings
    /// ghosts of `x` up to date first. Collective.
    fn vertex_volumes(&self, space: Space<'_>, x: &mut [f64]) -> Vec<f64>;

    /// For the elements' stiffness.
    fn sink(&mut self) -> Sink<'_>;

    /// Multiplies all of it by `k`.
    fn scale(&mut self, k: f64);

    /// Adds a block to the stiffness; does nothing at [`super::NO_SLOT`].
    fn add_block(&mut self, slot: u32, block: &[f64; 9]);

    /// Makes the rows and columns of fixed components those of the identity, times `scale`.
    ///
    /// - `fixed`: for each node which components are fixed
    fn constrain(&mut self, fixed: &[[bool; 3]], scale: f64);

    /// Mean of the absolute values on the stiffness's diagonal: a scale. Collective.
    fn mean_diagonal(&self, space: Space<'_>) -> f64;

    /// Adds `k` to the diagonal of a row.
    fn add_to_diagonal(&mut self, row: usize, k: f64) {
        let slot = self.pattern().slot(row as u32, row as u32);
        self.add_block(slot, &[k, 0.0, 0.0, 0.0, k, 0.0, 0.0, 0.0, k]);
    }
}
