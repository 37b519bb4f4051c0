//! What the programs `cardiotwin-worker` and `cardiotwin-worker-mpi` share: exit codes, log, reading of arguments' files.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;
use cardiotwin_protocol::exit_code;
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use tracing::Level;

use crate::attempt::AttemptError;
use crate::checkpoint::Checkpoints;

/// The exit code that tells why nothing was published.
#[must_use]
pub fn code_of(error: &anyhow::Error) -> ExitCode {
    ExitCode::from(match error.downcast_ref::<AttemptError>() {
        Some(AttemptError::Claimed { .. }) => exit_code::CLAIMED,
        Some(AttemptError::Revoked { .. }) => exit_code::REVOKED,
        _ => exit_code::FAILED,
    })
}

/// Log lines to stderr, which the coordinator keeps beside the outcome.
pub fn log(level: Level) {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_target(false)
        .with_max_level(level)
        .init();
}

/// A file's text.
///
/// # Errors
/// Names the file that cannot be read.
pub fn read(file: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

/// The specification of a task, alone or as an attempt's `spec.json` has it.
///
/// # Errors
/// Names the file that cannot be read, or holds something else.
pub fn read_task(file: &Path) -> anyhow::Result<TaskSpec> {
    let read = |text: String| {
        let value: serde_json::Value = serde_json::from_str(&text)?;
        if value.get("attempt").is_some() {
            return serde_json::from_value::<AttemptSpec>(value).map(|attempt| attempt.task);
        }
        serde_json::from_value(value)
    };
    read(self::read(file)?)
        .with_context(|| format!("{}: not the specification of a task", file.display()))
}

/// Makes a folder for results.
///
/// # Errors
/// Names the folder that cannot be made.
pub fn make_folder(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))
}

/// Checkpoints in `out` that go on from those of the folder `other`.
///
/// # Errors
/// When `other` is no folder.
pub fn restarting(
    out: &Path,
    other: &Path,
    generation: Option<u64>,
) -> anyhow::Result<Checkpoints> {
    anyhow::ensure!(
        other.is_dir(),
        "--restart {}: no such directory",
        other.display()
    );
    Ok(Checkpoints::restarting(out, other, generation))
}
