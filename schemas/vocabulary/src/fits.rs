//! Precision with which a measured trace determines fitted quantities.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Information of a trace about two time constants that can be exchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TimeConstants {
    /// Two different time constants; equal ones do not fit.
    Distinct,
    /// Two different time constants fit best, but equal ones fit as well within the confidence
    /// level.
    Indistinct,
    /// Equal time constants fit best.
    Equal,
}

impl TimeConstants {
    /// Explanation for reports, in one sentence.
    #[must_use]
    pub fn explanation(self) -> &'static str {
        match self {
            Self::Distinct => {
                "the trace tells two time constants apart, but not which of them is the rise's: the transient is the \
                 same with both exchanged"
            }
            Self::Indistinct => {
                "two equal time constants fit the trace as well: only their mean is determined, and the transient is \
                 the same with both exchanged"
            }
            Self::Equal => {
                "the best time constants are equal: the transient is the same with both exchanged, and any difference \
                 makes it wider than the trace"
            }
        }
    }
}

/// How well a record determines a quantity.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Determined {
    /// The interval's half width is at most 30 % of the value.
    #[default]
    Well,
    /// The half width is more than 30 % of the value.
    Poorly,
    /// The interval has only one end or none.
    Not,
}
