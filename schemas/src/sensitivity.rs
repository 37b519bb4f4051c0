//! What a sensitivity analysis found: `sensitivity.json` of a sweep, and what tables and figures are drawn from.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::statistics::SobolIndex;

use crate::sweep::GsaSpec;

/// Sobol indices with intervals, and the ranking that follows from them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensitivityRecord {
    /// Format version.
    pub schema_version: u32,
    /// Version of the program that made the analysis.
    pub version: String,
    /// What was swept, and how the indices were made.
    pub spec: GsaSpec,
    /// Complete blocks that the indices rest on: the first ones of the design, all of them in the end.
    pub n_blocks: u32,
    /// What became of their samples.
    pub samples: SampleCounts,
    /// Instruction sets of the cell engine that computed them.
    pub arithmetic: Vec<String>,
    /// One for each biomarker.
    pub outputs: Vec<OutputSensitivity>,
    /// Parameters by the sum of their total indices over the biomarkers, the largest first.
    pub ranking: Vec<RankedParameter>,
}

/// What became of samples.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleCounts {
    /// All.
    pub total: u64,
    /// Within all constraints.
    pub physiological: u64,
    /// Outside of one: their biomarkers are replaced by the physiological samples' means.
    pub excluded: u64,
    /// Not computed: left out of those indices that need them.
    pub failed: u64,
    /// Computed, but not periodic after the largest number of beats; counted above as any other.
    pub not_periodic: u64,
    /// Excluded samples by constraint; one sample may break several.
    pub excluded_by: BTreeMap<String, u64>,
}

/// The indices of one biomarker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutputSensitivity {
    /// Biomarker, with its unit.
    pub name: String,
    /// Mean over the physiological samples.
    pub mean: f64,
    /// Their standard deviation.
    pub standard_deviation: f64,
    /// Sum of the first-order indices: what is missing to 1 is explained by interactions.
    pub sum_of_first: f64,
    /// In the design's order.
    pub parameters: Vec<ParameterIndices>,
    /// Second-order index of each pair.
    pub second: Vec<PairIndices>,
}

/// A parameter's indices for one biomarker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterIndices {
    /// Its name.
    pub name: String,
    /// First-order index S1; none where too few samples are left or the biomarker does not vary.
    pub first: Option<SobolIndex>,
    /// Total-effect index ST.
    pub total: Option<SobolIndex>,
}

/// The second-order index S2 of a pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PairIndices {
    /// The pair, in the design's order.
    pub parameters: [String; 2],
    /// Its index.
    pub second: Option<SobolIndex>,
}

/// A parameter's place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RankedParameter {
    /// 1 for the most influential.
    pub rank: u32,
    /// Its name.
    pub name: String,
    /// Sum of its total indices over the biomarkers.
    pub sum_of_totals: f64,
    /// Half of the interval's width around the sum.
    pub half_width: Option<f64>,
    /// Between which ranks the resamples' middle share (the confidence) lies.
    pub rank_interval: Option<[u32; 2]>,
    /// Share of the resamples in which it is among the nine first.
    pub share_among_first_nine: Option<f64>,
    /// Its rank and sum in the independent reference (of the paper's settings).
    pub reference: Option<ReferenceRank>,
    /// Its standing in the paper.
    pub paper: PaperRank,
}

/// A parameter's place in the independent reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceRank {
    /// 1 for the most influential.
    pub rank: u32,
    /// Sum of its total indices.
    pub sum_of_totals: f64,
}

/// A parameter's place in section 3.1 of the paper, which states six of its nine ranks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PaperRank {
    /// Whether it is one of the nine that the paper fits.
    pub among_first_nine: bool,
    /// Its rank, where stated.
    pub rank: Option<u32>,
}
