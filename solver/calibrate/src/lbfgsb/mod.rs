//! Bounded limited-memory quasi-Newton minimisation (L-BFGS-B) with an ask-and-tell interface and
//! gradients by finite differences.
//!
//! Source: Byrd, Lu, Nocedal and Zhu 1995, SIAM J. Sci. Comput. 16:1190 (generalised Cauchy point,
//! subspace minimisation), with the projection of Morales and Nocedal 2011, ACM Trans. Math. Softw.
//! 38:7, and the line search of Moré and Thuente 1994, ACM Trans. Math. Softw. 20:286. These are
//! the methods and tolerances of `SciPy`'s `L-BFGS-B`. There are two differences: the matrix of at
//! most ten pairs is formed densely, since the problems here have about ten parameters, and a trial
//! whose cost is not finite halves the step.
//!
//! One batch is a point and its D differences, which makes D + 1 evaluations.

mod line_search;
mod model;
mod optimiser;
#[cfg(test)]
mod tests;

pub use optimiser::{DifferenceStep, Lbfgsb, LbfgsbError, Settings, StopReason};
