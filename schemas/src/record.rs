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
    Artefact, CellFitResult, LearnLawResult, OrganBeatResult, PassiveStateResult,
    Step1ProposalResult, Step3ProposalResult, TargetsResult,
};
use crate::plan::ResolvedPatient;
use crate::posterior::PosteriorResult;
use crate::provenance::Provenance;
use crate::settings::LastStep;
use crate::status::{NO_INTERVALS, PatientState, PatientStatus, RefusedPatient};
use crate::verdict::Verdict;

/// Results of a cohort's run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunRecord {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Name of the cohort.
    pub cohort: String,
    /// Description of the cohort in one sentence.
    pub description: String,
    /// Directory of the run. Paths of artefacts are absolute.
    pub run_directory: PathBuf,
    /// Time at which the store was read, UTC, RFC 3339.
    pub as_of: String,
    /// Version of the coordinator that read the store.
    pub version: String,
    /// Mark of the store's contents: equal marks of a run mean equal records.
    #[serde(default)]
    pub revision: String,
    /// Patients in the order of the cohort.
    pub patients: Vec<PatientRecord>,
    /// Patients that the last `run` or `advance` left out because of errors in their files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<RefusedPatient>,
}

/// Results of one patient so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PatientRecord {
    /// Inputs and settings.
    pub plan: ResolvedPatient,
    /// State of the patient.
    pub status: PatientStatus,
    /// Result of step 0.
    pub step0: Option<TaskRecord<PassiveStateResult>>,
    /// The organ's law that pilots taught; absent for a pilot and without pilots.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<TaskRecord<LearnLawResult>>,
    /// Simulations of step 1 in order, including failed ones.
    pub iterations: Vec<IterationRecord>,
    /// Ending and result of step 1.
    pub step1: Option<Step1Summary>,
    /// Targets of step 2.
    pub targets: Option<TaskRecord<TargetsResult>>,
    /// Result of step 2.
    pub cell_fit: Option<TaskRecord<CellFitResult>>,
    /// Fit of step 2's cell in the organ's law, whose cell the verification beat has; absent for a
    /// reduced ventricle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub organ_fit: Option<TaskRecord<Step3ProposalResult>>,
    /// Result of the verification beat.
    pub verification: Option<TaskRecord<OrganBeatResult>>,
    /// Cost of the verification beat by the formula of step 1.
    pub verification_cost: Option<f64>,
    /// Simulations of step 3 in order, including failed ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step3_iterations: Vec<Step3IterationRecord>,
    /// Ending and result of step 3.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step3: Option<Step3Summary>,
    /// Posterior of the twin's parameters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior: Option<TaskRecord<PosteriorResult>>,
    /// Failure of the posterior, which does not hold the patient: the twin has no intervals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior_failure: Option<Failure>,
    /// Agreement of the twin's beat with the measured biomarkers. The twin's beat is the best one
    /// of step 3 or else the verification beat; absent if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Failure that holds the patient, if there is one.
    pub failure: Option<Failure>,
    /// Wall time of the patient's finished tasks that have no record of their own: failures, such as
    /// simulations that diverged, and proposals that no simulation followed.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero")]
    pub other_wall_s: f64,
    /// Results for the same ventricle before effects were accepted, if this run simulated it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<Box<BeforeEffects>>,
}

/// Simulations of the same ventricle without the effects that have been accepted since.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BeforeEffects {
    /// Result of step 1.
    pub step1: Option<TaskRecord<OrganBeatResult>>,
    /// Result of the verification beat.
    pub verification: Option<TaskRecord<OrganBeatResult>>,
}

/// Published result of a task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TaskRecord<T> {
    /// Key of the task.
    pub key: TaskKey,
    /// Number of the attempt that published the result.
    pub generation: u32,
    /// Directory of the artefacts.
    pub directory: PathBuf,
    /// Files of the attempt.
    pub artefacts: Vec<Artefact>,
    /// Provenance of the result.
    pub provenance: Provenance,
    /// Result of the computation.
    pub result: T,
}

impl<T> TaskRecord<T> {
    /// Absolute path of the artefact called `name`, and its SHA-256 when it was written.
    #[must_use]
    pub fn stored(&self, name: &str) -> Option<(PathBuf, &str)> {
        let artefact = self.artefacts.iter().find(|a| a.name == name)?;
        Some((self.directory.join(&artefact.file), &artefact.sha256))
    }

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
    /// Number of the simulation, from 1.
    pub number: u32,
    /// Parameters of the simulation.
    pub parameters: Step1Parameters,
    /// Task that proposed the parameters, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub proposal: Option<TaskRecord<Step1ProposalResult>>,
    /// Result of the simulation, if it succeeded.
    pub run: Option<TaskRecord<OrganBeatResult>>,
    /// Failure of the simulation, if it failed.
    pub failure: Option<Failure>,
    /// Sum of squared relative differences to the measured biomarkers.
    pub cost: Option<f64>,
    /// Relative differences (simulated − measured) / measured, by biomarker.
    pub relative_differences: BTreeMap<String, f64>,
}

/// One simulation of step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step3IterationRecord {
    /// Number of the simulation, from 1.
    pub number: u32,
    /// Parameters of the cell and the valves, by name.
    pub parameters: BTreeMap<String, f64>,
    /// Task that proposed the parameters.
    pub proposal: Option<TaskRecord<Step3ProposalResult>>,
    /// Result of the simulation, if it succeeded.
    pub run: Option<TaskRecord<OrganBeatResult>>,
    /// Failure of the simulation, if it failed.
    pub failure: Option<Failure>,
    /// Sum of squared differences to the measurements over the measurements' variances.
    pub misfit: Option<f64>,
    /// Agreement of the beat with the measured biomarkers.
    pub verdict: Option<Verdict>,
}

impl PatientRecord {
    /// The law from which the search of parameters started, in words; `None` without the organ's
    /// law, and while the patient may wait for pilots.
    #[must_use]
    pub fn start_of_the_law(&self) -> Option<String> {
        let may_wait = self.plan.n_pilots() > 0 && self.law.is_none() && self.iterations.is_empty();
        if !self.plan.uses_the_organs_law() || may_wait {
            return None;
        }
        Some(match (&self.law, &self.plan.law) {
            (Some(law), _) => {
                let organs = law.result.organs.iter();
                let names: Vec<&str> = organs.map(|organ| organ.patient.as_str()).collect();
                match names.as_slice() {
                    [] => law.result.words(),
                    names => format!("pilots {} ({})", names.join(", "), law.result.words()),
                }
            }
            (None, Some(file)) => format!("file {}", file.path.display()),
            (None, None) => "of the program".to_owned(),
        })
    }

    /// Verdict on a verified twin that is outside of its tolerances; `None` for any other patient.
    #[must_use]
    pub fn off(&self) -> Option<&Verdict> {
        self.verdict
            .as_ref()
            .filter(|verdict| !verdict.personalised)
    }

    /// Why a finished twin has no intervals although its settings ask for them; `None` for any other
    /// patient.
    #[must_use]
    pub fn without_intervals(&self) -> Option<String> {
        let settings = &self.plan.settings;
        let is_missing = settings.posterior.enabled
            && settings.workflow.until == LastStep::Step3
            && self.step3.is_some()
            && self.posterior.is_none()
            && self.status.state == PatientState::Done;
        let why = || match &self.posterior_failure {
            Some(failure) => format!("{NO_INTERVALS}: {}", failure.message),
            None => NO_INTERVALS.to_owned(),
        };
        is_missing.then(why)
    }

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

/// Reason why step 1 ended without converging.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StallReason {
    /// Several iterations in a row brought no improvement.
    Stagnation,
    /// A simulation failed.
    SimulationFailed,
    /// The largest number of iterations was reached.
    IterationLimit,
}

impl StallReason {
    /// The reason in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Stagnation => "the cost no longer decreased",
            Self::SimulationFailed => "a simulation failed",
            Self::IterationLimit => "the limit of iterations was reached",
        }
    }
}

/// Quality of step 1's result. A stalled step 1 still gives a result, which is marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "quality", rename_all = "kebab-case")]
pub enum Step1Quality {
    /// The best iterate is within the tolerance.
    Converged,
    /// The best iterate is not within the tolerance.
    Stalled {
        /// Reason why the loop ended.
        reason: StallReason,
    },
}

/// Ending and result of step 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step1Summary {
    /// Quality of the result.
    pub quality: Step1Quality,
    /// Number of the iteration with the result.
    pub best_iteration: u32,
    /// Cost of this iteration.
    pub cost: f64,
    /// Number of the first iteration within the tolerance.
    pub first_converged: Option<u32>,
    /// Personalised parameters.
    pub parameters: Step1Parameters,
}

/// Reason why step 3 ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Step3Ending {
    /// The best beat agrees with the measurements to within their uncertainty.
    WithinUncertainty,
    /// Another beat was predicted to bring too little improvement.
    NoPromise,
    /// The largest number of simulations was reached.
    IterationLimit,
}

/// Ending and result of step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Step3Summary {
    /// Reason why step 3 ended.
    pub ending: Step3Ending,
    /// Number of the simulation with the result, from 1; 0 if the verification beat is the best.
    pub best_iteration: u32,
    /// Sum of squared differences of this beat to the measurements over the measurements'
    /// variances.
    pub misfit: f64,
    /// Personalised parameters of the cell and the valves, by name.
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
