//! Algorithms of the personalisation with an ask-and-tell interface: no model, clock or thread.
//! The calcium fit alone takes its curve, a closed form, from the models.
//!
//! The caller requests parameters, runs the simulations and returns the results. Every state can be
//! stored and continued, and the same history leads to the same proposal.

#![deny(missing_docs)]

pub mod afterload;
pub mod calcium_fit;
pub mod cma_es;
pub mod cohort_law;
mod descent;
pub mod differential_evolution;
pub mod fixed_point;
pub mod formulations;
pub mod identifiability;
mod interval;
pub mod latin_hypercube;
pub mod lbfgsb;
pub mod least_squares;
pub mod normal;
pub mod organ_law;
pub mod polish;
pub mod population;
pub mod posterior;
mod profile_interval;
mod random;
pub mod robustness;
pub mod sobol;
pub mod space_mapping;
pub mod statistics;
mod storage;
mod truncated_normal;

pub use interval::{Interval, IntervalError};
