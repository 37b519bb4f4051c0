//! The search for missing effects: what it takes, what it finds, and the files in which a case and a cohort are written.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::organ::{EffectSpec, OneFibrePassive, WindkesselParameters};
use crate::patient::{AorticPressure, Diastasis, Noise, VolumeWithError};
use crate::task::InputFile;

pub use cardiotwin_vocabulary::findings::{
    ComparedSignal, Confusable, Dependence, DiscoverSeries, GapAt, InThreeDimensions,
    NotIdentifiable, PhaseBegin, Place, RankedEffect, Side, SimulatedCurves, Unexplained,
};

/// Everything that a search follows from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
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

/// A biomarker as measured and as both models have it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
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

/// The periodic beat with the filling pressure that the patient file states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
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
