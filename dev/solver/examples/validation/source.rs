//! Sources of the beats that become cases.

use crate::self_consistent;
use cardiotwin_validation::simulated::{self, SimulatedBeat};
use cardiotwin_validation::{Case, Further, Hearts, Measurement, PlannedCase};

/// Model that makes the beats.
pub enum Source {
    /// The independent closed loop.
    Loop(Hearts),
    /// The model that is fitted.
    Fitted,
    /// Beats that another program simulated for the planned cases.
    Beats(Vec<SimulatedBeat>),
}

impl Source {
    /// Reads simulated beats, one JSON object a line.
    pub fn beats(file: &str) -> Result<Self, String> {
        let text = std::fs::read_to_string(file).map_err(|e| format!("{file}: {e}"))?;
        let (beats, _) = simulated::parse(&text).map_err(|e| format!("{file}: {e}"))?;
        Ok(Self::Beats(beats))
    }

    /// Hearts of the planned cases; other sources take their cycle length from the loop.
    pub fn hearts(&self) -> Hearts {
        match self {
            Self::Loop(hearts) => *hearts,
            Self::Fitted | Self::Beats(_) => Hearts::Elastance,
        }
    }

    /// Name in descriptions.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Loop(Hearts::Sarcomeres) => "an independent closed loop with sarcomeres",
            Self::Loop(Hearts::Elastance | Hearts::Extreme) => "an independent closed loop",
            Self::Fitted => "the model that is fitted",
            Self::Beats(_) => "finite-element ventricles",
        }
    }

    /// The measured case; `None` if the source has no plausible patient with these effects.
    pub fn make(&self, planned: &PlannedCase) -> Option<Case> {
        match self {
            Self::Loop(_) => planned.make(),
            Self::Fitted => self_consistent::make(planned),
            Self::Beats(beats) => beats
                .iter()
                .find(|beat| beat.case == planned.id && beat.seed == planned.seed())
                .map(|beat| planned.measure(beat)),
        }
    }

    /// Further measurements of a case; `None` if the source has no beats for them.
    pub fn further(
        &self,
        planned: &PlannedCase,
        case: &Case,
        wanted: &[Measurement],
    ) -> Option<Further> {
        let beats = match self {
            _ if wanted.is_empty() => return Some(Further::default()),
            Self::Loop(_) => planned.beats(case, wanted)?,
            Self::Fitted => self_consistent::beats(planned, case, wanted)?,
            Self::Beats(_) => return None,
        };
        Some(planned.further(case, &beats, wanted))
    }
}
