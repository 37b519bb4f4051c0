//! Robustness of personalisations: what is varied, and the spread that comes of it (`robustness.json`).
//!
//! Source: Jung et al. 2022, section 2.5 and Tables 3 to 10. Values are in the unit that a quantity's name says;
//! differences, spreads and errors are fractions.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::statistics::Moments;

use crate::ids::PatientId;

/// Which uncertainty is propagated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Uncertainty {
    /// Measured biomarkers.
    Data,
    /// Initial guesses of both steps.
    Guess,
}

impl Uncertainty {
    /// As in files and tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Guess => "guess",
        }
    }
}

/// Whole personalisations around that of each patient: what the members follow from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RobustnessSpec {
    /// What is varied.
    pub over: Uncertainty,
    /// Whose personalisation.
    pub patients: Vec<PatientId>,
    /// Samples of the Latin hypercube, the same for each patient.
    pub n_samples: u32,
    /// Members that differ from the original in step 2's seed alone.
    pub n_seeds: u32,
    /// Half-width of the hypercube, as a fraction of each value.
    pub range: f64,
    /// Seed of the hypercube.
    pub seed: u64,
}

/// `robustness.json` of a sweep's folder: what is known so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobustnessResult {
    /// Format version.
    pub schema_version: u32,
    /// Version of the program that wrote it.
    pub version: String,
    /// Name of the cohort.
    pub cohort: String,
    /// What is varied.
    pub spec: RobustnessSpec,
    /// In the order of the specification.
    pub patients: Vec<PatientRobustness>,
}

/// Robustness of one patient's personalisation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PatientRobustness {
    /// Pseudonym.
    pub patient: PatientId,
    /// All personalisations: the original, the samples, those of other seeds.
    pub members: Vec<RobustnessMember>,
    /// What was varied, over the samples that gave a result.
    pub inputs: Vec<QuantitySpread>,
    /// Spread over the samples; empty before the original is over.
    pub tables: Vec<RobustnessTable>,
    /// Spread by step 2's seed alone.
    pub seed_tables: Vec<RobustnessTable>,
    /// How well fits meet perturbed targets; empty for guesses.
    pub target_errors: Vec<TargetError>,
    /// Conditions on the result, with what was found.
    pub conditions: Vec<Condition>,
}

/// What a member stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MemberRole {
    /// Measured data and the cohort's guesses.
    Original,
    /// A sample of the hypercube.
    Sample,
    /// Another seed of step 2, nothing else.
    Seed,
}

impl MemberRole {
    /// As in files and tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Original => "original",
            Self::Sample => "sample",
            Self::Seed => "seed",
        }
    }
}

/// One personalisation of the sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobustnessMember {
    /// Its name in the sweep's run, for example `02-CoA.d03`.
    pub id: PatientId,
    /// What it stands for.
    pub role: MemberRole,
    /// Where it stands: `done`, `failed`, `running`, …
    pub state: String,
    /// Why it failed, where it did.
    pub failure: Option<String>,
    /// What it was given: factors of measured biomarkers, initial guesses, or step 2's seed, by name.
    pub inputs: BTreeMap<String, f64>,
    /// How step 1 ended, in words.
    pub step1: Option<String>,
    /// Simulations of step 1.
    pub step1_iterations: u32,
    /// Cost of the iterate that was taken.
    pub step1_cost: Option<f64>,
    /// Cost of the fitted cell.
    pub step2_cost: Option<f64>,
    /// Cell evaluations.
    pub step2_evaluations: Option<u64>,
    /// Cost of the verification beat by step 1's formula.
    pub verification_cost: Option<f64>,
    /// Results by table and quantity.
    pub values: BTreeMap<TableKind, BTreeMap<String, f64>>,
}

/// Which results a table holds.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum TableKind {
    /// Personalised Tanh model and valves (Tables 3 and 7).
    Step1Parameters,
    /// Biomarkers of the iterate that was taken (Tables 4 and 8).
    Step1Biomarkers,
    /// The fitted cell (Tables 5 and 9).
    Step2Parameters,
    /// Biomarkers of the verification beat (Tables 6 and 10).
    Step2Biomarkers,
}

impl TableKind {
    /// All, in the paper's order.
    pub const ALL: [Self; 4] = [
        Self::Step1Parameters,
        Self::Step1Biomarkers,
        Self::Step2Parameters,
        Self::Step2Biomarkers,
    ];

    /// As in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Step1Parameters => "step1-parameters",
            Self::Step1Biomarkers => "step1-biomarkers",
            Self::Step2Parameters => "step2-parameters",
            Self::Step2Biomarkers => "step2-biomarkers",
        }
    }

    /// Number of the paper's table.
    #[must_use]
    pub fn paper(self, over: Uncertainty) -> u32 {
        let first = match over {
            Uncertainty::Data => 3,
            Uncertainty::Guess => 7,
        };
        first + self as u32
    }
}

/// One of Tables 3 to 10.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobustnessTable {
    /// Which results.
    pub table: TableKind,
    /// Number of the paper's table that it stands beside.
    pub paper_table: u32,
    /// Its columns.
    pub quantities: Vec<QuantitySpread>,
}

/// A parameter or biomarker over the samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct QuantitySpread {
    /// Name with unit.
    pub name: String,
    /// The original personalisation's.
    pub original: f64,
    /// Samples with a value.
    pub n: u32,
    /// Samples without one.
    pub n_missing: u32,
    /// Of the values.
    pub values: Moments,
    /// Of |value − original| / |original|.
    pub relative_differences: Option<Moments>,
    /// Standard deviation of the values over the magnitude of the original.
    pub spread: Option<f64>,
    /// What of the input's spread comes out here.
    pub amplification: Option<Amplification>,
    /// What the paper prints for its patient 02-CoA; for that patient alone.
    pub paper: Option<PaperSpread>,
}

/// Output spread over input spread.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Amplification {
    /// The input compared with; `all inputs` is the root mean square of their spreads.
    pub input: String,
    /// Its spread.
    pub input_spread: f64,
    /// Output spread over input spread: below one it is damped.
    pub ratio: f64,
}

/// A printed column of Tables 3 to 10; percentages as printed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PaperSpread {
    /// Original value.
    pub original: Printed,
    /// Mean of the values.
    pub mean: Printed,
    /// Standard deviation of the values.
    pub sd: Printed,
    /// Smallest value.
    pub min: Printed,
    /// Largest value.
    pub max: Printed,
    /// Mean of the relative differences.
    pub mean_of_rel_diff_percent: Printed,
    /// Their standard deviation.
    pub sd_of_rel_diff_percent: Printed,
    /// The smallest.
    pub min_of_rel_diff_percent: Printed,
    /// The largest.
    pub max_of_rel_diff_percent: Printed,
}

/// A printed number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Printed {
    /// As it stands.
    Value(f64),
    /// Printed as `<x`.
    Below {
        /// The limit.
        below: f64,
    },
}

impl Printed {
    /// The number, or the limit that it lies below.
    #[must_use]
    pub fn at_most(self) -> f64 {
        match self {
            Self::Value(value) => value,
            Self::Below { below } => below,
        }
    }
}

impl std::fmt::Display for Printed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Value(value) => write!(f, "{value}"),
            Self::Below { below } => write!(f, "<{below}"),
        }
    }
}

/// How well one biomarker's fit meets its target: |value − target| / |target|.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TargetError {
    /// Which results: those of step 1 or of the verification beat.
    pub table: TableKind,
    /// The biomarker.
    pub biomarker: String,
    /// Of the original personalisation to the measured value.
    pub original: f64,
    /// Of each sample to its own perturbed target.
    pub to_perturbed: Moments,
    /// Of each sample to the measured value.
    pub to_measured: Moments,
    /// Samples that miss their perturbed target by more than two points of percent beyond the original's error.
    #[serde(default)]
    pub beyond: Vec<PatientId>,
}

/// A condition on the result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Condition {
    /// What is asked.
    pub name: String,
    /// Whether it holds; none where a result is missing.
    pub passed: Option<bool>,
    /// What was found.
    pub found: String,
    /// What is asked for.
    pub limit: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_stand_beside_the_papers() {
        assert_eq!(
            TableKind::ALL.map(|t| t.paper(Uncertainty::Data)),
            [3, 4, 5, 6]
        );
        assert_eq!(
            TableKind::ALL.map(|t| t.paper(Uncertainty::Guess)),
            [7, 8, 9, 10]
        );
    }

    #[test]
    fn a_printed_limit_is_kept_as_such() {
        let read = |text: &str| serde_json::from_str::<Printed>(text).unwrap();
        assert_eq!(read(r#"{"below":0.1}"#).to_string(), "<0.1");
        assert_eq!(
            (read("2.5").to_string(), read("2.5").at_most()),
            ("2.5".to_owned(), 2.5)
        );
    }
}
