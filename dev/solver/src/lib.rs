//! Verification, evaluations, figures and benchmarks of the solver: examples, benches and tests, and
//! what they share.

#![allow(
    clippy::needless_range_loop,
    reason = "tensor indices are read as indices"
)]
#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a comparison with NaN must end on the cautious side"
)]

pub mod prescribed;
