//! Result of a search, as written to files.

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
    /// Whether the measurement should be corrected rather than the heart.
    pub artefact: bool,
    /// Probability among all candidates, the nameless ones and "nothing", from tempered evidence.
    pub probability: f64,
    /// Fall of the deviance minus the price of its parameters, k ln n.
    pub delta_bic: f64,
    /// Twice the logarithm of the Bayes factor against the model without it (Laplace's
    /// approximation).
    pub log_evidence: f64,
    /// As `log_evidence`, if the best nameless competitor may explain the remaining gap in both
    /// models.
    #[serde(default)]
    pub robust_evidence: f64,
    /// Fall of the deviance.
    pub delta_deviance: f64,
    /// Fitted parameters.
    pub strength: BTreeMap<String, f64>,
    /// 95 % intervals from the linearised model, clamped to the range.
    pub interval: BTreeMap<String, [f64; 2]>,
    /// Whether the strength exceeds the smallest meaningful one and lies inside its range.
    pub plausible: bool,
}

/// An effect that cannot be distinguished from an accepted one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Confusable {
    /// Name of the accepted effect.
    pub effect: String,
    /// Name of the rival.
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
    /// Nameless competitor that explains the gap best: `activation` or `discrepancy`.
    pub kind: String,
    /// Evidence of the competitor against the model without it.
    pub log_evidence: f64,
    /// Signal and phase where the gap is largest.
    pub place: Place,
    /// Variables on which the discrepancies of pressure and volume depend, best first, with the
    /// explained share.
    pub depends_on: Vec<Dependence>,
}

/// Share of a discrepancy that one variable explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Dependence {
    /// `pressure` or `volume`.
    pub signal: String,
    /// Name of the variable.
    pub variable: String,
    /// Share of the discrepancy's variance that a cubic of the variable explains, corrected for the
    /// number of coefficients.
    pub share: f64,
}

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
    pub located: Vec<Place>,
    /// The same places for the model with the accepted effects.
    pub located_after: Vec<Place>,
    /// Noise power in the pressure's high band over the stated power; `None` if it was not used.
    pub noise_seen_over_stated: Option<f64>,
    /// Number of parameter sets for which beats were simulated.
    pub n_evaluations: usize,
    /// Data for figures and tables.
    pub series: Series,
}
