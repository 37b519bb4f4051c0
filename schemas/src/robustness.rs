//! Robustness of personalisations (`robustness.json`): the varied quantities and the spread of
//! results.
//!
//! Source: Jung et al. 2022, section 2.5 and Tables 3 to 10. Values have the unit in the name of
//! their quantity; differences, spreads and errors are fractions.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::statistics::Moments;

use crate::ids::PatientId;
use crate::status::PatientState;

/// Uncertainty that is propagated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Uncertainty {
    /// Uncertainty of the measured biomarkers.
    Data,
    /// Choice of the initial guesses of both steps.
    Guess,
}

impl Uncertainty {
    /// Name in files and tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Guess => "guess",
        }
    }
}

/// Robustness of whole personalisations, with members around the personalisation of each patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RobustnessSpec {
    /// Uncertainty that is varied.
    pub over: Uncertainty,
    /// Patients to personalise.
    pub patients: Vec<PatientId>,
    /// Number of samples of the Latin hypercube, the same for each patient.
    pub n_samples: u32,
    /// Number of members that differ from the original only in the seed of step 2.
    pub n_seeds: u32,
    /// Half-width of the hypercube, as a fraction of each value.
    pub range: f64,
    /// Seed of the hypercube.
    pub seed: u64,
}

/// `robustness.json` in the folder of a sweep: results so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobustnessResult {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Version of the program that wrote it.
    pub version: String,
    /// Name of the cohort.
    pub cohort: String,
    /// Specification of the sweep.
    pub spec: RobustnessSpec,
    /// Results in the order of the specification's patients.
    pub patients: Vec<PatientRobustness>,
}

/// Robustness of one patient's personalisation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PatientRobustness {
    /// Pseudonym of the patient.
    pub patient: PatientId,
    /// All personalisations: the original, the samples, and those with other seeds.
    pub members: Vec<RobustnessMember>,
    /// Varied quantities, over the samples with a result.
    pub inputs: Vec<QuantitySpread>,
    /// Spread over the samples; empty until the original has ended.
    pub tables: Vec<RobustnessTable>,
    /// Spread over the seeds of step 2 alone.
    pub seed_tables: Vec<RobustnessTable>,
    /// Agreement of the fits with perturbed targets; empty for guesses.
    pub target_errors: Vec<TargetError>,
    /// Conditions on the result with the values found.
    pub conditions: Vec<Condition>,
}

/// Role of a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MemberRole {
    /// Personalisation with the measured data and the guesses of the cohort.
    Original,
    /// A sample of the hypercube.
    Sample,
    /// Personalisation that differs from the original only in the seed of step 2.
    Seed,
}

impl MemberRole {
    /// Name in files and tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Original => "original",
            Self::Sample => "sample",
            Self::Seed => "seed",
        }
    }
}

/// One personalisation of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobustnessMember {
    /// Name in the run of the sweep, for example `02-CoA.d03`.
    pub id: PatientId,
    /// Role of the member.
    pub role: MemberRole,
    /// State: `done`, `failed`, `running`, …
    pub state: PatientState,
    /// Failure, if the member failed.
    pub failure: Option<String>,
    /// Varied inputs by name: factors on measured biomarkers, initial guesses, or the seed of step
    /// 2.
    pub inputs: BTreeMap<String, f64>,
    /// Ending of step 1 in words.
    pub step1: Option<String>,
    /// Number of simulations of step 1.
    pub step1_iterations: u32,
    /// Cost of the best iteration of step 1.
    pub step1_cost: Option<f64>,
    /// Cost of the fitted cell.
    pub step2_cost: Option<f64>,
    /// Number of cell evaluations of step 2.
    pub step2_evaluations: Option<u64>,
    /// Cost of the verification beat by the formula of step 1.
    pub verification_cost: Option<f64>,
    /// Results by table and quantity.
    pub values: BTreeMap<TableKind, BTreeMap<String, f64>>,
}

/// Results that a table contains.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum TableKind {
    /// Personalised Tanh model and valves (Tables 3 and 7).
    Step1Parameters,
    /// Biomarkers of the best iteration of step 1 (Tables 4 and 8).
    Step1Biomarkers,
    /// Parameters of the fitted cell (Tables 5 and 9).
    Step2Parameters,
    /// Biomarkers of the verification beat (Tables 6 and 10).
    Step2Biomarkers,
}

impl TableKind {
    /// All tables, in the paper's order.
    pub const ALL: [Self; 4] = [
        Self::Step1Parameters,
        Self::Step1Biomarkers,
        Self::Step2Parameters,
        Self::Step2Biomarkers,
    ];

    /// Name of the table in files.
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

/// Results that correspond to one of Tables 3 to 10 of the paper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobustnessTable {
    /// Results in this table.
    pub table: TableKind,
    /// Number of the paper's table.
    pub paper_table: u32,
    /// Columns of the table.
    pub quantities: Vec<QuantitySpread>,
}

/// A parameter or biomarker over the samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct QuantitySpread {
    /// Name with unit.
    pub name: String,
    /// Value of the original personalisation.
    pub original: f64,
    /// Number of samples with a value.
    pub n: u32,
    /// Number of samples without a value.
    pub n_missing: u32,
    /// Moments of the values.
    pub values: Moments,
    /// Moments of |value − original| / |original|.
    pub relative_differences: Option<Moments>,
    /// Standard deviation of the values over the magnitude of the original value.
    pub spread: Option<f64>,
    /// Spread of this quantity relative to the input's spread.
    pub amplification: Option<Amplification>,
    /// Values that the paper prints for its patient 02-CoA; absent for other patients.
    pub paper: Option<PaperSpread>,
}

/// Output spread over input spread.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Amplification {
    /// Input of the comparison. `all inputs` is the root mean square of their spreads.
    pub input: String,
    /// Spread of the input.
    pub input_spread: f64,
    /// Output spread over input spread. A value below 1 means damping.
    pub ratio: f64,
}

/// A column of Tables 3 to 10 as printed. Percentages are not converted.
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
    /// Standard deviation of the relative differences.
    pub sd_of_rel_diff_percent: Printed,
    /// Smallest relative difference.
    pub min_of_rel_diff_percent: Printed,
    /// Largest relative difference.
    pub max_of_rel_diff_percent: Printed,
}

/// A number as printed in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Printed {
    /// Printed value.
    Value(f64),
    /// Upper limit, printed as `<x`.
    Below {
        /// Upper limit.
        below: f64,
    },
}

impl Printed {
    /// The value itself, or the printed limit above it.
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

/// Relative difference between a fitted biomarker and its target: |value − target| / |target|.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TargetError {
    /// Results that are compared: of step 1 or of the verification beat.
    pub table: TableKind,
    /// Name of the biomarker.
    pub biomarker: String,
    /// Relative difference of the original personalisation to the measured value.
    pub original: f64,
    /// Relative differences of the samples to their own perturbed targets.
    pub to_perturbed: Moments,
    /// Relative differences of the samples to the measured value.
    pub to_measured: Moments,
    /// Samples with a difference to their perturbed target that exceeds the original's by more than
    /// two percentage points.
    #[serde(default)]
    pub beyond: Vec<PatientId>,
}

/// A condition on the result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Condition {
    /// Description of the condition.
    pub name: String,
    /// Whether the condition is met; absent if a result is missing.
    pub passed: Option<bool>,
    /// Value that was found.
    pub found: String,
    /// Limit of the value.
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
