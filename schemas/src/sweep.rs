//! `sweep.json`: what a folder of a sweep is about, and everything that its results follow from.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarker;
use crate::ids::PatientId;
use crate::robustness::RobustnessSpec;
use crate::task::OrganBeatSpec;

/// `sweep.json` in the folder of a sweep, beside the run's database.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SweepFile {
    /// Format version.
    pub schema_version: u32,
    /// Version of the program that made the folder.
    pub version: String,
    /// UTC, RFC 3339: when it was made.
    pub created: String,
    /// What is swept, and how.
    pub sweep: SweepSpec,
}

/// What is swept, and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum SweepSpec {
    /// Sobol sensitivity analysis of the 0D cell, or of the organ with that cell.
    Gsa(Box<GsaSpec>),
    /// Robustness of personalisations.
    Robustness(Box<RobustnessSpec>),
}

impl SweepSpec {
    /// The kind as in files and tables.
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
    /// The design, box and cell: what the samples follow from.
    pub design: CellDesign,
    /// Base points N; each gives a block of 2D + 2 samples.
    pub n_blocks: u32,
    /// Blocks of a chunk: what one task computes. Changes no result.
    pub chunk_blocks: u32,
    /// What the indices follow from beside the samples.
    pub analysis: GsaAnalysis,
}

/// A Saltelli design over parameters of the 0D cell, and the other settings of the cell or of the organ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CellDesign {
    /// Parameters in the design's order, which is that of its columns.
    pub parameters: Vec<SweptParameter>,
    /// First points of the Sobol sequence to leave out.
    pub skip_points: u64,
    /// Seed of a scrambled sequence; a plain one if none.
    pub scramble_seed: Option<u64>,
    /// Cycle length.
    pub cycle_length_ms: f64,
    /// Initial stretch.
    pub lambda_0: f64,
    /// Parameters outside of the design that differ from the cell's defaults.
    pub fixed: BTreeMap<String, f64>,
    /// Tolerance of the cell engine; an organ's beat does not use it.
    pub tolerance: f64,
    /// The ventricle whose biomarkers are swept; absent: those of the cell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub organ: Option<Box<SweptOrgan>>,
}

/// A patient's ventricle in a sensitivity analysis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SweptOrgan {
    /// Whose.
    pub patient: PatientId,
    /// The beat that the samples differ from; of a finite-element ventricle the figures are used.
    pub beat: OrganBeatSpec,
}

impl CellDesign {
    /// Names of the biomarkers that are swept, as `samples.csv` has them.
    #[must_use]
    pub fn outputs(&self) -> &'static [&'static str] {
        if self.organ.is_some() {
            &ORGAN_OUTPUTS
        } else {
            &CELL_OUTPUTS
        }
    }
}

/// Biomarkers of the cell: the paper's five outputs.
const CELL_OUTPUTS: [&str; 5] = [
    "Sa_max_kPa",
    "dSadt_max_kPa_per_ms",
    "STD30_ms",
    "STD50_ms",
    "STD90_ms",
];
/// Biomarkers of the organ that step 3 compares.
const ORGAN_OUTPUTS: [&str; Biomarker::OF_ORGAN.len()] = Biomarker::ORGAN_KEYS;

/// First line of `samples.csv`, a chunk's artefact: a line a sample follows, in the design's order. Block and row count
/// from 0; `cut` says that a duration lacks a crossing of its level within the beat; the rise is the steepest one after
/// the maximum. Numbers read back without a change; a sample without a result leaves them empty.
pub const SAMPLES_HEADING: &str = "block,row,status,Sa_max_kPa,dSadt_max_kPa_per_ms,STD30_ms,STD50_ms,STD90_ms,cut,\
                                   lambda_min,Sa_res_kPa,Sa_min_kPa,rise_after_peak_kPa_per_ms,beats";

/// The same of an organ: a biomarker that the beat does not have is empty; `shut` says that a valve did not open and close.
pub const ORGAN_SAMPLES_HEADING: &str = "block,row,status,P_max_mmHg,dPdt_max_mmHg_per_ms,dPdt_min_mmHg_per_ms,PTD90_ms,tau_VD_ms,tau_VR_ms,SV_mL,shut";

/// A parameter and the interval that it is drawn from, in the unit that its name says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SweptParameter {
    /// One of the cell's names, or of the valves' of an organ.
    pub name: String,
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

/// How indices are made of the samples: may be changed without computing any sample again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GsaAnalysis {
    /// Bootstrap resamples; fewer than two give no intervals.
    pub resamples: u32,
    /// Probability that an interval covers.
    pub confidence: f64,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Which samples are not physiological.
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

/// When a sample is not physiological (section 2.4: step 2's constraints on the active stress, with some resting stress
/// allowed). The smallest stresses and slopes are what integration leaves of zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExclusionRule {
    /// Largest stress at the beat's start, as a share of the largest stress.
    pub resting_share: f64,
    /// Fastest rise of the stress after its maximum.
    pub rise_after_peak_kpa_per_ms: f64,
    /// Most negative stress, as a positive number.
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
