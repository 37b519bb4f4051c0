//! Tetrahedra: shape functions, batches of eight elements, and the kernel that turns displacements into forces and stiffness.

pub mod batch;
pub mod kernel;
pub mod quadratic;
pub mod shape;

/// Elements that run together, one a SIMD lane.
pub const BATCH: usize = 8;

/// A number for each element of a batch.
pub type Eight = [f64; BATCH];
