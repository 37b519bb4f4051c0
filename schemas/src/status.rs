//! `cardiotwin status --json`.

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
