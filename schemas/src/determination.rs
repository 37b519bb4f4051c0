//! Degree to which data determine a parameter.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Degree to which the data determine a fitted parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Determination {
    /// Near-optimal values fill at most a fifth of the interval between the bounds and lie away
    /// from the bounds.
    Determined,
    /// Near-optimal values fill more than a fifth of the interval.
    Sloppy,
    /// Near-optimal values fill at most a fifth of the interval, but the best value is a bound. The
    /// data favour values beyond it.
    AtBound,
    /// Near-optimal values extend from bound to bound. The data do not determine the parameter.
    NotDetermined,
}

impl Determination {
    /// Word for this result in reports.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Determined => "determined",
            Self::Sloppy => "weakly identified",
            Self::AtBound => "at bound",
            Self::NotDetermined => "not determined",
        }
    }
}
