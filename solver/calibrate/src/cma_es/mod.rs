//! Covariance matrix adaptation evolution strategy (CMA-ES) with restarts and an ask-and-tell
//! interface.
//!
//! Source: Hansen 2016, arXiv:1604.00772 (the strategy and its default parameters), Auger and
//! Hansen 2005, IEEE CEC, 1769 (restarts with twice the population), Hansen et al. 2009, IEEE
//! Trans. Evol. Comput. 13:180 (samples beyond a bound are evaluated on it and ranked with a
//! penalty for the distance). This implementation differs in two respects: besides the budget, it
//! ends when several runs have ended at the same best cost, and a restart may start anywhere in the
//! box.
//!
//! A generation is one batch. Random numbers depend only on seed, run, generation and candidate.

mod distribution;
mod optimiser;
#[cfg(test)]
mod tests;

pub use optimiser::{CmaEs, Settings, StopReason};
