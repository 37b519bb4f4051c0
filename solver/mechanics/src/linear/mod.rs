//! Sparse matrices of 3×3 blocks, Krylov solvers, preconditioners and a direct factorisation.

mod assembled;
mod block_csr;
mod direct;
mod dissection;
mod krylov;
mod multigrid;
mod packed;
mod preconditioner;
mod prefetch;
mod tangent;

pub use assembled::{Assembled, Operator, Sink};
pub use block_csr::{BlockCsr, Coupling, NO_SLOT, Pattern};
pub use direct::{Direct, DirectError};
pub use dissection::nested_dissection;
pub use krylov::{KrylovEnding, KrylovReport, KrylovSettings, conjugate_gradients, gmres, minres};
pub use multigrid::Multigrid;
pub use packed::{PackedBlock, PackedTangent, PackedVolume};
pub use preconditioner::{BlockJacobi, Preconditioner, SymmetricSweep};
pub use tangent::Tangent;

#[cfg(test)]
mod tests;
