//! The file `sweep.json`: subject of a sweep's directory, and all inputs that determine its
//! results.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarker;
use crate::ids::PatientId;
use crate::organ_beat::OrganBeatSpec;
use crate::organ_law::LawKnowledge;
use crate::robustness::RobustnessSpec;

/// `sweep.json` in the folder of a sweep, next to the database of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SweepFile {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Version of the program that created the folder.
    pub version: String,
    /// Time at which the folder was created, UTC, RFC 3339.
    pub created: String,
    /// Kind and settings of the sweep.
    pub sweep: SweepSpec,
}

/// Kind and settings of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum SweepSpec {
    /// Sobol sensitivity analysis of the 0D cell, or of the organ with that cell.
    Gsa(Box<GsaSpec>),
    /// Robustness of personalisations.
    Robustness(Box<RobustnessSpec>),
}

impl SweepSpec {
    /// Name of the kind in files and tables.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Gsa(_) => "gsa",
            Self::Robustness(_) => "robustness",
        }
    }
}

/// A Sobol sensitivity analysis of the 0D cell (Jung et al. 2022, section 2.4), or of the organ with that cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct GsaSpec {
    /// Design, box and cell, which determine the samples.
    pub design: CellDesign,
    /// Number N of base points. Each gives a block of 2D + 2 samples.
    pub n_blocks: u32,
    /// Number of blocks that one task computes. It does not affect the results.
    pub chunk_blocks: u32,
    /// Settings that determine the indices, given the samples.
    pub analysis: GsaAnalysis,
}

/// A Saltelli design over parameters of the 0D cell, and the other settings of the cell or of the organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellDesign {
    /// Parameters in the order of the design's columns.
    pub parameters: Vec<SweptParameter>,
    /// Number of points at the beginning of the Sobol sequence that are skipped.
    pub skip_points: u64,
    /// Seed of a scrambled sequence; absent for the unscrambled sequence.
    pub scramble_seed: Option<u64>,
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
    /// Stretch at the beginning of the beat.
    pub lambda_0: f64,
    /// Parameters outside of the design with values other than the cell's defaults.
    pub fixed: BTreeMap<String, f64>,
    /// Tolerance of the cell engine. The beat of an organ does not use it.
    pub tolerance: f64,
    /// Ventricle with the biomarkers that are analysed; absent for the cell's biomarkers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub organ: Option<Box<SweptOrgan>>,
}

/// A patient's ventricle in a sensitivity analysis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SweptOrgan {
    /// Patient to whom the ventricle belongs.
    pub patient: PatientId,
    /// Beat in which the samples replace parameters. Only the figures of a finite-element ventricle
    /// are used.
    pub beat: OrganBeatSpec,
    /// What is known about the organ's law; absent for the one-fibre ventricle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<LawKnowledge>,
}

impl CellDesign {
    /// Names of the swept biomarkers, as in `samples.csv`.
    #[must_use]
    pub fn outputs(&self) -> &'static [&'static str] {
        if self.organ.is_some() {
            &ORGAN_OUTPUTS
        } else {
            &CELL_OUTPUTS
        }
    }
}

/// Biomarkers of the cell, the paper's five outputs.
const CELL_OUTPUTS: [&str; 5] = [
    "Sa_max_kPa",
    "dSadt_max_kPa_per_ms",
    "STD30_ms",
    "STD50_ms",
    "STD90_ms",
];
/// Biomarkers of the organ that step 3 compares.
const ORGAN_OUTPUTS: [&str; Biomarker::OF_ORGAN.len()] = Biomarker::ORGAN_KEYS;

/// First line of `samples.csv`, a chunk's artefact. It is followed by one line per sample, in the
/// order of the design.
///
/// Block and row count from 0. `cut` states whether a duration lacks a crossing of its level within
/// the beat; the rise is the steepest one after the maximum. Numbers can be read back exactly. A
/// sample without a result leaves them empty.
pub const SAMPLES_HEADING: &str = "block,row,status,Sa_max_kPa,dSadt_max_kPa_per_ms,STD30_ms,STD50_ms,STD90_ms,cut,\
                                   lambda_min,Sa_res_kPa,Sa_min_kPa,rise_after_peak_kPa_per_ms,beats";

/// The corresponding line for an organ. A biomarker that the beat lacks is empty; `shut` states
/// whether a valve did not open and close.
pub const ORGAN_SAMPLES_HEADING: &str = "block,row,status,P_max_mmHg,dPdt_max_mmHg_per_ms,dPdt_min_mmHg_per_ms,PTD90_ms,tau_VD_ms,tau_VR_ms,SV_mL,shut";

/// A parameter and the interval from which it is drawn, in the unit of its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SweptParameter {
    /// Name of a parameter of the cell or, in an organ, of the valves.
    pub name: String,
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

/// Settings by which indices are computed from the samples. They can be changed without computing
/// samples again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GsaAnalysis {
    /// Number of bootstrap resamples; with fewer than two there are no intervals.
    pub resamples: u32,
    /// Coverage probability of the intervals.
    pub confidence: f64,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Rule for samples that are not physiological.
    pub exclusion: ExclusionRule,
}

impl Default for GsaAnalysis {
    fn default() -> Self {
        Self {
            resamples: 1000,
            confidence: 0.95,
            seed: 1,
            exclusion: ExclusionRule::default(),
        }
    }
}

/// Rule by which a sample counts as not physiological (section 2.4: constraints of step 2 on the
/// active stress, with some resting stress allowed). The default limits of slope and negative
/// stress allow for errors of the integration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExclusionRule {
    /// Largest stress at the beginning of the beat, as a share of the peak stress.
    pub resting_share: f64,
    /// Largest rate at which the stress may rise after its peak.
    pub rise_after_peak_kpa_per_ms: f64,
    /// Largest magnitude of a negative stress.
    pub negative_stress_kpa: f64,
}

impl Default for ExclusionRule {
    fn default() -> Self {
        Self {
            resting_share: 0.1,
            rise_after_peak_kpa_per_ms: 3e-5,
            negative_stress_kpa: 1e-4,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_heading_of_an_organ_s_samples_names_the_biomarkers_in_their_order() {
        let expected = format!("block,row,status,{},shut", Biomarker::ORGAN_KEYS.join(","));
        assert_eq!(ORGAN_SAMPLES_HEADING, expected);
    }
}
