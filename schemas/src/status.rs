//! Output of `cardiotwin status --json`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::FailureClass;

/// One screen of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Status {
    /// Format version.
    pub schema_version: u32,
    /// Cohort name.
    pub cohort: String,
    /// UTC, RFC 3339: when the store was read.
    pub as_of: String,
    /// Whether a coordinator holds the run now.
    pub coordinator_running: bool,
    /// Patients by state.
    pub counts: BTreeMap<String, u64>,
    /// Per patient, failures first.
    pub patients: Vec<PatientStatus>,
    /// Jobs of the cluster, where the run has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cluster: Option<ClusterStatus>,
}

/// What is known of a run's jobs on a cluster.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ClusterStatus {
    /// The site.
    pub site: String,
    /// UTC, RFC 3339: when the scheduler answered last; empty where it never did.
    pub as_of: String,
    /// How old that is, s.
    pub age_s: f64,
    /// Why the last question had no answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_answer: Option<String>,
    /// Why nothing is submitted at present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holds: Option<String>,
    /// Node-hours of this run's jobs so far.
    pub node_hours: f64,
    /// Node-hours that are expected to be needed still.
    pub node_hours_left: f64,
    /// What they are charged so far.
    pub charge: f64,
    /// In what.
    pub charge_unit: String,
    /// When the last job is expected to end, UTC, if everything ran at once that the limits allow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_end: Option<String>,
    /// Jobs, elements of arrays each, that are not over.
    pub jobs: Vec<JobStatus>,
}

/// A job, or an element of an array.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobStatus {
    /// The scheduler's number; empty while it is not known.
    pub id: String,
    /// Unique name, also its folder's below `slurm`.
    pub name: String,
    /// `submitting`, `doubtful`, `waiting`, `running`, `unknown`, `stopping`.
    pub state: String,
    /// In words: what it waits for.
    pub why: String,
    /// Patients.
    pub patients: Vec<String>,
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PatientStatus {
    /// Pseudonym.
    pub patient: String,
    /// `step-0`, `step-1`, `targets`, `step-2`, `verification`, `done`.
    pub step: String,
    /// `waiting`, `running`, `done`, `failed`, `cancelled`, `unknown`.
    pub state: String,
    /// Iterations of step 1 so far, and their limit.
    pub iteration: Option<(u32, u32)>,
    /// Best cost of step 1 so far.
    pub step1_cost: Option<f64>,
    /// Quality of step 1: `converged`, `stalled: best iteration k`, ….
    pub step1_quality: Option<String>,
    /// Cost of step 2.
    pub step2_cost: Option<f64>,
    /// Seconds in the present state.
    pub for_s: f64,
    /// Class of the failure, where failed.
    pub failure_class: Option<FailureClass>,
    /// For a person.
    pub note: String,
}
