//! Linear algebra shared by meshes, potentials and mechanics.
//!
//! - [`vec3`]: vectors of three numbers
//! - [`Pattern`], [`Csr`], [`BlockCsr`], [`Coupling`]: sparse matrices by rows
//! - [`mod@conjugate_gradients`]: the common loop of conjugate gradients, for any kind of vectors
//! - [`conjugate_gradients()`], [`minres`], [`gmres`]: Krylov methods on ranks, and their
//!   [`Preconditioner`]s
//! - [`parallel`]: an interface for all global operations, and partitions of meshes
//!
//! Features: `direct` provides [`Direct`] factorisations, [`Multigrid`] and [`RigidLevels`] (crate `faer`); `metis`
//! partitions meshes with METIS. Crates that only read meshes leave both out, so that the
//! coordinator builds without these libraries.

#![deny(missing_docs)]
#![allow(clippy::needless_range_loop, reason = "components are read as indices")]
#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a comparison with NaN must end on the cautious side"
)]

mod block_csr;
mod condensed;
pub mod conjugate_gradients;
mod csr;
#[cfg(feature = "direct")]
mod direct;
#[cfg(feature = "direct")]
mod dissection;
mod krylov;
#[cfg(feature = "direct")]
mod multigrid;
mod operator;
pub mod parallel;
mod pattern;
mod preconditioner;
mod prefetch;
#[cfg(feature = "direct")]
mod rigid_levels;
pub mod vec3;

pub use block_csr::{BlockCsr, Coupling};
pub use condensed::CondensedMatrix;
pub use csr::Csr;
#[cfg(feature = "direct")]
pub use direct::{Direct, DirectError};
#[cfg(feature = "direct")]
pub use dissection::nested_dissection;
pub use krylov::{KrylovEnding, KrylovReport, KrylovSettings, conjugate_gradients, gmres, minres};
#[cfg(feature = "direct")]
pub use multigrid::Multigrid;
pub use operator::Operator;
pub use pattern::{NO_SLOT, Pattern};
pub use preconditioner::{BlockJacobi, Preconditioner, SingleBlockJacobi, SymmetricSweep};
pub use prefetch::prefetch;
#[cfg(feature = "direct")]
pub use rigid_levels::{Entries, RigidLevels, WithLevels};

#[cfg(all(test, feature = "direct"))]
mod tests;
