//! The reduced one-fibre ventricle: passive state and activation.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::one_fibre::OneFibrePassive;

/// Activation of the wall: `groups` equal parts, distributed over `spread_ms`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ActivationSpec {
    /// Time from the first to the last activation.
    pub spread_ms: f64,
    /// Number of parts with their own activation time.
    pub groups: u32,
    /// First activation from the start of the beat; negative if it comes before.
    pub onset_ms: f64,
}
