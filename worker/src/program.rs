//! Code shared by the programs `cardiotwin-worker` and `cardiotwin-worker-mpi`: exit codes,
//! logging, files named on the command line.

use std::io::IsTerminal as _;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;
use cardiotwin_protocol::exit_code;
use cardiotwin_schemas::formats::SPEC;
use cardiotwin_schemas::organ_law::LawKnowledge;
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use tracing::Level;

use crate::attempt::AttemptError;
use crate::checkpoint::Checkpoints;

/// Exit code for an error that prevented the outcome.
#[must_use]
pub fn code_of(error: &anyhow::Error) -> ExitCode {
    ExitCode::from(match error.downcast_ref::<AttemptError>() {
        Some(AttemptError::Claimed { .. }) => exit_code::CLAIMED,
        Some(AttemptError::Revoked { .. }) => exit_code::REVOKED,
        _ => exit_code::FAILED,
    })
}

/// Sends log lines to stderr, which the coordinator stores next to the outcome.
pub fn log(level: Level) {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        // A file, such as the log of an attempt, gets no colours.
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .with_max_level(level)
        .init();
}

/// Reads a text file.
///
/// # Errors
/// When the file cannot be read; the error names it.
pub fn read(file: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

/// Reads the specification of a task, which is either the whole file or a part of an attempt's
/// `spec.json`.
///
/// # Errors
/// When the file cannot be read or does not hold a specification; the error names it.
pub fn read_task(file: &Path) -> anyhow::Result<TaskSpec> {
    let (place, text) = (file.display(), self::read(file)?);
    let is_attempt = serde_json::from_str::<serde_json::Value>(&text)
        .is_ok_and(|value| value.get("attempt").is_some());
    let read = match is_attempt {
        true => SPEC
            .read_order::<AttemptSpec>(&place, text.as_bytes())
            .map(|attempt| attempt.task),
        false => SPEC.read_order(&place, text.as_bytes()),
    };
    read.with_context(|| format!("{place}: not the specification of a task"))
}

/// Reads what is known about the law of an organ.
///
/// # Errors
/// When the file cannot be read or has another content; the error names it.
pub fn read_law(file: &Path) -> anyhow::Result<LawKnowledge> {
    let (place, text) = (file.display(), self::read(file)?);
    serde_json::from_str(&text).with_context(|| {
        format!(
            "{place}: expected an object whose list `beats` has the `law` of outcomes of organ beats"
        )
    })
}

/// Creates a folder for results.
///
/// # Errors
/// When the folder cannot be created; the error names it.
pub fn make_folder(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))
}

/// Checkpoints in `out` that continue those of the folder `other`.
///
/// # Errors
/// When `other` is not a folder.
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
