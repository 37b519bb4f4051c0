//! What the search finds, as it is written.

use crate::calibration::Calibration;
use crate::locate::Phases;
use cardiotwin_vocabulary::findings::{
    Confusable, DiscoverSeries, GapAt, NotIdentifiable, Place, RankedEffect, Unexplained,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Everything that is said of one patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    /// Whether no effect is named.
    pub none: bool,
    /// Candidates: accepted ones first, then by probability.
    pub effects: Vec<RankedEffect>,
    /// Names of the accepted ones.
    pub accepted: Vec<String>,
    /// What they cannot be told from.
    pub confusable: Vec<Confusable>,
    /// Measurements that would separate those.
    pub deciding_measurement: Vec<String>,
    /// Candidates that these data cannot show.
    pub not_identifiable: Vec<NotIdentifiable>,
    /// A gap that no candidate explains.
    pub unexplained: Option<Unexplained>,
    /// Rms standardised residual of the base model.
    pub gap_before: f64,
    /// The same of the accepted model.
    pub gap_after: f64,
    /// On data held out.
    pub gap_heldout_before: f64,
    /// The same of the accepted model.
    pub gap_heldout_after: f64,
    /// Probability that data of the base model alone give evidence as large (largest over all candidates).
    pub p_value: f64,
    /// Evidence that a name needed.
    pub threshold: f64,
    /// Evidence of the best nameless competitor.
    pub nameless_evidence: f64,
    /// Fitted base values, with the accepted effects.
    pub base: BTreeMap<String, f64>,
    /// Fitted base values without effects.
    pub base_before: BTreeMap<String, f64>,
    /// Calibration errors too small for a name, as estimated with the accepted model; gaps and traces are those with them.
    #[serde(default)]
    pub calibration: Calibration,
    /// Where the base model disagrees.
    pub places: Vec<Place>,
    /// The same places with the accepted effects.
    pub where_after: Vec<Place>,
    /// Noise power seen in the pressure's high band over the stated one.
    pub noise_seen_over_stated: Option<f64>,
    /// Simulated beats' parameter sets.
    pub n_evaluations: usize,
    /// Phases of the beat.
    pub phases: Phases,
    /// Residuals by signal and phase, before and after, on fitted and on held-out data.
    pub gaps: Vec<GapAt>,
    /// What can be drawn.
    pub series: DiscoverSeries,
}
