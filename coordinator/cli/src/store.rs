//! Opening of a run for reading.

use std::collections::BTreeMap;
use std::path::Path;

use cardiotwin_engine::{Reader, StoreError};
use cardiotwin_schemas::ids::PatientId;
use serde_json::Value;

use super::error::CliError;
use super::place::Folders;

/// Opens the run in these folders.
///
/// # Errors
/// Errors of the store, each with a remedy.
pub async fn open(folders: &Folders) -> Result<Reader, CliError> {
    Ok(Reader::open(&folders.run).await?)
}

/// Settings that `rerun` stored for a patient, under the patient's id; empty if the run does not
/// exist or lacks the patient.
///
/// # Errors
/// Errors of the store, other than a missing store or an unknown patient.
pub async fn stored_overrides(
    run_dir: &Path,
    patient: &str,
) -> Result<BTreeMap<String, Value>, CliError> {
    let overrides = match Reader::open(run_dir).await {
        Ok(reader) => reader.overrides(&PatientId::from(patient)).await,
        Err(error) => Err(error),
    };
    match overrides {
        Ok(layer) => {
            let layer = serde_json::to_value(layer).map_err(|error| CliError::Io {
                what: "cannot read stored settings",
                source: error.into(),
            })?;
            Ok([(patient.to_owned(), layer)].into())
        }
        Err(StoreError::Missing { .. } | StoreError::NoPatient { .. }) => Ok(BTreeMap::new()),
        Err(error) => Err(error.into()),
    }
}
