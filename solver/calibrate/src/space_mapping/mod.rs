//! Space mapping: a cheap model, corrected to the runs of the expensive one, proposes the next
//! parameters.
//!
//! It is the alternative update of step 1 and the only update of step 3. Sources: space mapping,
//! Bandler et al. 1994, IEEE Trans. Microwave Theory Tech. 42:2536, in its form with output
//! correction; the dependence of the correction on the parameters from all runs as in manifold
//! mapping, Echeverría and Hemker 2005, Comput. Methods Appl. Math. 5:107; the trust region of
//! approximation management, Alexandrov et al. 1998, Struct. Optim. 15:16. Equations are in
//! docs/step1.md. [`propose()`] takes all runs, and equal runs lead to equal proposals.

mod correction;
mod minimise;
mod of_step1;
mod propose;
mod run;
mod trust;

pub use crate::truncated_normal::Prior;
pub use minimise::Effort;
pub use of_step1::{Step1Problem, Step1Run, plausible, propose_step1};
pub use propose::{Nearness, Problem, Proposal, Trial, propose};
pub use run::Run;

#[cfg(test)]
mod tests;
