//! What the coordinator keeps of a patient when a run is planned: settings resolved, inputs hashed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ids::PatientId;
use crate::settings::Settings;
use crate::task::{InputFile, PassiveStateSpec};

/// Which chain of tasks a patient runs through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Workflow {
    /// Step 0, step 1, targets, step 2, verification.
    Personalise,
    /// Three no-op tasks: measures orchestration.
    Noop {
        /// How long each pretends to work.
        sleep_ms: u64,
    },
}

/// A patient ready to run. Every task of the patient follows from this and from the outcomes so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ResolvedPatient {
    /// Pseudonym.
    pub id: PatientId,
    /// Which chain.
    pub workflow: Workflow,
    /// Whose stream of random numbers it draws from, where not its own: members of a sweep share their patient's, so
    /// that they differ in nothing but what the sweep varies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub random_stream: Option<PatientId>,
    /// Step 0's task: all measured inputs, by content.
    pub step0: PassiveStateSpec,
    /// Measured calcium transient, for `step2.calcium = "median-trace"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calcium: Option<InputFile>,
    /// Settings, all layers merged (executor included, which never enters a task's key).
    pub settings: Settings,
    /// Effects accepted for this patient.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<crate::organ::EffectSpec>,
}

impl ResolvedPatient {
    /// Whose stream of random numbers the patient draws from.
    #[must_use]
    pub fn random_stream(&self) -> &PatientId {
        self.random_stream.as_ref().unwrap_or(&self.id)
    }
}
