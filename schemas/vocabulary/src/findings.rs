//! Findings of the search for missing effects: the ranking, places of disagreement, the compared
//! traces, and the settings of the search.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Findings of a search for missing effects in a patient's traces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Findings {
    /// Whether no effect is named, because nothing is missing or because the gap is unexplained.
    pub none: bool,
    /// Candidates: accepted ones first, then those whose strength may get a name, then the rest, each by
    /// probability.
    pub effects: Vec<RankedEffect>,
    /// Names of the effects that the selection added to the model.
    pub accepted: Vec<String>,
    /// Names of effects that the data do not distinguish from the accepted ones.
    pub confusable: Vec<String>,
    /// Accepted effects with the rivals from which the data do not distinguish them.
    pub confusable_with: Vec<Confusable>,
    /// Classes of effects within which the data do not decide: of an accepted effect, which then comes
    /// first, or of effects that only together suffice for a name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub classes: Vec<EffectClass>,
    /// Measurements that would distinguish these effects.
    pub deciding_measurement: Vec<String>,
    /// Names of candidates that the data cannot show.
    pub not_identifiable: Vec<String>,
    /// Candidates that the data cannot show, with the data that would show them.
    pub not_identifiable_without: Vec<NotIdentifiable>,
    /// Gap that no candidate explains.
    pub unexplained: Option<Unexplained>,
    /// Gap that the accepted effects leave and no further effect explains; without accepted effects a
    /// gap that is weaker than an `unexplained` one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remaining: Option<Unexplained>,
    /// Rms standardised residual of the base model.
    pub gap_before: f64,
    /// Rms standardised residual with the accepted effects.
    pub gap_after: f64,
    /// Rms standardised residual of the base model on held-out data; absent if a refit failed.
    pub gap_heldout_before: Option<f64>,
    /// Rms standardised residual with the accepted effects on held-out data; absent if a refit
    /// failed.
    pub gap_heldout_after: Option<f64>,
    /// Probability that data of the base model alone give evidence as large as this.
    pub p_value: f64,
    /// Evidence that an effect needed to be named.
    pub threshold: f64,
    /// Evidence of the best nameless competitor.
    pub nameless_evidence: f64,
    /// Discrepancies between the base model and the data.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// Discrepancies at the same places with the accepted effects.
    pub where_after: Vec<Place>,
    /// Residuals by signal and phase, before and after, on fitted and held-out data.
    pub gaps: Vec<GapAt>,
}

/// Share by which the gap on held-out data must fall to confirm effects. A smaller fall may only follow
/// the noise.
const CONFIRMED: f64 = 0.02;

/// Whether effects reduce the gap on held-out data, from `before` to `after`, where both are known.
#[must_use]
pub fn held_out_confirm(before: Option<f64>, after: Option<f64>) -> bool {
    matches!((before, after), (Some(before), Some(after)) if after <= (1.0 - CONFIRMED) * before)
}

impl Findings {
    /// Whether held-out data confirm the accepted effects; `None` if nothing was accepted.
    #[must_use]
    pub fn confirmed(&self) -> Option<bool> {
        let (before, after) = (self.gap_heldout_before, self.gap_heldout_after);
        (!self.none).then(|| held_out_confirm(before, after))
    }

    /// Why held-out data do not confirm the accepted effects, in words; `None` where they do, and
    /// where nothing was accepted.
    #[must_use]
    pub fn unconfirmed(&self) -> Option<String> {
        if self.confirmed() != Some(false) {
            return None;
        }
        Some(match (self.gap_heldout_before, self.gap_heldout_after) {
            (Some(before), Some(after)) => format!(
                "held-out pressure and volume do not confirm it ({before:.2} without and {after:.2} with it)"
            ),
            _ => "held-out pressure and volume could not be predicted, so they do not confirm it"
                .to_owned(),
        })
    }
}

/// A candidate in the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RankedEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Meaning of the effect in one sentence.
    pub meaning: String,
    /// Whether the measurement is to be corrected rather than the heart.
    pub artefact: bool,
    /// Probability among all candidates, the nameless competitors and "nothing", from tempered
    /// evidence.
    pub probability: f64,
    /// Fall of the deviance less k ln n, where k is the number of the effect's parameters.
    pub delta_bic: f64,
    /// Twice the logarithm of the Bayes factor against the model without the effect.
    pub log_evidence: f64,
    /// Evidence like `log_evidence`, but with the best nameless competitor allowed in both models.
    /// It is the evidence that remains if something else is missing too.
    #[serde(default)]
    pub robust_evidence: f64,
    /// Fall of the deviance.
    pub delta_deviance: f64,
    /// Fitted parameters; their names carry the units.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 %.
    pub interval: BTreeMap<String, [f64; 2]>,
    /// Whether the strength exceeds the smallest meaningful one and lies inside its range.
    pub plausible: bool,
    /// Representation of the effect in the three-dimensional ventricle.
    pub in_3d: InThreeDimensions,
    /// Recommended action for an artefact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

/// Representation of an effect in a finite-element ventricle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct InThreeDimensions {
    /// Kind of representation: `as-it-is`, `activation-map`, `passive-exponents`, `material-term`
    /// or `cannot`.
    pub way: String,
    /// Derivation from the effect's parameters, or the reason why the effect cannot be represented.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub how: Option<String>,
}

/// A rival effect that the data do not distinguish from an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Confusable {
    /// The accepted effect.
    pub effect: String,
    /// Its rival effect.
    pub rival: String,
    /// Misfit that the rival leaves on noise-free output of the model with the accepted effect.
    pub expected_misfit: f64,
}

/// Effects of which one is missing, while the data do not tell which.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct EffectClass {
    /// Names of the effects, the most probable first.
    pub effects: Vec<String>,
    /// Sum of their probabilities.
    pub probability: f64,
}

/// A candidate that the data would not show even at a typical strength.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct NotIdentifiable {
    /// Name in the catalogue.
    pub name: String,
    /// Misfit that the effect leaves at a typical strength after the base model is refitted.
    pub expected_misfit: f64,
    /// Data that would show the effect.
    pub would_show: Vec<String>,
}

/// A discrepancy between model and data: a signal in a phase, or a scalar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Place {
    /// Signal `pressure`, `pressure_rate` or `volume`, or the name of the scalar.
    pub signal: String,
    /// Phase of the beat; `beat` for scalars.
    pub phase: String,
    /// Side of the model on which the data lie.
    pub sign: Side,
    /// Mean of data minus model.
    pub size: f64,
    /// Unit of `size`: mmHg, mmHg/s or mL.
    pub unit: String,
    /// Ratio of `size` to its standard deviation.
    pub z: f64,
    /// Share of the total misfit; 0 for rows that repeat other rows.
    pub share: f64,
    /// Measured biomarkers that the discrepancy affects.
    pub biomarkers: Vec<String>,
}

/// Side of the model on which the data lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// The data lie above the model.
    Above,
    /// The data lie below the model.
    Below,
}

/// A gap that no named effect explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Unexplained {
    /// Nameless competitor that explains the gap best: `activation` or `discrepancy`.
    pub kind: String,
    /// Evidence of this competitor against the model without it.
    pub log_evidence: f64,
    /// Largest discrepancy of the gap.
    pub place: Place,
    /// Variables that explain the discrepancy of pressure and volume, best first.
    pub depends_on: Vec<Dependence>,
}

/// How well one variable explains a discrepancy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Dependence {
    /// Signal, `pressure` or `volume`.
    pub signal: String,
    /// Variable: `time`, `volume`, `volume_rate`, `aortic_flow`, `aortic_flow_squared` or
    /// `pressure`.
    pub variable: String,
    /// Share of the discrepancy's variance that a cubic of the variable explains.
    pub share: f64,
}

/// Rms standardised residuals of a signal in a phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct GapAt {
    /// Signal, `pressure` or `volume`.
    pub signal: String,
    /// Phase of the beat, or `beat` for the whole beat.
    pub phase: String,
    /// Number of samples: pressure bins or volume frames.
    pub n: u32,
    /// Residual of the base model.
    pub before: f64,
    /// Residual with the accepted effects.
    pub after: f64,
    /// Residual of the base model on held-out data; absent if a refit failed.
    pub heldout_before: Option<f64>,
    /// Residual with the accepted effects on held-out data; absent if a refit failed.
    pub heldout_after: Option<f64>,
}

/// A signal at the times of its data. All lists have as many entries as `time_ms`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ComparedSignal {
    /// Times of the data.
    pub time_ms: Vec<f64>,
    /// Pressure bins in mmHg or volume frames in mL.
    pub measured: Vec<f64>,
    /// Values of the base model.
    pub before: Vec<f64>,
    /// Values with the accepted effects.
    pub after: Vec<f64>,
    /// Values of the base model fitted without the block of data that contains the sample.
    pub heldout_before: Option<Vec<f64>>,
    /// Values with the accepted effects, fitted without the block of data that contains the sample.
    pub heldout_after: Option<Vec<f64>>,
    /// Standard deviation of the noise of a sample.
    pub noise_sd: f64,
}

/// Simulated beats on a common grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SimulatedCurves {
    /// Times in the beat.
    pub time_ms: Vec<f64>,
    /// Pressure of the base model as it would be measured.
    #[serde(rename = "pressure_before_mmHg")]
    pub pressure_before_mmhg: Vec<f64>,
    /// Pressure with the accepted effects as it would be measured.
    #[serde(rename = "pressure_after_mmHg")]
    pub pressure_after_mmhg: Vec<f64>,
    /// Volume of the base model as it would be measured.
    #[serde(rename = "volume_before_mL")]
    pub volume_before_ml: Vec<f64>,
    /// Volume with the accepted effects as it would be measured.
    #[serde(rename = "volume_after_mL")]
    pub volume_after_ml: Vec<f64>,
}

/// Curves for figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct DiscoverSeries {
    /// Beginning of each phase, in the order of the beat.
    pub phases: Vec<PhaseBegin>,
    /// Measured and simulated pressure.
    pub pressure: ComparedSignal,
    /// Measured and simulated volume.
    pub volume: ComparedSignal,
    /// Simulated beats on a common grid.
    pub curves: SimulatedCurves,
}

/// Beginning of a phase, which is also the end of the previous phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PhaseBegin {
    /// Name of the phase.
    pub phase: String,
    /// Beginning of the phase in the cycle.
    pub begin_ms: f64,
}

/// Settings of a search that affect its answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SearchSettings {
    /// Names of all candidates that were tried.
    pub effects: Vec<String>,
    /// Smallest evidence with which an effect is named, its prior odds included: twice the logarithm of
    /// its posterior odds.
    pub least_evidence: f64,
    /// Probability that an effect is named although nothing is missing.
    pub false_alarm: f64,
    /// Number of bootstrap draws.
    pub n_bootstrap: u32,
    /// Largest number of effects of one patient.
    pub max_effects: u32,
}

impl Default for SearchSettings {
    /// The whole catalogue, and posterior odds of 9 to 1 for a name, which is given with 90 %: 2 ln 9.
    fn default() -> Self {
        Self {
            effects: Vec::new(),
            least_evidence: 4.4,
            false_alarm: 0.04,
            n_bootstrap: 2000,
            max_effects: 3,
        }
    }
}
