//! Input from files to plans: reads a cohort, merges its layers of settings, checks everything at
//! once, and hashes the input files.
//!
//! Later layers replace earlier ones key by key: built-in defaults, `cohort.toml`, `[settings]` of
//! `patient.toml`, `--set`, and settings stored by `rerun` for the patient. Each leaf keeps its
//! origin.

#[cfg(test)]
mod both_ventricles_tests;
mod cohort;
mod complaint;
mod data;
mod document;
mod effects;
mod external;
mod further;
#[cfg(test)]
mod further_tests;
mod hashed;
mod law;
mod layers;
mod mesh;
mod nearest;
mod outside;
pub mod own_traces;
mod patient;
pub mod preparation;
mod ranges;
mod raw;
mod report;
mod resolve;
mod search;
mod seen;
mod shape;
#[cfg(test)]
mod tests;

pub use cohort::{Cohort, Options, Patient, check_on_top, load, load_alone, patients_of};
pub use document::{Node, Tree, value_from_text};
pub use effects::cannot_act_in_3d;
pub use layers::{COMMAND_LINE, Layer, Merged, Origin};
pub use mesh::problem as mesh_problem;
pub use nearest::nearest;
pub use patient::load_range;
pub use raw::{PREPARE_TOML, RawFolder, read_raw};
pub use report::{Finding, Report};
pub use resolve::with_overlay;
pub use search::specification;
pub use seen::Known;
