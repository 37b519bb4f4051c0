//! Sobol sensitivity analysis of the 0D cell (Jung et al. 2022, sections 2.4 and 3.1).
//!
//! - [`spec`]: the paper's settings and the changes to them
//! - [`chunks`]: the tasks of a sweep, each a number of complete Saltelli blocks
//! - [`samples`]: the results of the chunks, judged by the exclusion rule
//! - [`analysis`]: indices and ranking of any number of first blocks
//! - [mod@reference]: published and independent results for comparison
//! - [`selection`]: the ranking as step 2's list of parameters
//! - [`tables`]: CSV files

pub mod analysis;
pub mod chunks;
pub mod reference;
pub mod samples;
pub mod selection;
pub mod spec;
pub mod tables;
