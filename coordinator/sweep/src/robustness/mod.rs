//! Robustness of personalisations (Jung et al. 2022, section 2.5): members of a child cohort, and
//! the tables made from their results.
//!
//! Members are whole personalisations, including the verification, in one run of the engine. All
//! functions are pure: they make plans from plans and tables from records. From the record of an
//! unfinished run they make the tables of its finished members.

mod conditions;
mod design;
mod files;
mod paper;
mod tables;
#[cfg(test)]
mod tests;
mod values;

pub use cardiotwin_calibrate::robustness::{DATA_RANGE, GUESS_RANGE};
pub use design::{DesignError, Member, members};
pub use files::{members_csv, tables_csv, targets_csv};
pub use tables::{patients, result};
