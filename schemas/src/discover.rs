//! Settings and results of the search for missing effects, and its files for a case and for a
//! cohort.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::further::{FurtherTraceSpec, LoadedBeatSpec, QrsWidth, ValveTimes};
use crate::input_file::InputFile;
use crate::organ::{EffectSpec, OneFibrePassive, WindkesselParameters};
use crate::patient::{AorticPressure, Diastasis, Noise, VolumeWithError};

pub use cardiotwin_vocabulary::findings::{
    ComparedSignal, Confusable, Dependence, DiscoverSeries, EffectClass, Findings, GapAt,
    InThreeDimensions, NotIdentifiable, PhaseBegin, Place, RankedEffect, SearchSettings, Side,
    SimulatedCurves, Unexplained, held_out_confirm,
};
pub use cardiotwin_vocabulary::verdict::{BY_CHANCE, Verdict};

/// Input of a search for missing effects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct DiscoverSpec {
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// File with the measured pressure trace.
    pub pressure: InputFile,
    /// File with the measured volume frames.
    pub volume: InputFile,
    /// Noise as stated in the patient file. Absent values are estimated.
    #[serde(default)]
    pub noise: Noise,
    /// Arm cuff pressures, which are independent of the catheter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aortic_pressure: Option<AorticPressure>,
    /// Net forward flow per beat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forward_stroke_volume: Option<VolumeWithError>,
    /// Volume in the whole-heart image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diastasis: Option<Diastasis>,
    /// Further traces of the same beat.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub traces: Vec<FurtherTraceSpec>,
    /// Times of the valves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valve_times: Option<ValveTimes>,
    /// Width of QRS.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub qrs: Option<QrsWidth>,
    /// Beats under changed load.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loaded: Vec<LoadedBeatSpec>,
    /// Volume of the left ventricular wall; estimated if absent.
    #[serde(
        default,
        rename = "wall_volume_mL",
        skip_serializing_if = "Option::is_none"
    )]
    pub wall_volume_ml: Option<f64>,
    /// Filling pressure as stated in the patient file.
    #[serde(
        default,
        rename = "left_atrial_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub left_atrial_pressure_mmhg: Option<f64>,
    /// Windkessel as stated in the patient file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub afterload: Option<WindkesselParameters>,
    /// Names of the candidates in the catalogue; empty for the whole catalogue.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<String>,
    /// Seed of the bootstrap.
    pub seed: u64,
}

impl DiscoverSpec {
    /// The files that the search reads.
    #[must_use]
    pub fn files(&self) -> Vec<&InputFile> {
        let traces = self.traces.iter().map(|trace| &trace.file);
        let loaded = self.loaded.iter().flat_map(|b| [&b.pressure, &b.volume]);
        ([&self.pressure, &self.volume].into_iter())
            .chain(traces)
            .chain(loaded)
            .collect()
    }
}

/// Measured and simulated values of a biomarker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BiomarkerGap {
    /// Name with unit, as in `biomarkers`.
    pub name: String,
    /// Measured value.
    pub measured: f64,
    /// Value of the base model.
    pub before: Option<f64>,
    /// Value with the accepted effects.
    pub after: Option<f64>,
}

/// An index of the patient's heart or vessels in the fitted models, as a physician reads it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct IndexChange {
    /// Name with unit, such as `filling_pressure_mmHg`.
    pub name: String,
    /// Value of the base model.
    pub before: f64,
    /// Value with the accepted effects.
    pub after: f64,
}

impl IndexChange {
    /// Size of the change, as a share of the larger of both values.
    #[must_use]
    pub fn relative(&self) -> f64 {
        let scale = self.before.abs().max(self.after.abs());
        if scale > 0.0 {
            (self.after - self.before).abs() / scale
        } else {
            0.0
        }
    }
}

/// Periodic beat with the filling pressure that the patient file states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct StatedFilling {
    /// Filling pressure that the patient file states.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Measured end-diastolic volume: the mean of the frames around end-diastole.
    #[serde(rename = "measured_mL")]
    pub measured_ml: f64,
    /// End-diastolic volume of the base model; absent if the base model has no periodic beat.
    #[serde(rename = "before_mL")]
    pub before_ml: Option<f64>,
    /// End-diastolic volume with the accepted effects; absent if there is no periodic beat.
    #[serde(rename = "after_mL")]
    pub after_ml: Option<f64>,
    /// Rms volume residual of the base model in diastasis and atrial systole.
    #[serde(rename = "late_filling_before_mL")]
    pub late_filling_before_ml: Option<f64>,
    /// Rms volume residual with the accepted effects in diastasis and atrial systole.
    #[serde(rename = "late_filling_after_mL")]
    pub late_filling_after_ml: Option<f64>,
}

/// Model that `--accept` writes: effects, corrections of the data, and the base values fitted with
/// them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FoundModel {
    /// Accepted effects of heart and vessels.
    pub effects: Vec<EffectSpec>,
    /// Accepted artefacts; the data are corrected for them.
    pub corrections: Vec<EffectSpec>,
    /// Load of the arteries on the ventricle.
    pub afterload: WindkesselParameters,
    /// Constant filling pressure.
    #[serde(rename = "left_atrial_pressure_mmHg")]
    pub left_atrial_pressure_mmhg: f64,
    /// Passive law through the volume at which the stretch of the active law is 1.
    pub passive: OneFibrePassive,
}

/// Result of the search for a patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Discovered {
    /// Findings of the search.
    #[serde(flatten)]
    pub findings: Findings,
    /// Biomarkers before and after the effects.
    pub biomarkers: Vec<BiomarkerGap>,
    /// Indices before and after the effects.
    #[serde(default)]
    pub indices: Vec<IndexChange>,
    /// Periodic beat with the filling pressure of the patient file, if the file states one.
    pub stated_filling: Option<StatedFilling>,
    /// Fitted base values with the accepted effects.
    pub base: BTreeMap<String, f64>,
    /// Fitted base values without effects.
    pub base_before: BTreeMap<String, f64>,
    /// Model that `--accept` writes.
    pub model: FoundModel,
    /// Ratio of the noise power in the high band of the pressure to the stated noise power.
    pub noise_seen_over_stated: Option<f64>,
    /// Number of parameter sets that were simulated.
    pub n_evaluations: u64,
    /// Curves for figures.
    pub series: DiscoverSeries,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Settings of the search that affect its answer.
    pub settings: SearchSettings,
    /// SHA-256 of each input file, by role.
    pub data: BTreeMap<String, String>,
}

/// Result of `cardiotwin discover --json` for one patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DiscoverCase {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Pseudonym of the patient.
    pub case: String,
    /// Result in plain language.
    pub summary: String,
    /// Whether held-out data confirm the accepted effects; absent if nothing was accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirmed: Option<bool>,
    /// Key of the task that computed the result.
    pub task: String,
    /// Differences between the measured traces and the beats of the cohort's run, if the run
    /// personalised the patient.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<RunMisses>,
    /// The gap on the patient's finite-element ventricle, if it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finite_element: Option<FiniteElementGap>,
    /// Result of the search.
    #[serde(flatten)]
    pub found: Discovered,
}

/// The gap that the patient's finite-element ventricle leaves without and with the accepted effects.
/// It is personalised for both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FiniteElementGap {
    /// Number of nodes of the mesh.
    pub nodes: u64,
    /// Beat of the twin without the effects.
    pub before: FiniteElementBeat,
    /// Beat of the twin with the effects.
    pub after: FiniteElementBeat,
    /// Residuals by signal and phase over the noise of the search, with the phases of the search.
    pub gaps: Vec<GapAt>,
    /// Curves for figures. Corrections of the data are added to the simulated values after them.
    pub series: DiscoverSeries,
}

/// A beat of the finite-element ventricle next to the measured traces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct FiniteElementBeat {
    /// Key of the task that simulated it.
    pub task: String,
    /// Root mean square of the pressure's residuals over the whole beat.
    #[serde(rename = "pressure_rms_mmHg")]
    pub pressure_rms_mmhg: f64,
    /// Root mean square of the volume's residuals over the whole beat.
    #[serde(rename = "volume_rms_mL")]
    pub volume_rms_ml: f64,
}

/// Differences between beats of a personalised patient and the measured traces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RunMisses {
    /// Differences of the pressure, mmHg; absent if it was not measured.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Option<TraceMisses>,
    /// Differences of the volume, mL; absent if it was not measured.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Option<TraceMisses>,
}

/// Root mean squares of simulated minus measured values over one beat, in the unit of the trace.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TraceMisses {
    /// Difference of the beat of step 1, in which the active stress was adjusted freely.
    pub step1: f64,
    /// Difference of the verification beat, with the cell that was fitted outside of the organ.
    pub verification: f64,
    /// Difference of the twin's beat.
    pub twin: f64,
}

impl TraceMisses {
    /// Misfit due to the organ model: no other active stress and no other cell of this run came
    /// closer.
    #[must_use]
    pub fn of_organ(&self) -> f64 {
        self.step1.min(self.twin)
    }

    /// Additional misfit of the verification beat, which is due to the cell of step 2.
    #[must_use]
    pub fn of_cell(&self) -> f64 {
        (self.verification.powi(2) - self.of_organ().powi(2))
            .max(0.0)
            .sqrt()
    }
}

/// Result of `cardiotwin discover COHORT --json`: cases by name.
pub type DiscoverCases = BTreeMap<String, DiscoverCase>;

/// Results for a candidate over a cohort.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PooledEffect {
    /// Name in the catalogue.
    pub name: String,
    /// Number of patients in whom it was accepted.
    pub accepted_in: u32,
    /// Number of these in whom held-out data do not confirm the accepted effects.
    #[serde(default)]
    pub unconfirmed_in: u32,
    /// Number of patients in whom it was tried.
    pub tried_in: u32,
    /// Sum of `robust_evidence` over the patients, each limited for and against the effect; the
    /// largest and the smallest count as much as their neighbours.
    pub log_evidence: f64,
    /// Whether it is missing in more than half of the patients, which suggests a defect of the
    /// model rather than a property of a patient.
    pub of_the_model: bool,
    /// Patient without whom the plain sum of the limited contributions would have the other sign.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dominated_by: Option<String>,
}
