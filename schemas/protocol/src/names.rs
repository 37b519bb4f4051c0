//! Names of the files in an attempt's directory.

/// The task, written by the coordinator.
pub const SPEC: &str = "spec.json";
/// Claim of the worker that takes the attempt.
pub const CLAIM: &str = "started.json";
/// The worker's outcome or the coordinator's revocation.
pub const OUTCOME: &str = "outcome.json";
/// The revocation in a file of its own, as earlier versions wrote it; it is still read.
pub const FORMER_FENCE: &str = "fence";
/// Standard error of the worker.
pub const LOG: &str = "stderr.log";
/// The worker's progress reports.
pub const PROGRESS: &str = "progress.jsonl";
/// The job that created the directory.
pub const ALLOCATION: &str = "allocation.json";
/// Directory of the files from which a later attempt continues.
pub const CHECKPOINT: &str = "checkpoint";
