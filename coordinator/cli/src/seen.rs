//! Input files that a run has read, recognised by size, times and inode.

use std::path::Path;

use cardiotwin_engine::seen::{SeenInputs, SeenPatient};
use cardiotwin_engine::{self as engine, Reader, Recognised, StoreError};
use cardiotwin_input::{Cohort, Known};
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::PatientId;

use super::error::CliError;

/// What a run has read before.
pub enum Seen {
    /// Every file is read, and nothing is noted.
    Nothing,
    /// Marks of the store, and the store's revision.
    Run(SeenInputs, String),
}

impl Seen {
    /// What the run in a folder has read.
    ///
    /// # Errors
    /// Errors of the store, other than a missing one.
    pub async fn of(run_dir: &Path) -> Result<Self, CliError> {
        match Reader::open(run_dir).await {
            Ok(reader) => {
                let revision = reader.revision().await?;
                Ok(Self::Run(reader.seen_inputs().await?, revision))
            }
            Err(StoreError::Missing { .. }) => Ok(Self::Run(SeenInputs::default(), String::new())),
            Err(error) => Err(error.into()),
        }
    }

    /// Marks with which the input is compared.
    pub fn known(&self) -> Option<Known> {
        let Self::Run(SeenInputs(seen), _) = self else {
            return None;
        };
        let marks = seen.iter().map(|(id, of)| (id.clone(), of.mark.clone()));
        Some(Known {
            program: engine::of_this_program().to_owned(),
            marks: marks.collect(),
        })
    }

    /// The patients that were recognised, and the marks for the next run.
    pub fn recognised(self, cohort: &Cohort) -> Recognised {
        let Self::Run(SeenInputs(mut seen), revision) = self else {
            return Recognised::default();
        };
        let ids = cohort.unchanged.iter().map(|(_, id)| id);
        let kept = ids.filter_map(|id| seen.remove_entry(id));
        let read = cohort.patients.iter().filter_map(|patient| {
            let given = serde_json::to_string(patient.resolved.as_ref()?).expect("a plan is JSON");
            let of = SeenPatient {
                mark: patient.mark.clone()?,
                given: sha256_hex(given.as_bytes()),
            };
            Some((patient.id.clone(), of))
        });
        let marks = SeenInputs(kept.chain(read).collect());
        let unchanged = cohort.unchanged.iter();
        Recognised {
            unchanged: unchanged
                .map(|(position, id)| (*position, PatientId(id.clone())))
                .collect(),
            revision,
            marks: Some(marks),
        }
    }
}
