//! The search for missing effects: what it takes, what it finds, and the files in which a case and a cohort are written.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::organ::{EffectSpec, OneFibrePassive, WindkesselParameters};
use crate::patient::{AorticPressure, Diastasis, Noise, VolumeWithError};
use crate::task::InputFile;

/// Everything that a search follows from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct DiscoverSpec {
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// Measured pressure trace.
    pub pressure: InputFile,
    /// Measured volume frames.
    pub volume: InputFile,
    /// Noise as the patient file states it; what is absent is estimated.
    #[serde(default)]
    pub noise: Noise,
    /// Arm cuff, independent of the catheter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aortic_pressure: Option<AorticPressure>,
    /// Net forward flow of a beat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forward_stroke_volume: Option<VolumeWithError>,
    /// Whole-heart image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diastasis: Option<Diastasis>,
    /// Wall volume; estimated when absent.
    #[serde(
        default,
        rename = "wall_volume_mL",
        skip_serializing_if = "Option::is_none"
    )]
    pub wall_volume_ml: Option<f64>,
    /// Filling pressure that the patient file states.
    #[serde(
        default,
        rename = "left_atrial_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub left_atrial_pressure_mmhg: Option<f64>,
    /// Windkessel that the patient file states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub afterload: Option<WindkesselParameters>,
    /// Candidates by their names in the catalogue; the whole catalogue when empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<String>,
    /// Seed of the bootstrap.
    pub seed: u64,
}

/// A candidate in the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
pub struct InThreeDimensions {
    /// `as-it-is`, `activation-map`, `passive-exponents`, `material-term` or `cannot`.
    pub way: String,
    /// How it follows from the parameters, or why it cannot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub how: Option<String>,
}

/// What cannot be told from an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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

/// A biomarker as measured and as both models have it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BiomarkerGap {
    /// Name with unit, as in `biomarkers`.
    pub name: String,
    /// As measured.
    pub measured: f64,
    /// Base model.
    pub before: Option<f64>,
    /// With the accepted effects.
    pub after: Option<f64>,
}

/// A signal at the times of its data. All lists have the length of `time_ms`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
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
#[schemars(deny_unknown_fields)]
pub struct PhaseBegin {
    /// Name of the phase.
    pub phase: String,
    /// Its beginning in the cycle.
    pub begin_ms: f64,
}

/// The periodic beat with the filling pressure that the patient file states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct StatedFilling {
    /// The stated pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Measured end-diastolic volume: the mean of the frames around end-diastole.
    #[serde(rename = "measured_mL")]
    pub measured_ml: f64,
    /// The base model's end-diastolic volume; none where it has no periodic beat.
    #[serde(rename = "before_mL")]
    pub before_ml: Option<f64>,
    /// That with the accepted effects.
    #[serde(rename = "after_mL")]
    pub after_ml: Option<f64>,
    /// Rms volume residual in diastasis and atrial systole, base model.
    #[serde(rename = "late_filling_before_mL")]
    pub late_filling_before_ml: Option<f64>,
    /// That with the accepted effects.
    #[serde(rename = "late_filling_after_mL")]
    pub late_filling_after_ml: Option<f64>,
}

/// What `--accept` writes: effects, corrections of the data, and the base values fitted with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FoundModel {
    /// Effects of heart and vessels.
    pub effects: Vec<EffectSpec>,
    /// Artefacts: the data are corrected for them.
    pub corrections: Vec<EffectSpec>,
    /// Arterial load.
    pub afterload: WindkesselParameters,
    /// Constant filling pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Passive law, through the volume at which the active stretch is 1.
    pub passive: OneFibrePassive,
}

/// Settings of a search that its answer depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SearchSettings {
    /// Candidates by name, all that were tried.
    pub effects: Vec<String>,
    /// Least evidence for a name.
    pub least_evidence: f64,
    /// Probability of a name where nothing is missing.
    pub false_alarm: f64,
    /// Draws of the bootstrap.
    pub n_bootstrap: u32,
    /// Most effects of one patient.
    pub max_effects: u32,
}

/// What the search found in a patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Discovered {
    /// Whether no effect is named: nothing is missing, or the gap is unexplained.
    pub none: bool,
    /// Candidates: accepted ones first, then by probability.
    pub effects: Vec<RankedEffect>,
    /// Names of the effects that the selection added to the model.
    pub accepted: Vec<String>,
    /// Names that cannot be told from the accepted ones.
    pub confusable: Vec<String>,
    /// Which cannot be told from which.
    pub confusable_with: Vec<Confusable>,
    /// Measurements that would separate those.
    pub deciding_measurement: Vec<String>,
    /// Names of candidates that these data cannot show.
    pub not_identifiable: Vec<String>,
    /// What would show them.
    pub not_identifiable_without: Vec<NotIdentifiable>,
    /// A gap that no candidate explains.
    pub unexplained: Option<Unexplained>,
    /// Rms standardised residual of the base model.
    pub gap_before: f64,
    /// The same with the accepted effects.
    pub gap_after: f64,
    /// The base model's on data held out; none where a refit failed.
    pub gap_heldout_before: Option<f64>,
    /// The same with the accepted effects.
    pub gap_heldout_after: Option<f64>,
    /// Probability that data of the base model alone give evidence as large.
    pub p_value: f64,
    /// Evidence that a name needed.
    pub threshold: f64,
    /// Evidence of the best nameless competitor.
    pub nameless_evidence: f64,
    /// Where the base model and the data disagree.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// The same places with the accepted effects.
    pub where_after: Vec<Place>,
    /// Residuals by signal and phase, before and after, on fitted and on held-out data.
    pub gaps: Vec<GapAt>,
    /// Biomarkers before and after.
    pub biomarkers: Vec<BiomarkerGap>,
    /// The periodic beat with the filling pressure of the patient file, where it states one.
    pub stated_filling: Option<StatedFilling>,
    /// Fitted base values with the accepted effects.
    pub base: BTreeMap<String, f64>,
    /// Fitted base values without effects.
    pub base_before: BTreeMap<String, f64>,
    /// What `--accept` writes.
    pub model: FoundModel,
    /// Noise power seen in the pressure's high band over the stated one.
    pub noise_seen_over_stated: Option<f64>,
    /// Simulated beats' parameter sets.
    pub n_evaluations: u64,
    /// What can be drawn.
    pub series: DiscoverSeries,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Settings of the search.
    pub settings: SearchSettings,
    /// SHA-256 of each input file, by role.
    pub data: BTreeMap<String, String>,
}

/// What `cardiotwin discover --json` writes of one patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DiscoverCase {
    /// Format version.
    pub schema_version: u32,
    /// The patient.
    pub case: String,
    /// The finding in plain language.
    pub summary: String,
    /// Key of the task that found it.
    pub task: String,
    /// What the beats of the cohort's run miss of the measured traces, where it personalised the patient.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<RunMisses>,
    /// What was found.
    #[serde(flatten)]
    pub found: Discovered,
}

/// What beats of a personalised patient miss of the measured traces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RunMisses {
    /// Of the pressure, mmHg; absent where it was not measured.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Option<TraceMisses>,
    /// Of the volume, mL; absent where it was not measured.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Option<TraceMisses>,
}

/// Root mean squares of simulated minus measured over one beat, in the trace's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TraceMisses {
    /// Of step 1's beat, whose active stress moved freely.
    pub step1: f64,
    /// Of the verification beat, with the cell that was fitted outside of the organ.
    pub verification: f64,
    /// Of the twin's beat.
    pub twin: f64,
}

impl TraceMisses {
    /// The share of the organ's model: no other active stress and no other cell of this run came nearer.
    #[must_use]
    pub fn of_organ(&self) -> f64 {
        self.step1.min(self.twin)
    }

    /// What the verification beat misses beyond that: the share of step 2's cell.
    #[must_use]
    pub fn of_cell(&self) -> f64 {
        (self.verification.powi(2) - self.of_organ().powi(2))
            .max(0.0)
            .sqrt()
    }
}

/// What `cardiotwin discover COHORT --json` writes: a case each, by name.
pub type DiscoverCases = BTreeMap<String, DiscoverCase>;

/// A candidate over a cohort.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PooledEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Patients in whom it was accepted.
    pub accepted_in: u32,
    /// Patients in whom it was tried.
    pub tried_in: u32,
    /// Sum over the patients of `robust_evidence`, each counted up to a largest share.
    pub log_evidence: f64,
    /// Whether more than half of the patients lack it: a fault of the model rather than of a patient.
    pub of_the_model: bool,
}
