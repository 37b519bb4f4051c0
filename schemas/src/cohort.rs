//! The file `cohort.toml`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::settings::Settings;

/// A cohort: a folder with this file and a folder per patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CohortFile {
    /// Short name, which appears in tables, job names and reports.
    pub name: String,
    /// Description in one sentence.
    #[serde(default)]
    pub description: String,
    /// Folder that contains one folder per patient, relative to `cohort.toml`.
    #[serde(default = "patients_folder")]
    pub patients: String,
    /// Whether keys may name files outside the cohort's folder. Set it only if you trust the
    /// patients' files.
    #[serde(default)]
    pub allow_outside: bool,
    /// Values for patient files that lack them.
    #[serde(default)]
    pub defaults: PatientDefaults,
    /// Settings of the organ and its simulation. Here and below, absent keys keep their default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::settings::SolverSettings>")]
    pub solver: Option<serde_json::Value>,
    /// Settings of step 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::settings::Step1Settings>")]
    pub step1: Option<serde_json::Value>,
    /// Settings of step 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::settings::CellFitSettings>")]
    pub step2: Option<serde_json::Value>,
    /// Settings of the verification beat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::settings::VerificationSettings>")]
    pub verification: Option<serde_json::Value>,
    /// Settings of step 3.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::step3::Step3Settings>")]
    pub step3: Option<serde_json::Value>,
    /// Settings of the posterior's sampling.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::posterior::PosteriorSettings>")]
    pub posterior: Option<serde_json::Value>,
    /// Settings of the workflow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::settings::WorkflowSettings>")]
    pub workflow: Option<serde_json::Value>,
    /// Settings of the executor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<crate::settings::ExecutorSettings>")]
    pub executor: Option<serde_json::Value>,
}

impl CohortFile {
    /// The settings of this file as a layer.
    #[must_use]
    pub fn layer(&self) -> SettingsLayer {
        SettingsLayer {
            solver: self.solver.clone(),
            step1: self.step1.clone(),
            step2: self.step2.clone(),
            verification: self.verification.clone(),
            step3: self.step3.clone(),
            posterior: self.posterior.clone(),
            workflow: self.workflow.clone(),
            executor: self.executor.clone(),
        }
    }
}

fn patients_folder() -> String {
    "patients".to_owned()
}

/// Tables of settings as given in one file; all are optional. They are checked after the layers are
/// merged so that an error names the file and the key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(with = "Settings")]
pub struct SettingsLayer {
    /// Settings of the organ and its simulation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<serde_json::Value>,
    /// Settings of step 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step1: Option<serde_json::Value>,
    /// Settings of step 2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step2: Option<serde_json::Value>,
    /// Settings of the verification beat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verification: Option<serde_json::Value>,
    /// Settings of step 3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step3: Option<serde_json::Value>,
    /// Settings of the posterior's sampling.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<serde_json::Value>,
    /// Settings of the workflow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub workflow: Option<serde_json::Value>,
    /// Settings of the executor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub executor: Option<serde_json::Value>,
}

/// Values for patient files that lack them. They are marked as the cohort's and not the patient's.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PatientDefaults {
    /// Pressure of the left atrium, which fills the ventricle.
    #[serde(
        rename = "left_atrial_pressure_mmHg",
        skip_serializing_if = "Option::is_none"
    )]
    pub left_atrial_pressure_mmhg: Option<f64>,
    /// Exponent b of the one-fibre passive law.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passive_exponent: Option<f64>,
}
