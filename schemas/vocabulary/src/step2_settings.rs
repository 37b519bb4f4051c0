//! Settings of step 2 that its optimisers share with the files.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Population from which the trial vectors of a generation are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Updating {
    /// Each generation is computed as one batch from the previous population.
    #[default]
    Deferred,
    /// Each success takes effect immediately, as by default in SciPy. This is the reference mode.
    Immediate,
}
