//! Tetrahedra: shape functions, batches of eight elements, and the kernel for forces and stiffness.

pub mod batch;
pub mod kernel;
pub mod quadratic;
pub mod shape;

/// Number of elements in a batch, one per SIMD lane.
pub const BATCH: usize = 8;

/// A number for each element of a batch.
pub type Eight = [f64; BATCH];
