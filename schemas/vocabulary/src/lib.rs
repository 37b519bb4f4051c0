//! The words of the field, each written once: biomarkers and the parameters of the models.
//!
//! Every crate may import this one. It holds types, their names in files, units and defaults; no file is read here and
//! no equation is solved.

pub mod biomarker_noise;
pub mod biomarkers;
pub mod cell;
pub mod failure_cause;
pub mod label;
pub mod step1;
pub mod step1_settings;
