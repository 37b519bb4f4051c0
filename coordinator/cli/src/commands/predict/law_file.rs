//! What a run knows about an organ's law, as a file for the worker.

use std::path::PathBuf;

use tempfile::TempDir;

use crate::error::CliError;
use crate::ventricle::{AskedFor, Ventricle};

/// What is known about the organ's law in a temporary file, for the worker.
pub struct LawKnowledgeFile {
    path: PathBuf,
    _folder: TempDir,
}

impl LawKnowledgeFile {
    /// The law of a finite-element twin; `None` for other twins.
    ///
    /// # Errors
    /// [`CliError::File`] or [`CliError::Io`] if the file cannot be written.
    pub fn of(ventricle: &Ventricle) -> Result<Option<Self>, CliError> {
        let Some(known) = ventricle.law() else {
            return Ok(None);
        };
        let folder = tempfile::tempdir()
            .map_err(CliError::file("create a folder in", std::env::temp_dir()))?;
        let path = folder.path().join("law.json");
        let text = serde_json::to_string(&known).map_err(|error| CliError::Io {
            what: "cannot write JSON",
            source: error.into(),
        })?;
        std::fs::write(&path, text).map_err(CliError::file("write", &path))?;
        Ok(Some(Self {
            path,
            _folder: folder,
        }))
    }

    /// The ventricle to simulate: the law, or the one-fibre ventricle of a twin without one.
    pub fn asked(law: Option<&Self>) -> AskedFor<'_> {
        law.map_or(AskedFor::OneFibre, |law| AskedFor::Law(&law.path))
    }
}
