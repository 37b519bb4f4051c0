//! `cardiotwin prepare --json`, `prepared/prepare.json`: what was made of recordings, step by step.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Preparation {
    /// Of the formats.
    pub schema_version: u32,
    /// The patient.
    pub id: String,
    /// Files that were read, with their contents' hashes.
    pub files: Vec<RawInput>,
    /// Cycle length of the beat.
    pub cycle_length_ms: f64,
    /// Beats of the recording.
    pub beats: BeatsFound,
    /// Steps in their order.
    pub steps: Vec<StepDone>,
    /// What to look at.
    pub warnings: Vec<String>,
    /// Files that were written, relative to the patient's folder; that would be with `--dry-run`.
    pub written: Vec<String>,
    /// `patient.toml` as it was written.
    pub patient_toml: String,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RawInput {
    /// Its name in the folder.
    pub file: String,
    /// SHA-256 of its content.
    pub sha256: String,
    /// Samples or frames.
    pub n_rows: usize,
}

/// Beats of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BeatsFound {
    /// What they begin with, in words.
    pub source: String,
    /// How many.
    pub found: usize,
    /// How many are in the mean.
    pub kept: usize,
    /// Those that are not.
    pub left_out: Vec<BeatLeftOut>,
}

/// A beat that is not in the mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BeatLeftOut {
    /// Its number, from 1.
    pub number: usize,
    /// Its beginning on the recording's clock.
    pub onset_ms: f64,
    /// Its length.
    pub length_ms: f64,
    /// What kind of beat it is: damaged, ectopic, cut-short, after-ectopic, pause, no-single-rise, unusual-shape, by-hand.
    pub kind: String,
    /// Why, the gravest first.
    pub reasons: Vec<String>,
}

/// A step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct StepDone {
    /// Its name, as in `prepare.toml`.
    pub step: String,
    /// Whether it changed anything.
    pub state: StepState,
    /// What it changed, and by how much.
    pub what: String,
    /// The numbers, each with its unit in the name.
    pub numbers: BTreeMap<String, f64>,
}

/// How a step went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StepState {
    /// Done by what the recordings show.
    Done,
    /// Done by what `prepare.toml` says.
    Given,
    /// Nothing was to be changed.
    Unchanged,
    /// Switched off in `prepare.toml`.
    Off,
    /// What it needs was not recorded.
    Lacking,
}

impl StepState {
    /// As files and tables have it.
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
