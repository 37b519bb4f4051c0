//! Samples of a finite-element beat from which the organ's law is learned, and the file of a learned
//! law.

use crate::finite_element::VentricleFigures;
use crate::ids::TaskKey;
use crate::organ::CellStretch;
use cardiotwin_vocabulary::organ_law::LawPrior;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Number of samples of a beat, equally spaced from its start.
pub const N_LAW_SAMPLES: usize = 80;

/// Values at the times k T / 80 of the beat, where T is the cycle length. Means are over the wall,
/// weighted by volume.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawSamples {
    /// Cavity pressure.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Vec<f64>,
    /// Cavity volume.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Vec<f64>,
    /// Mean active stress.
    #[serde(rename = "active_stress_kPa")]
    pub active_stress_kpa: Vec<f64>,
    /// Mean stretch of the cells.
    pub stretch: Vec<f64>,
    /// Standard deviation of the stretch over the wall along its pattern at the greatest stress, signed.
    pub stretch_deviation: Vec<f64>,
    /// Active stress along the same pattern: the mean of the product of both.
    #[serde(rename = "stress_deviation_kPa")]
    pub stress_deviation_kpa: Vec<f64>,
}

/// What an organ's beats teach about the organ's law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawLesson {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Figures of the organ.
    pub figures: VentricleFigures,
    /// Reference of the cells' stretch.
    pub cell_stretch: CellStretch,
    /// Beats, oldest first.
    pub beats: Vec<LessonBeat>,
}

/// A beat that teaches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LessonBeat {
    /// Key of the beat's task.
    pub task: TaskKey,
    /// Samples of the beat.
    pub samples: LawSamples,
}

/// What organs taught about the organ's law (`cardiotwin export --law`): the start of further
/// patients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawFile {
    /// Version of the format.
    pub schema_version: u32,
    /// Version of the program that wrote the file.
    pub program: String,
    /// Hash of the law from which learning started; absent for the law of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned_from: Option<String>,
    /// Organs that taught, sorted by name.
    pub organs: Vec<LawTeacher>,
    /// The law before an organ's first beat.
    pub prior: LawPrior,
}

/// An organ that taught.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawTeacher {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Keys of the beats that taught, oldest first.
    pub beats: Vec<String>,
    /// Root mean square of the pressure's error over all samples of the beats, in the law before
    /// learning.
    #[serde(rename = "pressure_error_before_mmHg")]
    pub pressure_error_before_mmhg: f64,
    /// The same error in the learned law.
    #[serde(rename = "pressure_error_after_mmHg")]
    pub pressure_error_after_mmhg: f64,
}
