//! Results of `cardiotwin fit afterload` and `cardiotwin discover --afterload`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cardiotwin_vocabulary::fits::{AfterloadUnexplained, Determined};
pub use cardiotwin_vocabulary::statistics::EffectiveSampleSize;

use crate::organ::{EffectSpec, WindkesselParameters};

/// Result of `cardiotwin fit afterload --json`: the three-element Windkessel fitted to a measured
/// flow and pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadFitAnswer {
    /// Version of the formats.
    pub schema_version: u32,
    /// The measured record that is analysed.
    pub record: AfterloadRecord,
    /// Values as they are written to a patient file.
    pub afterload: WindkesselParameters,
    /// Estimates with intervals: each parameter, R2 C (`time_constant_s`), and the pressure on the
    /// compliance at the first sample.
    pub estimates: Vec<AfterloadQuantity>,
    /// Coverage probability of the intervals, for the effective number of samples.
    pub confidence_level: f64,
    /// Correlations of the estimates: R1 with R2, R1 with C, R2 with C; absent if the record does
    /// not separate them.
    pub correlations: [Option<f64>; 3],
    /// Whether the initial pressure was taken from the periodic steady state instead of being
    /// fitted.
    pub periodic: bool,
    /// Root of the mean squared residual.
    #[serde(rename = "root_mean_square_mmHg")]
    pub root_mean_square_mmhg: f64,
    /// Root of the mean squared residual over the pulse pressure.
    pub share_of_pulse: f64,
    /// Statistics of the residuals.
    pub noise: EffectiveSampleSize,
    /// Whether the minimisation met its tolerance.
    pub converged: bool,
    /// Points to check before the values are used.
    pub warnings: Vec<String>,
    /// Lines for `patient.toml`.
    pub patient_toml: String,
}

/// Result of `cardiotwin fit afterload --cuff --json`: the three-element Windkessel fitted to cuff
/// pressures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct CuffFitAnswer {
    /// Version of the formats.
    pub schema_version: u32,
    /// Source of the flow.
    pub flow: String,
    /// Flow averaged over the record.
    #[serde(rename = "mean_flow_mL_per_s")]
    pub mean_flow_ml_per_s: f64,
    /// Systolic pressure.
    #[serde(rename = "systolic_mmHg")]
    pub systolic_mmhg: f64,
    /// Diastolic pressure.
    #[serde(rename = "diastolic_mmHg")]
    pub diastolic_mmhg: f64,
    /// Mean pressure; absent if it was not measured.
    #[serde(rename = "mean_mmHg")]
    pub mean_mmhg: Option<f64>,
    /// Standard deviation of each pressure.
    #[serde(rename = "sd_mmHg")]
    pub sd_mmhg: f64,
    /// Values as they are written to a patient file.
    pub afterload: WindkesselParameters,
    /// Estimates of each parameter and of R2 C (`time_constant_s`). The intervals come from the
    /// uncertainty of cuff and flow.
    pub estimates: Vec<AfterloadQuantity>,
    /// Coverage probability of the intervals.
    pub confidence_level: f64,
    /// Whether a typical ratio of R1 to R2 is assumed. This is so if there is no mean pressure or
    /// no ratio fits it.
    pub assumed_share: bool,
    /// Points to check before the values are used.
    pub warnings: Vec<String>,
    /// Lines for `patient.toml`.
    pub patient_toml: String,
}

/// A record of flow and pressure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadRecord {
    /// File of the flow, as named on the command line.
    pub flow: String,
    /// File of the pressure, as named on the command line.
    pub pressure: String,
    /// Number of pressure samples in use.
    pub n_samples: usize,
    /// Number of pressure samples left out because no flow was measured at their times.
    pub n_left_out: usize,
    /// Number of ejections.
    pub n_beats: usize,
    /// Typical time between upstrokes; the length of the record if there is one upstroke.
    pub cycle_length_ms: f64,
    /// Flow averaged over the record.
    #[serde(rename = "mean_flow_mL_per_s")]
    pub mean_flow_ml_per_s: f64,
    /// Difference between the highest and the lowest pressure.
    #[serde(rename = "pulse_pressure_mmHg")]
    pub pulse_pressure_mmhg: f64,
}

/// One fitted quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadQuantity {
    /// Name with unit.
    pub name: String,
    /// Value of the best fit.
    pub value: f64,
    /// Standard error of the linearised model; absent if it does not exist.
    pub standard_error: Option<f64>,
    /// Lower end of the interval from the profile likelihood; absent if the record does not bound
    /// it.
    pub lower: Option<f64>,
    /// Upper end of the interval from the profile likelihood; absent if the record does not bound
    /// it.
    pub upper: Option<f64>,
    /// How well the record determines the quantity.
    pub determined: Determined,
}

/// Result of `cardiotwin discover --afterload --json`: effects in a record that a three-element
/// Windkessel lacks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadDiscovery {
    /// Version of the formats.
    pub schema_version: u32,
    /// File of the flow, as named on the command line.
    pub case: String,
    /// The measured record that is analysed.
    pub record: AfterloadRecord,
    /// Whether no effect is named, because nothing is missing or because the gap is unexplained.
    pub none: bool,
    /// Candidate effects besides the three elements, best first.
    pub effects: Vec<AfterloadCandidate>,
    /// Names of the effects that were added to the model.
    pub accepted: Vec<String>,
    /// Effects that were added, with their values in the final model.
    pub added: Vec<AfterloadEffect>,
    /// Probability that nothing is missing, compared with the candidates and the nameless
    /// competitor.
    pub none_probability: f64,
    /// Probability of the nameless competitor.
    pub nameless_probability: f64,
    /// Rival effects that the record does not distinguish from an accepted effect.
    pub confusable: Vec<AfterloadConfusable>,
    /// Measurements that would distinguish the accepted effects from their rivals.
    pub deciding_measurement: Vec<String>,
    /// Effects that this record cannot show, with the reason.
    pub not_identifiable: BTreeMap<String, String>,
    /// Residual that every beat repeats and no candidate explains.
    pub unexplained: Option<AfterloadUnexplained>,
    /// Misfit of three elements over the pulse pressure, for all samples.
    pub gap_before: f64,
    /// Misfit of the final model over the pulse pressure, for all samples.
    pub gap_after: f64,
    /// Misfit of three elements on samples held out of their fit.
    pub gap_heldout_before: f64,
    /// Misfit of the final model on samples held out of its fit.
    pub gap_heldout_after: f64,
    /// Data that were held out in turn: `beats`, or `blocks` of a record with few beats.
    pub held_out: String,
    /// Windkessel fitted without effects.
    pub before: WindkesselParameters,
    /// Windkessel of the final model.
    pub after: WindkesselParameters,
    /// Statistics of the final model's residuals.
    pub noise: EffectiveSampleSize,
    /// Representation of the found load in the organ model (`model.toml`).
    pub organ: AfterloadInOrgan,
}

/// Representation of a found load in the organ model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadInOrgan {
    /// Windkessel that goes with the effects.
    pub afterload: WindkesselParameters,
    /// Effects from the catalogue of the heart.
    pub effects: Vec<EffectSpec>,
    /// Explanation in words; it also says if the organ model cannot represent the load.
    pub how: String,
}

/// A candidate effect, fitted together with the three elements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadCandidate {
    /// Name of the effect.
    pub name: String,
    /// Meaning of the effect in words.
    pub meaning: String,
    /// Whether the measurement is to be corrected rather than the arteries; absent if either may
    /// apply.
    pub artefact: Option<bool>,
    /// Probability among all candidates, the nameless competitor and nothing.
    pub probability: f64,
    /// Fall of BIC for the effective number of samples.
    pub delta_bic: f64,
    /// Misfit of the model with the effect, over the pulse pressure.
    pub gap: f64,
    /// Fitted parameters; their names carry the units.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 % from the linearised model.
    pub interval: BTreeMap<String, [f64; 2]>,
    /// Windkessel fitted together with the effect.
    pub afterload: WindkesselParameters,
    /// Reason why the effect was not named; absent if it was.
    pub refused: Option<String>,
}

/// An effect that was added to the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadEffect {
    /// Name of the effect.
    pub name: String,
    /// Rise of BIC if the effect is removed.
    pub delta_bic: f64,
    /// Fitted parameters; their names carry the units.
    pub strength: BTreeMap<String, f64>,
    /// Intervals of 95 % from the linearised model.
    pub interval: BTreeMap<String, [f64; 2]>,
}

/// A rival effect that the record does not distinguish from an accepted effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AfterloadConfusable {
    /// The accepted effect.
    pub effect: String,
    /// Its rival effect.
    pub rival: String,
    /// Expected evidence of this record against the rival if the effect were true; zero if their
    /// equations agree.
    pub expected_delta_bic: f64,
}
