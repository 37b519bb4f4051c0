//! Adaptive differential evolution (L-SHADE) with an ask-and-tell interface.
//!
//! Source: Tanabe and Fukunaga 2014, IEEE CEC, 1658 (success-history memory of mutation and
//! crossover, current-to-pbest mutation with an archive, population that shrinks linearly with the
//! evaluations). The ending and the bounded polish of
//! [`differential_evolution`](crate::differential_evolution) are added so that both strategies stop
//! by the same rules.
//!
//! A generation is one batch. Random numbers depend only on seed, generation and candidate.

mod memory;
mod optimiser;
#[cfg(test)]
mod tests;

pub use optimiser::{LShade, Settings, Stage};
