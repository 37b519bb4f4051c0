//! Samples of a finite-element beat from which the organ's law is learned, and the file of a learned
//! law.

use crate::finite_element::VentricleFigures;
use crate::ids::TaskKey;
use crate::input_file::InputFile;
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
    /// Pressure in the ventricle's cavity.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Vec<f64>,
    /// Volume of the ventricle's cavity.
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

/// What is known about the law of an organ.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawKnowledge {
    /// Samples of the organ's beats, oldest first.
    pub beats: Vec<LawSamples>,
    /// File of the law before the organ's first beat; absent for the law of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<InputFile>,
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

/// The law that a task learned, for drawing: its pressure, and how far it is from the beats that
/// taught.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LearnedLaw {
    /// Number of hearts that taught the law before the organ's first beat.
    pub prior_organs: u32,
    /// Hash of the file of that law; absent for the law of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned_from: Option<String>,
    /// Cavity volumes of the curves, from the smallest to the largest for which the law holds.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Vec<f64>,
    /// Pressure at constant stress, by increasing stress.
    pub curves: Vec<LawCurve>,
    /// Beats that taught, oldest first.
    pub beats: Vec<LawBeatFit>,
}

/// Pressure of the law at a constant mean active stress.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawCurve {
    /// Mean active stress.
    #[serde(rename = "active_stress_kPa")]
    pub active_stress_kpa: f64,
    /// Cavity pressure at the volumes of the law.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Vec<f64>,
}

/// A beat that taught, next to the law. Lists have one value for each of the beat's samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawBeatFit {
    /// Cavity volume of the beat.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Vec<f64>,
    /// Cavity pressure of the beat.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Vec<f64>,
    /// Pressure of the learned law at the volumes and mean active stresses of the beat.
    #[serde(rename = "law_pressure_mmHg")]
    pub law_pressure_mmhg: Vec<f64>,
    /// Error of the law that the earlier beats teach, to which this beat is new.
    pub before: LawError,
    /// Error of the learned law.
    pub after: LawError,
}

/// Error of a law's pressure at the volumes and mean active stresses of samples.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct LawError {
    /// Root mean square.
    #[serde(rename = "rms_mmHg")]
    pub rms_mmhg: f64,
    /// Largest absolute value.
    #[serde(rename = "worst_mmHg")]
    pub worst_mmhg: f64,
}

impl LawError {
    /// Error of a law's pressures against a beat's pressures \[mmHg\].
    #[must_use]
    pub fn of(law: &[f64], beat: &[f64]) -> Self {
        let n = law.len().min(beat.len());
        let errors = || law.iter().zip(beat).map(|(law, beat)| law - beat);
        let sum: f64 = errors().map(|error| error * error).sum();
        Self {
            rms_mmhg: (sum / n.max(1) as f64).sqrt(),
            worst_mmhg: errors().map(f64::abs).fold(0.0, f64::max),
        }
    }
}

impl LearnedLaw {
    /// Error over the samples of all beats that taught; `None` without any.
    #[must_use]
    pub fn error(&self) -> Option<LawError> {
        let all = |of: fn(&LawBeatFit) -> &[f64]| -> Vec<f64> {
            self.beats.iter().flat_map(of).copied().collect()
        };
        let law = all(|beat| &beat.law_pressure_mmhg);
        (!law.is_empty()).then(|| LawError::of(&law, &all(|beat| &beat.pressure_mmhg)))
    }

    /// Beats that taught and the law from which learning started, in words.
    #[must_use]
    pub fn origin_words(&self) -> String {
        let beats = match self.beats.len() {
            0 => "no beat yet".to_owned(),
            1 => "1 beat".to_owned(),
            n => format!("{n} beats"),
        };
        let start = if self.learned_from.is_some() {
            "a law file"
        } else {
            "the program's law"
        };
        format!(
            "learned from {beats} (start: {start} of {} hearts)",
            self.prior_organs
        )
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_all_beats_counts_each_sample_once() {
        let beat = |law: &[f64]| LawBeatFit {
            volume_ml: vec![100.0; law.len()],
            pressure_mmhg: vec![10.0; law.len()],
            law_pressure_mmhg: law.to_vec(),
            before: LawError::default(),
            after: LawError::of(law, &vec![10.0; law.len()]),
        };
        let mut law = LearnedLaw {
            prior_organs: 12,
            ..LearnedLaw::default()
        };
        assert_eq!(law.error(), None);
        assert_eq!(
            law.origin_words(),
            "learned from no beat yet (start: the program's law of 12 hearts)"
        );
        law.beats = vec![beat(&[10.0, 10.0, 10.0]), beat(&[6.0])];
        let expected = LawError {
            rms_mmhg: 2.0,
            worst_mmhg: 4.0,
        };
        assert_eq!(law.error(), Some(expected));
        assert_eq!(law.beats[0].after, LawError::default());
        law.learned_from = Some("0".to_owned());
        assert_eq!(
            law.origin_words(),
            "learned from 2 beats (start: a law file of 12 hearts)"
        );
    }
}
