//! Result of a sensitivity analysis: `sensitivity.json` of a sweep, from which tables and figures
//! are drawn.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::statistics::SobolIndex;

use crate::sweep::GsaSpec;

/// Sobol indices with intervals, and the ranking that follows from them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SensitivityRecord {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Version of the program that made the analysis.
    pub version: String,
    /// Specification of the sweep and of the indices.
    pub spec: GsaSpec,
    /// Number of complete blocks from which the indices were computed, counted from the beginning
    /// of the design. At the end of the sweep these are all blocks.
    pub n_blocks: u32,
    /// Numbers of samples by status.
    pub samples: SampleCounts,
    /// Instruction sets of the cell engine that computed the samples.
    pub arithmetic: Vec<String>,
    /// Indices of each biomarker.
    pub outputs: Vec<OutputSensitivity>,
    /// Parameters by the sum of their total indices over the biomarkers, largest first.
    pub ranking: Vec<RankedParameter>,
}

/// Numbers of samples by status.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SampleCounts {
    /// Number of all samples.
    pub total: u64,
    /// Samples that meet all constraints.
    pub physiological: u64,
    /// Samples that violate a constraint. Their biomarkers are replaced by the means of the
    /// physiological samples.
    pub excluded: u64,
    /// Samples that were not computed. They are left out of the indices that need them.
    pub failed: u64,
    /// Samples that were computed but are not periodic after the largest number of beats. They are
    /// also included in the counts above.
    pub not_periodic: u64,
    /// Number of excluded samples by constraint. One sample may violate several constraints.
    pub excluded_by: BTreeMap<String, u64>,
}

/// Sensitivity indices of one biomarker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OutputSensitivity {
    /// Name of the biomarker, with its unit.
    pub name: String,
    /// Mean over the physiological samples.
    pub mean: f64,
    /// Standard deviation over the physiological samples.
    pub standard_deviation: f64,
    /// Sum of the first-order indices. Interactions explain the difference to 1.
    pub sum_of_first: f64,
    /// Indices of each parameter in the order of the design.
    pub parameters: Vec<ParameterIndices>,
    /// Second-order index of each pair.
    pub second: Vec<PairIndices>,
}

/// Indices of a parameter for one biomarker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ParameterIndices {
    /// Name of the parameter.
    pub name: String,
    /// First-order index S1; absent if too few samples are left or the biomarker does not vary.
    pub first: Option<SobolIndex>,
    /// Total-effect index ST; absent under the same conditions.
    pub total: Option<SobolIndex>,
}

/// Second-order index S2 of a pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PairIndices {
    /// Names of the pair, in the order of the design.
    pub parameters: [String; 2],
    /// Index of the pair; absent if too few samples are left or the biomarker does not vary.
    pub second: Option<SobolIndex>,
}

/// Rank of a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RankedParameter {
    /// Rank, 1 for the most influential parameter.
    pub rank: u32,
    /// Name of the parameter.
    pub name: String,
    /// Sum of the parameter's total indices over the biomarkers.
    pub sum_of_totals: f64,
    /// Half-width of the interval around the sum.
    pub half_width: Option<f64>,
    /// Interval of ranks that contains the middle share (the confidence) of the resamples.
    pub rank_interval: Option<[u32; 2]>,
    /// Share of the resamples that give the parameter one of the first nine ranks.
    pub share_among_first_nine: Option<f64>,
    /// Rank and sum of the parameter in the independent reference, which has the paper's settings.
    pub reference: Option<ReferenceRank>,
    /// Rank of the parameter in the paper.
    pub paper: PaperRank,
}

/// Rank of a parameter in the independent reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ReferenceRank {
    /// Rank, 1 for the most influential parameter.
    pub rank: u32,
    /// Sum of the parameter's total indices.
    pub sum_of_totals: f64,
}

/// Rank of a parameter in section 3.1 of the paper, which states six of its nine ranks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PaperRank {
    /// Whether the parameter is one of the nine that the paper fits.
    pub among_first_nine: bool,
    /// Rank of the parameter, if stated.
    pub rank: Option<u32>,
}
