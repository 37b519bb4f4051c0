//! What the coordinator and the driver inside a scheduler's allocation tell each other: files of a job's folder.
//!
//! A job has a list of patients for each element of its array, one list where it is no array. The driver walks each
//! patient's chain as the coordinator would, and leaves off what its time does not hold.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::failure::Failure;
use crate::ids::{PatientId, TaskKey};
use crate::organ::Step1Parameters;
use crate::plan::ResolvedPatient;
use crate::progress::Claim;
use crate::settings::InstructionSet;

/// `order-<element>.json`: what an element of a job is to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobOrder {
    /// Format version.
    pub schema_version: u32,
    /// Unique name of the job.
    pub job: String,
    /// Run directory, absolute: attempts are made in it.
    pub run_dir: PathBuf,
    /// The worker's executable.
    pub worker: PathBuf,
    /// Simulations at once on each node.
    pub lanes: u32,
    /// Threads of each.
    pub threads: u32,
    /// Launcher of MPI with its arguments: 3D simulations then run on as many ranks, each a step of the job.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub launcher: Vec<String>,
    /// Instructions of the cell engine.
    #[serde(default, skip_serializing_if = "InstructionSet::is_auto")]
    pub instruction_set: InstructionSet,
    /// Simulated time between frames of VTU series; 0 for none.
    #[serde(default, skip_serializing_if = "crate::task::is_zero")]
    pub vtu_every_ms: f64,
    /// How long a task is expected to take, s, by its kind: none is begun that the time left would not hold.
    pub expected_s: BTreeMap<String, f64>,
    /// In the order in which they are taken.
    pub patients: Vec<JobPatient>,
}

/// A patient of a job, with all that its next task follows from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobPatient {
    /// The plan.
    pub plan: ResolvedPatient,
    /// Step 1's parameters that were simulated under earlier settings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub carried: Vec<Step1Parameters>,
    /// Tasks that the coordinator knows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known: Vec<KnownTask>,
}

/// A task that was tried before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KnownTask {
    /// Which.
    pub task: TaskKey,
    /// The last generation that was tried.
    pub generation: u32,
    /// How it stands.
    pub standing: Standing,
}

/// How a known task stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// To be tried again.
    Open,
    /// The outcome of that generation stands.
    Published,
    /// It failed for good.
    Failed(Failure),
}

/// `started-<element>-<node>.json`: a driver's claim, created exclusively: a job that Slurm starts twice works once.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DriverClaim {
    /// The scheduler's number of the job, where the environment tells it.
    pub job: Option<String>,
    /// The process.
    pub claim: Claim,
}

/// `ended-<element>-<node>.json`: a driver's last word.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriverEnd {
    /// UTC, RFC 3339.
    pub at: String,
    /// Why it ended.
    pub because: DriverEnding,
    /// Patients whose chains it did not bring to an end, with the reason.
    pub left: BTreeMap<PatientId, String>,
    /// Those of them whose worker died of a defect of ours: panicked, aborted, or did not understand its call.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub defects: BTreeSet<PatientId>,
    /// How long it ran.
    pub wall_s: f64,
}

/// Why a driver ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriverEnding {
    /// Nothing was left that it could do.
    Finished,
    /// Its time ran out.
    OutOfTime,
    /// It was told to end.
    Stopped,
    /// The coordinator revoked the job.
    Fenced,
}

/// `allocation.json` in an attempt's directory: which job made it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AttemptAllocation {
    /// Unique name of the job.
    pub job: String,
    /// Element of its array; 0 where it is none.
    pub element: u32,
    /// The scheduler's number of the job, where the environment told it.
    pub id: Option<String>,
}
