//! A run keeps the worker with which it began, because results of two versions in one cohort are
//! not comparable.

use std::path::Path;

use cardiotwin_schemas::hash::sha256_of_file;
use cardiotwin_store::Writer;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use super::EngineError;
use super::books::Books;
use super::programs::first_line;

/// Keys of version and hash among the store's single values.
const VERSION: &str = "worker_version";
const SHA256: &str = "worker_sha256";

/// Records the worker if the run has none yet, and refuses another one while work is left. If no
/// work is left, the refusal is returned: it applies if a finished patient turns out to need other
/// tasks.
///
/// - `adopts`: whether to continue with this worker, whatever it is
///
/// # Errors
/// [`EngineError::OtherWorker`] for another worker; further errors if the store or the worker's
/// file cannot be read.
pub async fn keep(
    writer: &mut Writer,
    books: &Books,
    worker: &Path,
    adopts: bool,
) -> Result<Option<EngineError>, EngineError> {
    let sha256 = match sha256_of_file(worker) {
        Ok(sha256) => sha256,
        Err(_) if adopts => return Ok(None),
        Err(source) => {
            return Err(EngineError::File {
                what: "read",
                path: worker.to_owned(),
                source,
            });
        }
    };
    let meta = writer.meta().await?;
    let before = meta.get(SHA256);
    if before == Some(&sha256) {
        return Ok(None);
    }
    let version = first_line(worker, &["--version"]).filter(|said| !said.is_empty());
    let version = version.unwrap_or_else(|| "unknown".to_owned());
    let has_results = books
        .tasks()
        .values()
        .any(|task| matches!(task.state, Task::Published { .. }));
    let is_over = books
        .patients()
        .iter()
        .filter(|patient| patient.selected)
        .all(|patient| patient.row.state.is_final());
    if let Some(before) = before
        && has_results
        && !adopts
    {
        let name = |version: &str, sha256: &str| {
            format!("{version} ({})", &sha256[..12.min(sha256.len())])
        };
        let refusal = EngineError::OtherWorker {
            began: name(
                meta.get(VERSION)
                    .map_or("an unknown version", String::as_str),
                before,
            ),
            found: name(&version, &sha256),
        };
        // Nothing will be computed, so the recorded worker stays.
        return if is_over {
            Ok(Some(refusal))
        } else {
            Err(refusal)
        };
    }
    if before.is_some() && has_results {
        tracing::warn!(%version, sha256, "the run continues with a worker other than the one that it began with");
    }
    writer
        .set_meta(&[(VERSION, version.as_str()), (SHA256, sha256.as_str())])
        .await?;
    Ok(None)
}

/// Raises the refusal of the present worker if a selected patient is not finished.
///
/// # Errors
/// [`EngineError::OtherWorker`].
pub fn need(refused: Option<EngineError>, books: &Books) -> Result<(), EngineError> {
    let is_all_final = books.selected_states().all(Patient::is_final);
    refused.filter(|_| !is_all_final).map_or(Ok(()), Err)
}
