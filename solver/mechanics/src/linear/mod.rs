//! The tangent of a body's forces: how elements and surfaces put it together, and its storage in single precision.

mod assembled;
mod half;
mod packed;
mod packed_assembly;

pub use assembled::{Assembled, Sink};
pub use half::HalfTangent;
pub use packed::{PackedBlock, PackedTangent, PackedVolume};
