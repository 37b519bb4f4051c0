//! The tables that several media show, each built once. `docs/architecture.md` says how to add a column.

pub mod biomarkers;
pub mod cohort;
pub mod discovery;
pub mod discovery_cohort;
pub mod motion;
pub mod robustness;
