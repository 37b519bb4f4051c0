//! Adaptive differential evolution by ask and tell: L-SHADE.
//!
//! Source: Tanabe and Fukunaga 2014, IEEE CEC, 1658 (success-history memory of mutation and crossover, current-to-pbest
//! mutation with an archive, population that shrinks linearly with the evaluations). Added: the ending and the bounded
//! polish of [`differential_evolution`](crate::differential_evolution), so that both stop alike.
//!
//! A generation is one batch. Random numbers depend on seed, generation and candidate only.

mod memory;
mod optimiser;
#[cfg(test)]
mod tests;

pub use optimiser::{LShade, Settings, Stage};
