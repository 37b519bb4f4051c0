//! Simulation of one beat by the worker.

use std::path::Path;

use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};

use crate::error::CliError;
use crate::ventricle::{AskedFor, ask_worker, describe, unexpected};

/// Simulates a beat. Returns its result and the text of its `traces.csv`.
pub fn simulate(
    beat: &OrganBeatSpec,
    asked: AskedFor<'_>,
    worker: &Path,
) -> Result<(OrganBeatResult, String), CliError> {
    let scratch =
        tempfile::tempdir().map_err(CliError::file("create a folder in", std::env::temp_dir()))?;
    let task = TaskSpec::OrganBeat(Box::new(beat.clone()));
    let outcome = ask_worker(worker, &task, scratch.path(), 0.0, asked)?;
    let traces = outcome
        .artefacts
        .iter()
        .find(|a| a.name == "traces")
        .map(|a| scratch.path().join(&a.file));
    match outcome.ending {
        Ending::Succeeded { result } => match (*result, traces) {
            (TaskResult::OrganBeat(result), Some(path)) => {
                let text = std::fs::read_to_string(&path).map_err(CliError::file("read", &path))?;
                Ok((result, text))
            }
            _ => Err(unexpected(worker)),
        },
        other => Err(CliError::Simulation {
            message: describe(&other),
        }),
    }
}
