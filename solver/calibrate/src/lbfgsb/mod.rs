//! Bounded limited-memory quasi-Newton minimisation by ask and tell, with gradients by finite differences.
//!
//! Source: Byrd, Lu, Nocedal and Zhu 1995, SIAM J. Sci. Comput. 16:1190 (generalised Cauchy point, subspace
//! minimisation), with the projection of Morales and Nocedal 2011, ACM Trans. Math. Softw. 38:7, and the line search of
//! Moré and Thuente 1994, ACM Trans. Math. Softw. 20:286: the methods and the tolerances of `SciPy`'s `L-BFGS-B`.
//! Differences from it: the matrix of at most ten pairs is formed densely (the problems here have some ten parameters),
//! and a trial whose cost is not finite halves the step.
//!
//! One batch is a point and its D differences: D + 1 evaluations.

mod line_search;
mod model;
mod optimiser;
#[cfg(test)]
mod tests;

pub use optimiser::{DifferenceStep, Ending, Lbfgsb, LbfgsbError, Settings};
