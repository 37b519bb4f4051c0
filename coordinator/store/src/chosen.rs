//! Options chosen for a run, which the next `run` uses again, and the settings that they led to.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Key of the choice, as JSON, in the table `meta`.
pub const CHOSEN: &str = "chosen";

/// Choice of the last `run`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Chosen {
    /// Settings chosen on the command line: value by dotted key, as typed.
    pub set: BTreeMap<String, String>,
    /// The cohort's settings after all layers.
    pub settings: Value,
}
