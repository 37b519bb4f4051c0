//! A finished run as an RO-Crate, a folder for other tools that says which program computed which
//! results from which inputs.
//!
//! It follows RO-Crate 1.1 with the profile Process Run Crate 0.5: each published task is a
//! `CreateAction` of the worker that computed it. Inputs are identified by their hashes; the
//! options decide whether their contents are included.

mod graph;
mod record;

use std::path::PathBuf;

use cardiotwin_schemas::record::RunRecord;

pub use graph::{CrateFile, CrateOptions, METADATA};
pub use record::without_paths;

use crate::results::WriteError;
use crate::results::folder::WholeFolder;

/// Adds each patient's record, parameters and, with `with_inputs`, inputs, and writes the metadata
/// of all files.
///
/// - `files`: files that are in the folder already
///
/// Returns sentences about inputs that changed since the run was planned or cannot be read. They
/// are identified by their hashes only.
///
/// # Errors
/// [`WriteError`] if a file cannot be written.
pub fn complete(
    run: &RunRecord,
    folder: &WholeFolder,
    mut files: Vec<CrateFile>,
    options: &CrateOptions,
) -> Result<Vec<String>, WriteError> {
    let mut problems = Vec::new();
    let mut inputs = Vec::new();
    for patient in &run.patients {
        let id = &patient.plan.id;
        let mut add = |name: &str, text: String, sentence: String| -> Result<(), WriteError> {
            let path = format!("patients/{id}/{name}");
            folder.write(&path, text.as_bytes())?;
            files.push(CrateFile {
                path,
                name: sentence,
            });
            Ok(())
        };
        add(
            "record.json",
            record::json(patient),
            format!("Full record of {id}: hashes of the inputs, settings, and every simulation"),
        )?;
        add(
            "parameters.json",
            record::parameters(patient),
            format!("Personalised parameters of {id}"),
        )?;
        for input in record::inputs(patient) {
            let mut kept = None;
            if options.with_inputs {
                match record::content(input) {
                    Ok(bytes) => {
                        let name = input
                            .path
                            .file_name()
                            .map_or_else(PathBuf::new, PathBuf::from);
                        let path = format!("patients/{id}/inputs/{}", name.display());
                        folder.write(&path, &bytes)?;
                        kept = Some(path);
                    }
                    Err(problem) => problems.push(format!("{id}: {problem}")),
                }
            }
            inputs.push(graph::Input {
                patient: id.clone(),
                name: input.name.clone(),
                sha256: input.sha256.clone(),
                kept,
            });
        }
    }
    let text = graph::metadata(run, &files, &inputs, options);
    folder.write(METADATA, text.as_bytes())?;
    Ok(problems)
}
