//! Files of a job's directory, through which the coordinator and the driver inside a scheduler's
//! allocation communicate.
//!
//! A job has a list of patients for each element of its array, or one list if it is not an array.
//! The driver runs each patient's chain like the coordinator, and omits tasks for which its time
//! does not suffice.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::Failure;
use crate::ids::{PatientId, TaskKey};
use crate::organ::Step1Parameters;
use crate::organ_law::LawLesson;
use crate::plan::ResolvedPatient;
use crate::progress::Claim;
use crate::settings::InstructionSet;

/// `order-<element>.json`: work of one element of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobOrder {
    /// Version of this file's format.
    pub schema_version: u32,
    /// Unique name of the job.
    pub job: String,
    /// Run directory, as an absolute path. Attempts are created in it.
    pub run_dir: PathBuf,
    /// The worker's executable.
    pub worker: PathBuf,
    /// Number of simultaneous simulations on each node.
    pub lanes: u32,
    /// Number of threads per simulation.
    pub threads: u32,
    /// MPI launcher with its arguments. 3D simulations then run on `threads` ranks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub launcher: Vec<String>,
    /// Steps of the job, if one driver makes each simulation a step on nodes of its own; absent if
    /// a driver on each node runs its simulations there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<Steps>,
    /// Instruction set of the cell engine.
    #[serde(default, skip_serializing_if = "InstructionSet::is_auto")]
    pub instruction_set: InstructionSet,
    /// Simulated time between frames of VTU series; 0 for none.
    #[serde(default, skip_serializing_if = "crate::absent::is_zero")]
    pub vtu_every_ms: f64,
    /// Expected duration of a task by its kind, s. The driver starts no task that would exceed its
    /// remaining time.
    pub expected_s: BTreeMap<String, f64>,
    /// Patients of the element, in the order of their processing.
    pub patients: Vec<JobPatient>,
}

/// Steps of a job whose simulations run on MPI ranks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Steps {
    /// Number of nodes of each simulation.
    pub nodes: u32,
    /// Memory of a simulation that shares its node with others, MiB.
    #[serde(rename = "memory_MiB")]
    pub memory_mib: u64,
}

/// A patient of a job, with all data that determine its next task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobPatient {
    /// Resolved plan of the patient.
    pub plan: ResolvedPatient,
    /// Parameters of step 1 that were simulated under earlier settings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub carried: Vec<Step1Parameters>,
    /// What pilots teach this patient (`workflow.pilots`); absent for a pilot and without pilots. A
    /// patient who has to wait for pilots is in no job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lessons: Option<Vec<LawLesson>>,
    /// Tasks with a result known to the coordinator.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<KnownTask>,
}

/// A task with earlier attempts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KnownTask {
    /// Key of the task.
    pub task: TaskKey,
    /// Generation of the last attempt.
    pub generation: u32,
    /// State of the task.
    pub standing: KnownTaskState,
}

/// State of a known task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum KnownTaskState {
    /// The task is to be tried again.
    Open,
    /// The task succeeded; the outcome of the last generation is valid.
    Published,
    /// The task failed permanently.
    Failed(Failure),
}

/// `started-<element>-<node>.json`: a driver's claim. It is created exclusively, so that a job
/// which Slurm starts twice works only once.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DriverClaim {
    /// The scheduler's number of the job; `None` if the environment does not contain it.
    pub job: Option<String>,
    /// Claim of the driver process.
    pub claim: Claim,
}

/// `ended-<element>-<node>.json`: a driver's final report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriverEnd {
    /// Time of the end, UTC, RFC 3339.
    pub at: String,
    /// Reason for the end.
    pub because: DriverEnding,
    /// Patients whose chains were not completed, with the reason.
    pub left: BTreeMap<PatientId, String>,
    /// Patients among them whose worker died of a program defect: it panicked, aborted or rejected
    /// its command line.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub defects: BTreeSet<PatientId>,
    /// Run time of the driver, s.
    pub wall_s: f64,
}

/// Reason why a driver ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriverEnding {
    /// No task was left that the driver could run.
    Finished,
    /// The time of the allocation ran out.
    OutOfTime,
    /// A signal stopped the driver.
    Stopped,
    /// The coordinator revoked the job.
    Fenced,
}

/// `allocation.json` in an attempt's directory: the job that created the attempt.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AttemptAllocation {
    /// Unique name of the job.
    pub job: String,
    /// Element of the job's array; 0 if the job is not an array.
    pub element: u32,
    /// The scheduler's number of the job; `None` if the environment did not contain it.
    pub id: Option<String>,
}
