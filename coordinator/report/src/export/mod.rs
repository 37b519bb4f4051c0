//! Tables and traces of a run for other programs: the paper's Tables 1, 2, A6 and A7 for this
//! cohort as CSV and JSON, and all traces as one tidy CSV. The module accesses neither store nor
//! network. Columns are named as in `docs/formats.md`.

mod paper;
mod parquet;
mod patient_tables;
pub mod ro_crate;
mod table;
mod traces;

pub use patient_tables::PatientTables;

use std::path::{Path, PathBuf};

use cardiotwin_schemas::record::RunRecord;

use crate::results::{WriteError, atomic};

/// Files of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Paths of `table_1`, `table_2`, `table_A6`, `table_A7`, each as `.csv` and `.json`, followed
    /// by `traces.csv`; with Parquet each as `.parquet`, too.
    pub files: Vec<PathBuf>,
    /// One sentence for each file of the run that could not be read and whose traces are therefore
    /// missing.
    pub problems: Vec<String>,
}

/// Writes tables and traces of a run into a folder, which is made if it does not exist; with
/// `parquet` as Parquet files, too. Values that a patient lacks are left empty.
///
/// # Errors
/// [`WriteError`] if a file cannot be written. Each file is written atomically.
pub fn export(run: &RunRecord, folder: &Path, parquet: bool) -> Result<Exported, WriteError> {
    std::fs::create_dir_all(folder).map_err(WriteError::folder(folder))?;
    let mut files = Vec::new();
    for table in [
        paper::table_1(run),
        paper::table_2(run),
        paper::table_a6(run),
        paper::table_a7(run),
    ] {
        for (extension, text) in [("csv", table.csv()), ("json", table.json())] {
            let file = folder.join(format!("{}.{extension}", table.name));
            atomic::write(&file, |out| out.write_all(text.as_bytes()))
                .map_err(WriteError::file(&file))?;
            files.push(file);
        }
        if parquet {
            let file = folder.join(format!("{}.parquet", table.name));
            atomic::write(&file, |out| table.parquet(out)).map_err(WriteError::file(&file))?;
            files.push(file);
        }
    }
    let file = folder.join("traces.csv");
    let mut problems = Vec::new();
    atomic::write(&file, |out| traces::write(run, out, &mut problems))
        .map_err(WriteError::file(&file))?;
    files.push(file);
    if parquet {
        let file = folder.join("traces.parquet");
        atomic::write(&file, |out| traces::write_parquet(run, out))
            .map_err(WriteError::file(&file))?;
        files.push(file);
    }
    Ok(Exported { files, problems })
}
