//! Output of `cardiotwin status --json`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;

/// Status of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Status {
    /// Format version.
    pub schema_version: u32,
    /// Name of the cohort.
    pub cohort: String,
    /// Time at which the store was read, UTC, RFC 3339.
    pub as_of: String,
    /// Whether a coordinator holds the run at present.
    pub coordinator_running: bool,
    /// Number of patients by state.
    pub counts: BTreeMap<String, u64>,
    /// Status of each patient, failed patients first.
    pub patients: Vec<PatientStatus>,
    /// Patients that the last `run` or `advance` left out because of errors in their files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub refused: Vec<RefusedPatient>,
    /// Jobs on the cluster, if the run has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cluster: Option<ClusterStatus>,
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
    /// State: `submitting`, `doubtful`, `waiting`, `running`, `unknown`, `stopping`.
    pub state: String,
    /// Reason for which the job waits, in words.
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
    /// State: `waiting`, `running`, `done`, `failed`, `cancelled`, `unknown`.
    pub state: String,
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
