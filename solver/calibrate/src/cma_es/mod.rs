//! The covariance matrix adaptation evolution strategy, with restarts, by ask and tell.
//!
//! Source: Hansen 2016, arXiv:1604.00772 (the strategy and its default parameters), Auger and Hansen 2005, IEEE CEC, 1769
//! (restarts with twice the population), Hansen et al. 2009, IEEE Trans. Evol. Comput. 13:180 (samples beyond a bound
//! are evaluated on it and ranked with a penalty for the distance). Ours: it ends when several runs have ended at the
//! same best cost, besides the budget; a restart begins anywhere in the box.
//!
//! A generation is one batch. Random numbers depend on seed, run, generation and candidate only.

mod distribution;
mod optimiser;
#[cfg(test)]
mod tests;

pub use optimiser::{CmaEs, Ending, Settings};
