//! `progress.jsonl` of an attempt: one line a report, appended.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How far an attempt is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Progress {
    /// UTC, RFC 3339.
    pub at: String,
    /// What is being done, for example `differential evolution`.
    pub phase: String,
    /// Units of work done.
    pub done: f64,
    /// Units of work in all, where known.
    pub total: Option<f64>,
    /// For a person: `generation 41, cost 0.0432`.
    pub note: String,
}

/// `started.json`: the worker's claim on the attempt, created exclusively; who holds it and how to see whether he lives.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Claim {
    /// Host name.
    pub host: String,
    /// Boot id of the host: a pid means nothing after a reboot.
    pub boot_id: String,
    /// Process id.
    pub pid: u32,
    /// Start time of the process in clock ticks since boot (field 22 of /proc/PID/stat): a pid may be used again.
    pub pid_start_ticks: u64,
    /// UTC, RFC 3339.
    pub at: String,
}
