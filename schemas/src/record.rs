//! Record of a run for reports, exports and comparisons. It is made from the store and does not
//! depend on it afterwards.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::Failure;
use crate::ids::TaskKey;
use crate::organ::Step1Parameters;
use crate::outcome::{
    Artefact, CellFitResult, OrganBeatResult, PassiveStateResult, Step1ProposalResult,
    Step3ProposalResult, TargetsResult,
};
use crate::plan::ResolvedPatient;
use crate::posterior::PosteriorResult;
use crate::provenance::Provenance;
use crate::status::PatientStatus;
use crate::verdict::Verdict;

/// A run of a cohort.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunRecord {
    /// Format version.
    pub schema_version: u32,
    /// Cohort name.
    pub cohort: String,
    /// One sentence.
    pub description: String,
    /// Directory of the run; artefact paths are absolute.
    pub run_directory: PathBuf,
    /// UTC, RFC 3339: when the store was read.
    pub as_of: String,
    /// Version of the coordinator that read it.
    pub version: String,
    /// In the cohort's order.
    pub patients: Vec<PatientRecord>,
}

/// A patient's results so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PatientRecord {
    /// Inputs and settings.
    pub plan: ResolvedPatient,
    /// Where the patient stands.
    pub status: PatientStatus,
    /// Step 0.
    pub step0: Option<TaskRecord<PassiveStateResult>>,
    /// Step 1's simulations, in order, failed ones included.
    pub iterations: Vec<IterationRecord>,
    /// How step 1 ended.
    pub step1: Option<Step1Summary>,
    /// Step 2's targets.
    pub targets: Option<TaskRecord<TargetsResult>>,
    /// Step 2.
    pub cell_fit: Option<TaskRecord<CellFitResult>>,
    /// The verification beat.
    pub verification: Option<TaskRecord<OrganBeatResult>>,
    /// Cost of the verification beat by step 1's formula.
    pub verification_cost: Option<f64>,
    /// Step 3's simulations, in order, failed ones included.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step3_iterations: Vec<Step3IterationRecord>,
    /// How step 3 ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step3: Option<Step3Summary>,
    /// How sure the twin is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior: Option<TaskRecord<PosteriorResult>>,
    /// What the twin's beat says of it: the verification beat, or the best one of step 3; absent without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The failure that holds the patient, if one does.
    pub failure: Option<Failure>,
    /// The same ventricle before effects were accepted, where this run simulated it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<Box<BeforeEffects>>,
}

/// Simulations of the same ventricle without the effects that were accepted since.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BeforeEffects {
    /// Step 1's result.
    pub step1: Option<TaskRecord<OrganBeatResult>>,
    /// The verification beat.
    pub verification: Option<TaskRecord<OrganBeatResult>>,
}

/// The published result of a task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TaskRecord<T> {
    /// The task.
    pub key: TaskKey,
    /// Which try published.
    pub generation: u32,
    /// Where its artefacts lie.
    pub directory: PathBuf,
    /// Its files.
    pub artefacts: Vec<Artefact>,
    /// How it was made.
    pub provenance: Provenance,
    /// What was computed.
    pub result: T,
}

impl<T> TaskRecord<T> {
    /// Absolute path of the artefact called `name`.
    #[must_use]
    pub fn artefact(&self, name: &str) -> Option<PathBuf> {
        self.artefacts
            .iter()
            .find(|a| a.name == name)
            .map(|a| self.directory.join(&a.file))
    }
}

/// One simulation of step 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct IterationRecord {
    /// 1 for the first.
    pub number: u32,
    /// What was simulated.
    pub parameters: Step1Parameters,
    /// What proposed it, where a task of its own did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proposal: Option<TaskRecord<Step1ProposalResult>>,
    /// What came out, where the simulation succeeded.
    pub run: Option<TaskRecord<OrganBeatResult>>,
    /// Why it failed, where it did.
    pub failure: Option<Failure>,
    /// Sum of squared relative differences to the measured biomarkers.
    pub cost: Option<f64>,
    /// Relative differences (simulated − measured) / measured, by biomarker.
    pub relative_differences: BTreeMap<String, f64>,
}

/// One simulation of step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step3IterationRecord {
    /// 1 for the first.
    pub number: u32,
    /// What was simulated: parameters of the cell and of the valves, by name.
    pub parameters: BTreeMap<String, f64>,
    /// What proposed it.
    pub proposal: Option<TaskRecord<Step3ProposalResult>>,
    /// What came out, where the simulation succeeded.
    pub run: Option<TaskRecord<OrganBeatResult>>,
    /// Why it failed, where it did.
    pub failure: Option<Failure>,
    /// Squared differences over the measurements' variances.
    pub misfit: Option<f64>,
    /// What it says of the twin.
    pub verdict: Option<Verdict>,
}

impl PatientRecord {
    /// The beat of the personalised twin: the best beat of step 3, or else the verification beat.
    #[must_use]
    pub fn twin(&self) -> Option<&TaskRecord<OrganBeatResult>> {
        let number = self.step3.as_ref().map_or(0, |step3| step3.best_iteration);
        let of_step3 = self
            .step3_iterations
            .iter()
            .find(|iteration| iteration.number == number);
        of_step3
            .and_then(|iteration| iteration.run.as_ref())
            .or(self.verification.as_ref())
    }
}

/// Why step 1 ended without converging.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StallReason {
    /// No improvement for several iterations in a row.
    Stagnation,
    /// A simulation failed.
    SimulationFailed,
    /// The largest number of iterations was reached.
    IterationLimit,
}

/// Quality of step 1's result. A stalled step 1 is a result with a mark, not an end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "quality", rename_all = "kebab-case")]
pub enum Step1Quality {
    /// The best iterate is within the tolerance.
    Converged,
    /// It is not.
    Stalled {
        /// Why the loop ended.
        reason: StallReason,
    },
}

/// How step 1 ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step1Summary {
    /// Converged, or stalled and why.
    pub quality: Step1Quality,
    /// The iterate that was taken.
    pub best_iteration: u32,
    /// Its cost.
    pub cost: f64,
    /// The first iterate within the tolerance.
    pub first_converged: Option<u32>,
    /// The personalised parameters.
    pub parameters: Step1Parameters,
}

/// Why step 3 ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Step3Ending {
    /// The best beat meets the measurements to within their uncertainty.
    WithinUncertainty,
    /// Another beat promised too little.
    NoPromise,
    /// The largest number of simulations was reached.
    IterationLimit,
}

/// How step 3 ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step3Summary {
    /// Why it ended.
    pub ending: Step3Ending,
    /// The simulation that was taken, from 1; 0 where the verification beat was the best.
    pub best_iteration: u32,
    /// Its squared differences over the measurements' variances.
    pub misfit: f64,
    /// The personalised parameters of the cell and the valves, by name.
    pub parameters: BTreeMap<String, f64>,
}

impl std::fmt::Display for Step1Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.quality {
            Step1Quality::Converged => write!(f, "converged: iteration {}", self.best_iteration),
            Step1Quality::Stalled { .. } => {
                write!(f, "stalled: best iteration {}", self.best_iteration)
            }
        }
    }
}
