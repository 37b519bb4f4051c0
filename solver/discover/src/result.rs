//! What the search finds, as it is written.

use crate::calibration::Calibration;
use crate::locate::Place;
use crate::series::Series;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A candidate in the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RankedEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Whether the measurement is to be corrected rather than the heart.
    pub artefact: bool,
    /// Probability among all candidates, the nameless ones and "nothing", from tempered evidence.
    pub probability: f64,
    /// Fall of the deviance less the price of its parameters, k ln n.
    pub delta_bic: f64,
    /// Twice the logarithm of the Bayes factor against the model without it (Laplace).
    pub log_evidence: f64,
    /// The same where the rest of the gap may be explained by the best nameless competitor, with it and without it.
    #[serde(default)]
    pub robust_evidence: f64,
    /// Fall of the deviance.
    pub delta_deviance: f64,
    /// Fitted parameters.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 % by the linearised model, cut to the range.
    pub interval: BTreeMap<String, [f64; 2]>,
    /// Whether the strength is above the smallest meaningful one and inside its range.
    pub plausible: bool,
}

/// What cannot be told from an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Confusable {
    /// The accepted effect.
    pub effect: String,
    /// Its rival.
    pub rival: String,
    /// Misfit that the rival leaves on noise-free output of the model with the effect.
    pub expected_misfit: f64,
}

/// A candidate that these data would not show even at a typical strength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NotIdentifiable {
    /// Name in the catalogue.
    pub name: String,
    /// Misfit that a typical strength leaves after the base is refitted (linearised).
    pub expected_misfit: f64,
    /// Data that would show it.
    pub would_show: Vec<String>,
}

/// A gap without a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unexplained {
    /// Which nameless competitor explains it best: `activation` or `discrepancy`.
    pub kind: String,
    /// Its evidence against the model without it.
    pub log_evidence: f64,
    /// Where it is largest.
    pub place: Place,
    /// What the discrepancy of the pressure and of the volume depends on, best first, with the share explained.
    pub depends_on: Vec<Dependence>,
}

/// How well one variable explains a discrepancy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Dependence {
    /// `pressure` or `volume`.
    pub signal: String,
    /// The variable.
    pub variable: String,
    /// Share of the discrepancy's variance that a cubic of it explains, corrected for the number of coefficients.
    pub share: f64,
}

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
    pub located: Vec<Place>,
    /// The same places with the accepted effects.
    pub located_after: Vec<Place>,
    /// Noise power seen in the pressure's high band over the stated one.
    pub noise_seen_over_stated: Option<f64>,
    /// Simulated beats' parameter sets.
    pub n_evaluations: usize,
    /// What can be drawn and tabulated.
    pub series: Series,
}
