//! Finite-element mechanics of the left ventricle.
//!
//! - [`material`]: strain energies with stress and consistent tangent, active stress
//! - [`element`]: linear and quadratic tetrahedra, eight at a time
//! - [`body`]: assembly of forces and stiffness
//! - [`boundary`]: follower pressure, springs
//! - [`newton`], [`statics`]: equilibrium under a growing load
//! - [`linear`]: the tangent and its storage; solvers are in [`cardiotwin_linalg`]
//! - [`tissue`]: fibres and activation times on ranks
//! - [`number`]: the numbers that kernels are written over, SIMD vectors among them
//!
//! Units: mm, ms, mg, kPa, mN (coherent). Tensors are in the fibre frame.

#![deny(missing_docs)]
#![allow(
    clippy::needless_range_loop,
    reason = "tensor indices are read as indices"
)]
#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a comparison with NaN must end on the cautious side"
)]

pub mod body;
pub mod boundary;
pub mod dynamics;
pub mod element;
pub mod fibre_message;
pub mod linear;
pub mod material;
pub mod newton;
pub mod number;
pub mod organ;
pub mod statics;
pub mod step;
pub mod time_integration;
pub mod tissue;
