//! A file that a task reads, with its hash.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A file that a task reads. The path is its present location; only name and content enter the
/// task's key.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct InputFile {
    /// Role, for example `pressure`.
    pub name: String,
    /// Absolute path of the file.
    pub path: PathBuf,
    /// SHA-256 of the content.
    pub sha256: String,
}
