//! Robustness of personalisations (Jung et al. 2022, section 2.5): members of a child cohort, and the tables made of them.
//!
//! Whole personalisations, verification included, in one run of the engine. Everything here is pure: plans in, plans out;
//! records in, tables out. A record of an unfinished run gives the tables of what is there.

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
