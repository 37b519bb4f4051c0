//! Data that outlive a process or pass between two: cohorts, patients, settings, tasks, outcomes,
//! progress and provenance.
//!
//! The crate contains only serde types. Every format named here has a JSON Schema under
//! `schemas/json`. Keys carry their units (`pressure_mmHg`); the Rust names are the same words in
//! lower case.

mod absent;
pub mod afterload;
pub mod allocation;
pub mod beat_parameters;
pub mod cohort;
mod determination;
pub mod discover;
pub mod earlier;
pub mod external;
pub mod failure;
pub mod filling;
pub mod finite_element;
pub mod fit;
pub mod formats;
pub mod further;
pub mod hash;
pub mod heart;
pub mod ids;
mod input_file;
mod loads;
pub mod motion;
pub mod muscle;
pub mod notices;
mod one_fibre;
pub mod organ;
mod organ_beat;
pub mod organ_law;
pub mod outcome;
pub mod overlay;
pub mod patient;
pub mod plan;
pub mod posterior;
mod posterior_settings;
pub mod preparation;
pub mod progress;
pub mod provenance;
pub mod raw;
pub mod record;
pub mod robustness;
pub mod samples;
pub mod sensitivity;
pub mod settings;
pub mod shared;
pub mod status;
mod step0;
pub mod step3;
pub mod sweep;
pub mod task;
pub mod time;
pub mod verdict;

pub mod json_schemas;

pub use cardiotwin_vocabulary::{
    biomarker_noise, biomarkers, cell, json_schema, label, ranges, step1,
};
