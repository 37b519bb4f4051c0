//! How a result was made.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Embedded in every outcome. The commit is provenance, not identity.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the worker.
    pub version: String,
    /// Commit of the worker, where it was built from a checkout.
    pub commit: Option<String>,
    /// SHA-256 of each input file, by role.
    pub inputs: BTreeMap<String, String>,
    /// Seed, where random numbers were used.
    pub seed: Option<u64>,
    /// Threads used.
    pub threads: u32,
    /// MPI ranks used.
    pub ranks: u32,
    /// Host name.
    pub host: String,
    /// Arithmetic path, for example `x86-64 scalar`.
    pub arithmetic: String,
    /// UTC, RFC 3339.
    pub started: String,
    /// Wall time.
    pub wall_s: f64,
    /// Processor time of the process.
    pub cpu_s: f64,
    /// Largest resident set of the process.
    #[serde(rename = "peak_memory_MB")]
    pub peak_memory_mb: f64,
}
