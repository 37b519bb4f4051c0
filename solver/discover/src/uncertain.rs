//! Numbers with standard deviations.

use serde::{Deserialize, Serialize};

/// A number with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Uncertain {
    /// Value of the quantity.
    pub value: f64,
    /// Standard deviation, in the value's unit.
    pub sd: f64,
}
