//! The file of `workflow.law`: what other organs taught about the organ's law.

use std::path::Path;

use cardiotwin_calibrate::cohort_law::check_prior;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::organ_law::LawFile;
use cardiotwin_schemas::settings::Settings;
use cardiotwin_schemas::task::{InputFile, LAW_FILE};
use cardiotwin_signals::Problem;

use super::hashed::hash_and_read;
use super::report::Report;

/// The file with its hash; `None` inside if there is none. A file that cannot be used becomes a
/// problem in `report`, and the result is `None`.
pub(super) fn file(
    settings: &Settings,
    cohort_folder: &Path,
    patient: &str,
    report: &mut Report,
) -> Option<Option<InputFile>> {
    let Some(name) = &settings.workflow.law else {
        return Some(None);
    };
    let path = cohort_folder.join(name);
    let (file, bytes) = hash_and_read(LAW_FILE, &path, patient, report)?;
    let problem = match formats::LAW.read::<LawFile>(&path.display(), &bytes) {
        Ok(law) => check_prior(&law.prior).err().map(|error| error.to_string()),
        Err(error) => Some(error.in_full()),
    };
    let Some(found) = problem else {
        return Some(Some(file));
    };
    let problem = Problem::error(
        &path,
        found,
        "a law that `cardiotwin export --law` wrote",
        "write it again, or remove workflow.law",
    )
    .at_key("workflow.law");
    // One problem of the cohort, although every patient meets it.
    report.add(None, problem);
    None
}
