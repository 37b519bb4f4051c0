//! `progress.jsonl` of an attempt: one line per report, appended.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Progress of an attempt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Progress {
    /// Time of the report, UTC, RFC 3339.
    pub at: String,
    /// Phase of the work, for example `differential evolution`.
    pub phase: String,
    /// Completed units of work.
    pub done: f64,
    /// Total units of work, if known.
    pub total: Option<f64>,
    /// Text for people, for example `generation 41, cost 0.0432`.
    pub note: String,
}

/// `started.json`: the worker's claim on the attempt, created exclusively. It identifies the
/// process that holds the claim and allows to check if the process still exists.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Claim {
    /// Name of the host.
    pub host: String,
    /// Boot id of the host. A process id is meaningless after a reboot.
    pub boot_id: String,
    /// Process id.
    pub pid: u32,
    /// Start time of the process in clock ticks since boot (field 22 of /proc/PID/stat), since
    /// process ids are reused.
    pub pid_start_ticks: u64,
    /// Time of the claim, UTC, RFC 3339.
    pub at: String,
    /// Names of the nodes on which MPI ranks work on the attempt, rank 0's first. Empty for a
    /// process that works alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<String>,
}
