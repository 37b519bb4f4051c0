//! Result of a search, as written to files.

use crate::calibration::Calibration;
use crate::forward::Prediction;
use crate::phases::Phases;
use cardiotwin_vocabulary::findings::{DiscoverSeries, Findings};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Complete result for one patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    /// Findings of the search.
    #[serde(flatten)]
    pub findings: Findings,
    /// Fitted base values with the accepted effects.
    pub base: BTreeMap<String, f64>,
    /// Fitted base values without effects.
    pub base_before: BTreeMap<String, f64>,
    /// Calibration errors too small for a name, estimated with the accepted model. Gaps and traces
    /// include them.
    #[serde(default)]
    pub calibration: Calibration,
    /// Noise power in the pressure's high band over the stated power; `None` if it was not used.
    pub noise_seen_over_stated: Option<f64>,
    /// Number of parameter sets for which beats were simulated.
    pub n_evaluations: u64,
    /// Phases of the beat.
    pub phases: Phases,
    /// What can be drawn.
    pub series: DiscoverSeries,
    /// Beats of the base model and of the model with the accepted effects. They are found next to
    /// the fits, from orbits near by: a beat sought from rest may not settle in the same number of
    /// beats.
    #[serde(skip)]
    pub beats: [Prediction; 2],
}
