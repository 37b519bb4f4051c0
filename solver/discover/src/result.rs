//! Result of a search, as written to files.

use crate::calibration::Calibration;
use crate::locate::Phases;
use cardiotwin_vocabulary::findings::{
    Confusable, DiscoverSeries, GapAt, NotIdentifiable, Place, RankedEffect, Unexplained,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Complete result for one patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    /// Whether no effect is named.
    pub none: bool,
    /// Candidates: the accepted ones first, then by probability.
    pub effects: Vec<RankedEffect>,
    /// Names of the accepted effects.
    pub accepted: Vec<String>,
    /// Effects that cannot be distinguished from the accepted ones.
    pub confusable: Vec<Confusable>,
    /// Measurements that would distinguish them.
    pub deciding_measurement: Vec<String>,
    /// Candidates that these data cannot show.
    pub not_identifiable: Vec<NotIdentifiable>,
    /// A gap that no candidate explains, if any.
    pub unexplained: Option<Unexplained>,
    /// Rms standardised residual of the base model.
    pub gap_before: f64,
    /// Rms standardised residual of the accepted model.
    pub gap_after: f64,
    /// Rms standardised residual of the base model on data held out of the fit.
    pub gap_heldout_before: f64,
    /// Rms standardised residual of the accepted model on data held out of the fit.
    pub gap_heldout_after: f64,
    /// Probability that data of the base model alone give as much evidence (the largest over all
    /// candidates).
    pub p_value: f64,
    /// Evidence required for a name.
    pub threshold: f64,
    /// Evidence of the best nameless competitor.
    pub nameless_evidence: f64,
    /// Fitted base values with the accepted effects.
    pub base: BTreeMap<String, f64>,
    /// Fitted base values without effects.
    pub base_before: BTreeMap<String, f64>,
    /// Calibration errors too small for a name, estimated with the accepted model. Gaps and traces
    /// include them.
    #[serde(default)]
    pub calibration: Calibration,
    /// Places where the base model disagrees with the data.
    pub places: Vec<Place>,
    /// The same places for the model with the accepted effects.
    pub where_after: Vec<Place>,
    /// Noise power in the pressure's high band over the stated power; `None` if it was not used.
    pub noise_seen_over_stated: Option<f64>,
    /// Number of parameter sets for which beats were simulated.
    pub n_evaluations: usize,
    /// Phases of the beat.
    pub phases: Phases,
    /// Residuals by signal and phase, before and after, on fitted and on held-out data.
    pub gaps: Vec<GapAt>,
    /// What can be drawn.
    pub series: DiscoverSeries,
}
