//! Precision with which a measured trace determines fitted quantities, and gaps that fits leave.

use std::collections::BTreeMap;

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

/// A gap that no named effect explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadUnexplained {
    /// Fall of BIC when the gap is added to the model.
    pub delta_bic: f64,
    /// Number of harmonics of the beat that describe the gap.
    pub n_harmonics: usize,
    /// Root mean square of the gap.
    #[serde(rename = "size_mmHg")]
    pub size_mmhg: f64,
    /// Time after the upstroke of the flow at which the gap is largest.
    pub largest_at_ms: f64,
    /// Share of the gap's variance that a cubic of each variable explains, by the variable's name.
    pub depends_on: BTreeMap<String, f64>,
}
