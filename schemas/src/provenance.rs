//! Provenance of a result.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Provenance of an outcome. The commit is provenance, not identity.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the worker.
    pub version: String,
    /// Commit of the worker, if it was built from a checkout.
    pub commit: Option<String>,
    /// SHA-256 of each input file, by role.
    pub inputs: BTreeMap<String, String>,
    /// Seed, if random numbers were used.
    pub seed: Option<u64>,
    /// Number of threads.
    pub threads: u32,
    /// Number of MPI ranks.
    pub ranks: u32,
    /// Name of the host.
    pub host: String,
    /// Arithmetic of the processor, for example `x86-64 scalar`.
    pub arithmetic: String,
    /// Time of the start, UTC, RFC 3339.
    pub started: String,
    /// Duration by the clock.
    pub wall_s: f64,
    /// Processor time of the process.
    pub cpu_s: f64,
    /// Largest resident set of the process.
    #[serde(rename = "peak_memory_MB")]
    pub peak_memory_mb: f64,
}
