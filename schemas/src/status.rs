//! Output of `cardiotwin status --json`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;
use crate::verdict::OFF;

/// Words for a finished twin whose posterior could not be sampled, although its settings ask for one.
pub const NO_INTERVALS: &str = "uncertainty unknown";

/// State of a patient.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Default,
    Serialize,
    Deserialize,
    JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum PatientState {
    /// A person cancelled the work on the patient.
    Cancelled,
    /// The patient's chain is complete.
    Done,
    /// A failure holds the patient until a person acts.
    Failed,
    /// A task of the patient is running.
    Running,
    /// There is no news of the patient's task.
    Unknown,
    /// The patient waits for its turn.
    #[default]
    Waiting,
}

impl PatientState {
    /// All states, in alphabetical order.
    pub const ALL: [Self; 6] = [
        Self::Cancelled,
        Self::Done,
        Self::Failed,
        Self::Running,
        Self::Unknown,
        Self::Waiting,
    ];

    /// Name of the state, for tables and files.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Cancelled => "cancelled",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Running => "running",
            Self::Unknown => "unknown",
            Self::Waiting => "waiting",
        }
    }

    /// State of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.as_str() == name)
    }

    /// Whether nothing happens to the patient any more without a person.
    #[must_use]
    pub fn is_over(self) -> bool {
        matches!(self, Self::Done | Self::Failed | Self::Cancelled)
    }
}

impl std::fmt::Display for PatientState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// State of a job, or of an element of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobState {
    /// The job is being submitted.
    Submitting,
    /// Slurm gave no clear answer to the submission.
    Doubtful,
    /// The element is in the queue.
    Waiting,
    /// The element has nodes.
    Running,
    /// The element is visibly neither alive nor ended.
    Unknown,
    /// The element was asked to end.
    Stopping,
    /// The element has ended.
    Over,
}

impl JobState {
    /// Name of the state, for tables and files.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Submitting => "submitting",
            Self::Doubtful => "doubtful",
            Self::Waiting => "waiting",
            Self::Running => "running",
            Self::Unknown => "unknown",
            Self::Stopping => "stopping",
            Self::Over => "over",
        }
    }
}

impl std::fmt::Display for JobState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.as_str())
    }
}

/// Status of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Status {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Name of the cohort.
    pub cohort: String,
    /// Time at which the store was read, UTC, RFC 3339.
    pub as_of: String,
    /// Whether a coordinator holds the run at present.
    pub coordinator_running: bool,
    /// Number of patients by state.
    pub counts: BTreeMap<PatientState, u64>,
    /// Status of each patient, failed patients first.
    pub patients: Vec<PatientStatus>,
    /// Patients that the last `run` or `advance` left out because of errors in their files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<RefusedPatient>,
    /// Patients of the cohort's files that the run does not know yet.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub new_patients: Vec<String>,
    /// Patients whose files or settings changed since the run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changed_patients: Vec<ChangedPatient>,
    /// What pilots taught about the organ's law (`workflow.pilots`); absent before, and without
    /// pilots.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned: Option<LearnedStatus>,
    /// Jobs on the cluster, if the run has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cluster: Option<ClusterStatus>,
}

/// A patient that the next run would redo.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ChangedPatient {
    /// Pseudonym of the patient.
    pub patient: String,
    /// First step that would be computed again.
    pub from: String,
}

/// What pilots taught about the organ's law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LearnedStatus {
    /// Pseudonyms of the patients whose organs taught.
    pub organs: Vec<String>,
    /// Number of beats that taught.
    pub beats: u64,
    /// Root mean square of the pressure's error before an organ's first beat, in the mean of the
    /// organs, in the law before learning; absent if no organ taught.
    #[serde(rename = "pressure_error_before_mmHg")]
    pub pressure_error_before_mmhg: Option<f64>,
    /// The same error in the learned law.
    #[serde(rename = "pressure_error_after_mmHg")]
    pub pressure_error_after_mmhg: Option<f64>,
    /// The same in words.
    pub words: String,
}

/// A patient whose files have errors. Its results of earlier runs stay, and no task of it begins.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RefusedPatient {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Errors, with file, line and remedy.
    pub errors: Vec<String>,
}

/// Status of a run's jobs on a cluster.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ClusterStatus {
    /// Name of the site.
    pub site: String,
    /// Time of the scheduler's last answer, UTC, RFC 3339; empty if there was none.
    pub as_of: String,
    /// Age of this answer, s.
    pub age_s: f64,
    /// Reason why the last query had no answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_answer: Option<String>,
    /// Reason why nothing is submitted at present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holds: Option<String>,
    /// Node-hours used by the jobs of this run so far.
    pub node_hours: f64,
    /// Node-hours that are still expected to be needed.
    pub node_hours_left: f64,
    /// Charge so far.
    pub charge: f64,
    /// Unit of the charge.
    pub charge_unit: String,
    /// Expected end of the last job, UTC, if as many jobs run at once as the limits allow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_end: Option<String>,
    /// Jobs, or elements of arrays, that have not ended.
    pub jobs: Vec<JobStatus>,
}

/// A job or an element of an array.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobStatus {
    /// Number given by the scheduler; empty while it is not known.
    pub id: String,
    /// Unique name, which is also the name of the job's folder below `slurm`.
    pub name: String,
    /// State of the job.
    pub state: JobState,
    /// Why the job waits, in words.
    pub why: String,
    /// Pseudonyms of the patients in the job.
    pub patients: Vec<String>,
}

/// Status of a patient: one row of the table.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PatientStatus {
    /// Pseudonym of the patient.
    pub patient: String,
    /// Step: `step-0`, `step-1`, `targets`, `step-2`, `verification`, `done`.
    pub step: String,
    /// State of the patient.
    pub state: PatientState,
    /// Number of iterations of step 1 so far, and its limit.
    pub iteration: Option<(u32, u32)>,
    /// Best cost of step 1 so far.
    pub step1_cost: Option<f64>,
    /// Quality of step 1: `converged`, `stalled: best iteration k`, ….
    pub step1_quality: Option<String>,
    /// Cost of step 2.
    pub step2_cost: Option<f64>,
    /// Seconds in the present state.
    pub for_s: f64,
    /// Class of the failure, if the patient failed.
    pub failure_class: Option<FailureClass>,
    /// Text for people.
    pub note: String,
}

impl PatientStatus {
    /// Whether the patient is done, but its verified twin is outside of the tolerances. The note of such
    /// a patient has the verdict.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.state == PatientState::Done && self.note.contains(OFF)
    }

    /// The step, unless the state alone says all.
    #[must_use]
    pub fn step_shown(&self) -> &str {
        if self.step == self.state.as_str() {
            "-"
        } else {
            &self.step
        }
    }

    /// Step and state in words, without repetition.
    #[must_use]
    pub fn words(&self) -> String {
        match self.step_shown() {
            "-" => self.state.to_string(),
            step => format!("{step} {}", self.state),
        }
    }
}
