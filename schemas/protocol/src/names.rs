//! Names of the files in an attempt's directory.

/// The task, as the coordinator hands it over.
pub const SPEC: &str = "spec.json";
/// The worker's claim.
pub const CLAIM: &str = "started.json";
/// The worker's outcome or the coordinator's revocation.
pub const OUTCOME: &str = "outcome.json";
/// The revocation as earlier versions wrote it, in a file of its own; it is still read.
pub const FORMER_FENCE: &str = "fence";
/// The worker's log.
pub const LOG: &str = "stderr.log";
/// The worker's reports of its progress.
pub const PROGRESS: &str = "progress.jsonl";
/// The job that made the directory.
pub const ALLOCATION: &str = "allocation.json";
/// Folder of checkpoints.
pub const CHECKPOINT: &str = "checkpoint";
