//! What `cardiotwin fit afterload` and `cardiotwin discover --afterload` answer.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::statistics::EffectiveSampleSize;

use crate::organ::{EffectSpec, WindkesselParameters};

/// `cardiotwin fit afterload --json`: the three-element Windkessel of a measured flow and pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadFitAnswer {
    /// Of the formats.
    pub schema_version: u32,
    /// The record.
    pub record: AfterloadRecord,
    /// The values as a patient file takes them.
    pub afterload: WindkesselParameters,
    /// Each parameter, R2 C (`time_constant_s`) and the pressure on the compliance at the first sample, with intervals.
    pub estimates: Vec<AfterloadQuantity>,
    /// Probability that an interval covers, for the effective number of samples.
    pub confidence_level: f64,
    /// Correlations of the estimates: R1 with R2, R1 with C, R2 with C; absent where the record does not tell them apart.
    pub correlations: [Option<f64>; 3],
    /// Whether the pressure at the beginning was taken from the periodic steady state, not fitted.
    pub periodic: bool,
    /// Root of the mean squared residual.
    #[serde(rename = "root_mean_square_mmHg")]
    pub root_mean_square_mmhg: f64,
    /// The same over the pulse pressure.
    pub share_of_pulse: f64,
    /// What the residuals are worth.
    pub noise: EffectiveSampleSize,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
    /// What to mind before the values are used.
    pub warnings: Vec<String>,
    /// Lines for `patient.toml`.
    pub patient_toml: String,
}

/// `cardiotwin fit afterload --cuff --json`: the three-element Windkessel through a cuff's pressures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CuffFitAnswer {
    /// Of the formats.
    pub schema_version: u32,
    /// Where the flow is from.
    pub flow: String,
    /// Mean flow.
    #[serde(rename = "mean_flow_mL_per_s")]
    pub mean_flow_ml_per_s: f64,
    /// Systolic pressure.
    #[serde(rename = "systolic_mmHg")]
    pub systolic_mmhg: f64,
    /// Diastolic pressure.
    #[serde(rename = "diastolic_mmHg")]
    pub diastolic_mmhg: f64,
    /// Mean pressure; absent where it was not measured.
    #[serde(rename = "mean_mmHg")]
    pub mean_mmhg: Option<f64>,
    /// Standard deviation of each pressure.
    #[serde(rename = "sd_mmHg")]
    pub sd_mmhg: f64,
    /// The values as a patient file takes them.
    pub afterload: WindkesselParameters,
    /// Each parameter and R2 C (`time_constant_s`), with intervals of the cuff's and the flow's uncertainty.
    pub estimates: Vec<AfterloadQuantity>,
    /// Probability that an interval covers.
    pub confidence_level: f64,
    /// Whether R1 is a usual share of R2: without a mean pressure, or where none goes with it.
    pub assumed_share: bool,
    /// What to mind before the values are used.
    pub warnings: Vec<String>,
    /// Lines for `patient.toml`.
    pub patient_toml: String,
}

/// A record of flow and pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadRecord {
    /// The flow's file, as it was named.
    pub flow: String,
    /// The pressure's file, as it was named.
    pub pressure: String,
    /// Pressure samples in use.
    pub n_samples: usize,
    /// Pressure samples left out, where no flow was measured.
    pub n_left_out: usize,
    /// Ejections.
    pub n_beats: usize,
    /// Usual time between upstrokes; the record's length where there is one.
    pub cycle_length_ms: f64,
    /// Mean flow.
    #[serde(rename = "mean_flow_mL_per_s")]
    pub mean_flow_ml_per_s: f64,
    /// Highest less lowest pressure.
    #[serde(rename = "pulse_pressure_mmHg")]
    pub pulse_pressure_mmhg: f64,
}

/// One fitted quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadQuantity {
    /// Name with unit.
    pub name: String,
    /// Best value.
    pub value: f64,
    /// Standard error of the linearised model; absent where there is none.
    pub standard_error: Option<f64>,
    /// Lower end of the profile's interval; absent where the record sets none.
    pub lower: Option<f64>,
    /// Upper end of the profile's interval; absent where the record sets none.
    pub upper: Option<f64>,
    /// What the interval says.
    pub determined: Determined,
}

/// How well a record determines a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Determined {
    /// The interval's half width is at most 30 % of the value.
    Well,
    /// It is wider.
    Poorly,
    /// At least one end does not exist.
    Not,
}

/// `cardiotwin discover --afterload --json`: what three elements miss in a record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadDiscovery {
    /// Of the formats.
    pub schema_version: u32,
    /// The flow's file, as it was named.
    pub case: String,
    /// The record.
    pub record: AfterloadRecord,
    /// Whether nothing is named: nothing is missing, or the gap is unexplained.
    pub none: bool,
    /// Candidates beside the three elements, best first.
    pub effects: Vec<AfterloadCandidate>,
    /// Names of the effects that were added.
    pub accepted: Vec<String>,
    /// The effects that were added, as they are in the final model.
    pub added: Vec<AfterloadEffect>,
    /// Probability that nothing is missing, among candidates, the nameless competitor and nothing.
    pub none_probability: f64,
    /// Probability of the nameless competitor.
    pub nameless_probability: f64,
    /// What passes for an accepted effect in this record.
    pub confusable: Vec<AfterloadConfusable>,
    /// What would tell accepted effects from those.
    pub deciding_measurement: Vec<String>,
    /// What this record cannot show, with the reason.
    pub not_identifiable: BTreeMap<String, String>,
    /// What every beat repeats and no candidate explains.
    pub unexplained: Option<AfterloadUnexplained>,
    /// Misfit of three elements over the pulse pressure, all samples.
    pub gap_before: f64,
    /// Misfit of the final model.
    pub gap_after: f64,
    /// Misfit of three elements on samples held out of their fit.
    pub gap_heldout_before: f64,
    /// Misfit of the final model on samples held out of its fit.
    pub gap_heldout_after: f64,
    /// What was held out in turn: `beats`, or `blocks` of a record with few beats.
    pub held_out: String,
    /// Three elements alone.
    pub before: WindkesselParameters,
    /// The three elements of the final model.
    pub after: WindkesselParameters,
    /// What the residuals of the final model are worth.
    pub noise: EffectiveSampleSize,
    /// Effects and afterload as the organ model takes them (`model.toml`), where it can; and in words.
    pub organ: AfterloadInOrgan,
}

/// How the organ model takes a found load.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadInOrgan {
    /// The three elements to go with.
    pub afterload: WindkesselParameters,
    /// Effects of the heart's catalogue.
    pub effects: Vec<EffectSpec>,
    /// In words.
    pub how: String,
}

/// A candidate beside the three elements, refitted with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadCandidate {
    /// Name.
    pub name: String,
    /// What it is.
    pub meaning: String,
    /// Whether the measurement is to be corrected rather than the arteries; absent where either may be.
    pub artefact: Option<bool>,
    /// Probability among all candidates, the nameless competitor and nothing.
    pub probability: f64,
    /// Fall of BIC for the effective number of samples.
    pub delta_bic: f64,
    /// Misfit with it over the pulse pressure.
    pub gap: f64,
    /// Fitted parameters; their names carry the units.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 %, linearised.
    pub interval: BTreeMap<String, [f64; 2]>,
    /// The three elements beside it.
    pub afterload: WindkesselParameters,
    /// Why it was not named, where it was not.
    pub refused: Option<String>,
}

/// An effect that was added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadEffect {
    /// Name.
    pub name: String,
    /// Rise of BIC without it.
    pub delta_bic: f64,
    /// Fitted parameters.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 %, linearised.
    pub interval: BTreeMap<String, [f64; 2]>,
}

/// What passes for an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadConfusable {
    /// The accepted effect.
    pub effect: String,
    /// Its rival.
    pub rival: String,
    /// Evidence that this record would hold against the rival if the effect were true; zero where their equations agree.
    pub expected_delta_bic: f64,
}

/// A gap without a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AfterloadUnexplained {
    /// Fall of BIC with it.
    pub delta_bic: f64,
    /// Harmonics of the beat that it takes.
    pub n_harmonics: usize,
    /// Its size, root of the mean square.
    #[serde(rename = "size_mmHg")]
    pub size_mmhg: f64,
    /// Time after the upstroke of the flow where it is largest.
    pub largest_at_ms: f64,
    /// Share of its variance that a cubic of each of these explains, by name.
    pub depends_on: BTreeMap<String, f64>,
}
