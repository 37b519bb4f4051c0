//! What the levels ask of a matrix.

use crate::Pattern;

/// Entries of `K + G D Gᵀ`.
pub trait Entries {
    /// Pattern of `K` and `G`.
    fn pattern(&self) -> &Pattern;
    /// Block of `K`, an array of rows.
    fn stiffness(&self, slot: usize) -> [[f64; 3]; 3];
    /// Derivative of the row's volume with respect to the column's displacement.
    fn volume_of_row(&self, slot: usize) -> [f64; 3];
    /// Derivative of the column's volume with respect to the row's displacement.
    fn volume_of_column(&self, slot: usize) -> [f64; 3];
    /// `D` of all nodes held; empty without volume terms.
    fn bulk(&self) -> &[f64];
}
