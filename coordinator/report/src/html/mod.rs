//! The report: self-contained HTML from a run's record. The module accesses neither store nor
//! network.
//!
//! Up to [`ONE_FILE`] patients make one file; more patients make an index with a page per patient
//! next to it.

mod afterload;
mod anchor;
mod calcium_fit;
mod cell_parameters;
mod cohort;
mod convergence;
mod discovery;
mod figures;
pub(crate) mod format;
mod fragment;
mod organ_3d;
mod organ_law;
mod page;
mod patient;
mod plot;
mod posterior;
pub mod prediction;
pub mod preparation;
mod provenance;
mod robustness;
pub mod sensitivity;
mod summary;
mod tables;
mod write;

pub use afterload::{afterload_discovery_svg, afterload_fit_svg, cuff_fit_svg};
pub use calcium_fit::calcium_fit_svg;
pub use discovery::{discovery_svg, write_discovery};
pub use fragment::{heart_viewer, patient_section, script, style_sheet};
pub use organ_3d::spread_svg;
pub use robustness::write_robustness;
pub use write::{Index, ONE_FILE, Pages, ReportPaths, patient_page, shows, write_report};
