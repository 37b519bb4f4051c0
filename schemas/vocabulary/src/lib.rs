//! Vocabulary of the field, with one definition per term: biomarkers and the parameters of the
//! models.
//!
//! Every crate may import this one. It contains types with their names in files, units and
//! defaults. It reads no files and solves no equations.

pub mod biomarker_noise;
pub mod biomarkers;
pub mod cell;
pub mod circulation;
pub mod failure_cause;
pub mod fibres;
pub mod findings;
pub mod fits;
pub mod json_schema;
pub mod label;
mod labels;
pub mod measurements;
pub mod motion;
pub mod one_fibre;
pub mod organ_law;
pub mod passive_law;
pub mod preparation;
pub mod ranges;
pub mod statistics;
pub mod step1;
pub mod step1_settings;
pub mod step2_settings;
pub mod trace_noise;
pub mod verdict;
