//! A finished run as an RO-Crate: what was computed of what, by which program, in a folder that other tools read.
//!
//! RO-Crate 1.1 with the profile Process Run Crate 0.5: each published task is a `CreateAction` of the worker that computed it.
//! Inputs are named by their hashes; whether their contents are there is for who makes the crate to say.

mod graph;
mod record;

use std::path::PathBuf;

use cardiotwin_schemas::record::RunRecord;

pub use record::without_paths;

use crate::results::WriteError;
use crate::results::folder::WholeFolder;

/// The file that makes a folder a crate.
pub const METADATA: &str = "ro-crate-metadata.json";

/// What a crate says beside what the run knows.
#[derive(Debug, Clone, Default)]
pub struct CrateOptions {
    /// Under which terms it may be used: a URL.
    pub license: Option<String>,
    /// Who made it.
    pub author: Option<String>,
    /// Take measured inputs along.
    pub with_inputs: bool,
}

/// A file of a crate that was written before its metadata.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CrateFile {
    /// Relative to the crate, with `/`.
    pub path: String,
    /// A sentence.
    pub name: String,
}

/// Adds each patient's record, parameters and, where asked for, inputs, and the metadata of all files.
///
/// - `files`: what lies in the folder already
///
/// Returns sentences about inputs that are not what the run was planned with any more; they are named by their hashes alone.
///
/// # Errors
/// [`WriteError`].
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
            format!("All that the run knows of {id}: inputs' hashes, settings, every simulation"),
        )?;
        add(
            "parameters.json",
            record::parameters(patient),
            format!("The personalised parameters of {id}"),
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
