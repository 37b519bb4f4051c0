//! Pilots of a run, who teach the organ's law of its other patients (`workflow.pilots`). They are
//! kept once chosen: a patient who is added later does not change them, and so repeats no finished
//! work.

use cardiotwin_schemas::ids::PatientId;
use serde::{Deserialize, Serialize};

/// Key of the pilots, as JSON, in the table `meta`.
pub const PILOTS: &str = "pilots";
/// Key of what the pilots teach, as JSON, in the table `meta`; `null` until all have ended.
pub const LESSONS: &str = "lessons";

/// Pilots of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Pilots {
    /// Number of pilots that the settings asked for.
    pub n: u32,
    /// Pseudonyms of the pilots, sorted. There are fewer than asked for in a small cohort.
    pub names: Vec<PatientId>,
}
