//! Findings of the search for missing effects: the ranking, places of disagreement, and the compared traces.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A candidate in the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RankedEffect {
    /// Name in the catalogue.
    pub name: String,
    /// What it is, in one sentence.
    pub meaning: String,
    /// Whether the measurement is to be corrected rather than the heart.
    pub artefact: bool,
    /// Probability among all candidates, the nameless ones and "nothing", from tempered evidence.
    pub probability: f64,
    /// Fall of the deviance less k ln n for its parameters.
    pub delta_bic: f64,
    /// Twice the logarithm of the Bayes factor against the model without it.
    pub log_evidence: f64,
    /// The same with the best nameless competitor allowed on either side: what is left of it if something else is missing too.
    #[serde(default)]
    pub robust_evidence: f64,
    /// Fall of the deviance.
    pub delta_deviance: f64,
    /// Fitted parameters; their names carry the units.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 %.
    pub interval: BTreeMap<String, [f64; 2]>,
    /// Whether the strength is above the smallest meaningful one and inside its range.
    pub plausible: bool,
    /// How the three-dimensional ventricle takes it over.
    pub in_3d: InThreeDimensions,
    /// What to do about an artefact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

/// How a finite-element ventricle takes an effect over.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InThreeDimensions {
    /// `as-it-is`, `activation-map`, `passive-exponents`, `material-term` or `cannot`.
    pub way: String,
    /// How it follows from the parameters, or why it cannot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub how: Option<String>,
}

/// What cannot be told from an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Confusable {
    /// The accepted effect.
    pub effect: String,
    /// Its rival.
    pub rival: String,
    /// Misfit that the rival leaves on noise-free output of the model with the effect.
    pub expected_misfit: f64,
}

/// A candidate that these data would not show even at a typical strength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NotIdentifiable {
    /// Name in the catalogue.
    pub name: String,
    /// Misfit that a typical strength leaves after the base is refitted.
    pub expected_misfit: f64,
    /// Data that would show it.
    pub would_show: Vec<String>,
}

/// A place where model and data disagree: a signal in a phase, or a scalar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// `pressure`, `pressure_rate`, `volume`, or the scalar's name.
    pub signal: String,
    /// Phase of the beat; `beat` for scalars.
    pub phase: String,
    /// `above` where the data lie above the model, else `below`.
    pub sign: Side,
    /// Mean of data minus model.
    pub size: f64,
    /// Its unit: mmHg, mmHg/s or mL.
    pub unit: String,
    /// Size over its standard deviation.
    pub z: f64,
    /// Share of the whole misfit; 0 for rows that repeat what others show.
    pub share: f64,
    /// Measured biomarkers that it moves.
    pub biomarkers: Vec<String>,
}

/// On which side of the model the data lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Above.
    Above,
    /// Below.
    Below,
}

/// A gap without a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Unexplained {
    /// Which nameless competitor explains it best: `activation` or `discrepancy`.
    pub kind: String,
    /// Its evidence against the model without it.
    pub log_evidence: f64,
    /// Where it is largest, and how large.
    pub place: Place,
    /// What the discrepancy of pressure and volume depends on, best first.
    pub depends_on: Vec<Dependence>,
}

/// How well one variable explains a discrepancy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Dependence {
    /// `pressure` or `volume`.
    pub signal: String,
    /// `time`, `volume`, `volume_rate`, `aortic_flow`, `aortic_flow_squared` or `pressure`.
    pub variable: String,
    /// Share of the discrepancy's variance that a cubic of it explains.
    pub share: f64,
}

/// Rms standardised residuals of a signal in a phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GapAt {
    /// `pressure` or `volume`.
    pub signal: String,
    /// Phase of the beat, or `beat` for all of it.
    pub phase: String,
    /// Number of samples: pressure bins or volume frames.
    pub n: u32,
    /// Base model.
    pub before: f64,
    /// With the accepted effects.
    pub after: f64,
    /// Base model on data held out; none where a refit failed.
    pub heldout_before: Option<f64>,
    /// With the accepted effects on data held out.
    pub heldout_after: Option<f64>,
}

/// A signal at the times of its data. All lists have the length of `time_ms`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ComparedSignal {
    /// Times of the data.
    pub time_ms: Vec<f64>,
    /// Pressure bins in mmHg or volume frames in mL.
    pub measured: Vec<f64>,
    /// Base model.
    pub before: Vec<f64>,
    /// With the accepted effects.
    pub after: Vec<f64>,
    /// Base model fitted without the block of data in which the sample lies.
    pub heldout_before: Option<Vec<f64>>,
    /// The same with the accepted effects.
    pub heldout_after: Option<Vec<f64>>,
    /// Standard deviation of a sample's noise.
    pub noise_sd: f64,
}

/// Simulated beats on a common grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulatedCurves {
    /// Times.
    pub time_ms: Vec<f64>,
    /// Base model, pressure as it would be measured.
    #[serde(rename = "pressure_before_mmHg")]
    pub pressure_before_mmhg: Vec<f64>,
    /// With the accepted effects.
    #[serde(rename = "pressure_after_mmHg")]
    pub pressure_after_mmhg: Vec<f64>,
    /// Base model, volume as it would be measured.
    #[serde(rename = "volume_before_mL")]
    pub volume_before_ml: Vec<f64>,
    /// With the accepted effects.
    #[serde(rename = "volume_after_mL")]
    pub volume_after_ml: Vec<f64>,
}

/// What can be drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiscoverSeries {
    /// Beginning of each phase, in the order of the beat.
    pub phases: Vec<PhaseBegin>,
    /// Pressure.
    pub pressure: ComparedSignal,
    /// Volume.
    pub volume: ComparedSignal,
    /// Simulated beats.
    pub curves: SimulatedCurves,
}

/// Where a phase begins; it ends where the next one does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhaseBegin {
    /// Name of the phase.
    pub phase: String,
    /// Its beginning in the cycle.
    pub begin_ms: f64,
}
