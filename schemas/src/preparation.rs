//! `cardiotwin prepare --json` and `prepared/prepare.json`: results of the preparation of
//! recordings, step by step.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Result of `cardiotwin prepare`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Preparation {
    /// Version of the formats.
    pub schema_version: u32,
    /// Pseudonym of the patient.
    pub id: String,
    /// Files that were read, with hashes of their contents.
    pub files: Vec<RawInput>,
    /// Cycle length of the beat.
    pub cycle_length_ms: f64,
    /// Beats that were found in the recording.
    pub beats: BeatsFound,
    /// Steps in the order of their execution.
    pub steps: Vec<StepDone>,
    /// Points to check before the files are used.
    pub warnings: Vec<String>,
    /// Files that were written, relative to the patient's folder. With `--dry-run`, the files that
    /// would have been written.
    pub written: Vec<String>,
    /// Text of `patient.toml` as written.
    pub patient_toml: String,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RawInput {
    /// Name of the file in the folder.
    pub file: String,
    /// SHA-256 of its content.
    pub sha256: String,
    /// Number of samples or frames.
    pub n_rows: usize,
    /// Decisions of the reader: format, encoding, separators, and which column became which
    /// quantity. Empty for a file in the program's own form.
    #[serde(default)]
    pub read_as: Vec<String>,
}

/// Beats of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BeatsFound {
    /// Description of the event that begins each beat.
    pub source: String,
    /// Number of beats in the recording.
    pub found: usize,
    /// Number of beats that enter the mean.
    pub kept: usize,
    /// Beats that do not enter the mean.
    pub left_out: Vec<BeatLeftOut>,
}

/// A beat that does not enter the mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BeatLeftOut {
    /// Number of the beat, from 1.
    pub number: usize,
    /// Beginning of the beat on the recording's clock.
    pub onset_ms: f64,
    /// Length of the beat.
    pub length_ms: f64,
    /// Kind of the beat: damaged, ectopic, cut-short, after-ectopic, pause, no-single-rise,
    /// unusual-shape, by-hand.
    pub kind: String,
    /// Reasons why the beat was left out, the most serious first.
    pub reasons: Vec<String>,
}

/// One step of the preparation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct StepDone {
    /// Name of the step, as in `prepare.toml`.
    pub step: String,
    /// Outcome of the step.
    pub state: StepState,
    /// Description of the change and its size.
    pub what: String,
    /// Numbers of the step; each name contains the unit.
    pub numbers: BTreeMap<String, f64>,
}

/// Outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StepState {
    /// Done with values derived from the recordings.
    Done,
    /// Done with values from `prepare.toml`.
    Given,
    /// Done, but nothing had to be changed.
    Unchanged,
    /// Switched off in `prepare.toml`.
    Off,
    /// Not done, since data that it needs were not recorded.
    Lacking,
}

impl StepState {
    /// Name in files and tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Given => "given",
            Self::Unchanged => "unchanged",
            Self::Off => "off",
            Self::Lacking => "lacking",
        }
    }
}
