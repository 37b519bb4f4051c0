//! Results of a search for missing effects, for people and for the next run: files of cases and the
//! patients' overlays.
//!
//! Searches are tasks of the engine like any other. This module handles their outcomes.

pub mod overlay;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::discover::{DiscoverCase, DiscoverCases, Discovered};
use cardiotwin_schemas::formats::DISCOVER_CASE;

use cardiotwin_report::results::atomic;
use cardiotwin_report::results::discovery::paragraph;

/// Folder of a run of searches, inside the folder that is searched.
pub const FOLDER: &str = "discover";
/// File of a run's cases in its folder.
pub const CASES: &str = "discover.json";

/// The case of one patient, as it is written to files.
#[must_use]
pub fn case(patient: &str, task: &str, found: &Discovered) -> DiscoverCase {
    DiscoverCase {
        schema_version: DISCOVER_CASE.version,
        case: patient.to_owned(),
        summary: paragraph::summary(found),
        confirmed: found.findings.confirmed(),
        task: task.to_owned(),
        run: None,
        finite_element: None,
        found: found.clone(),
    }
}

/// Writes the text of one case or of all cases.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, text: &str) -> std::io::Result<()> {
    atomic::write(path, |out| out.write_all(text.as_bytes()))
}

/// One case as JSON text.
///
/// # Panics
/// Never, because a case is valid JSON.
#[must_use]
pub fn case_text(case: &DiscoverCase) -> String {
    serde_json::to_string_pretty(case).expect("a case is JSON") + "\n"
}

/// All cases as JSON text.
///
/// # Panics
/// Never, because cases are valid JSON.
#[must_use]
pub fn cases_text(cases: &DiscoverCases) -> String {
    serde_json::to_string_pretty(cases).expect("cases are JSON") + "\n"
}

/// Cases that an earlier search left in the folder of a run; none where there is no such file or it is of a later version.
#[must_use]
pub fn read_cases(run_dir: &Path) -> Option<DiscoverCases> {
    let path = cases_file(run_dir);
    let text = std::fs::read(&path).ok()?;
    // The version stands in each case.
    let cases: BTreeMap<String, serde_json::Value> = serde_json::from_slice(&text).ok()?;
    let case = |(name, case): (String, serde_json::Value)| {
        let case = case.to_string().into_bytes();
        Some((name, DISCOVER_CASE.read(&path.display(), &case).ok()?))
    };
    cases.into_iter().map(case).collect()
}

/// Takes the gaps on the finite-element ventricle from an earlier answer of the same searches.
pub fn keep_finite_element(earlier: Option<DiscoverCases>, cases: &mut DiscoverCases) {
    for (name, was) in earlier.unwrap_or_default() {
        if let Some(case) = cases.get_mut(&name).filter(|case| case.task == was.task) {
            case.finite_element = was.finite_element;
        }
    }
}

/// Cases that an earlier search left in the cohort's folder; `None` if there are none.
#[must_use]
pub fn beside(cohort: Option<&Path>) -> Option<DiscoverCases> {
    read_cases(&cohort?.join(FOLDER)).filter(|cases| !cases.is_empty())
}

/// Path of a run's cases.
#[must_use]
pub fn cases_file(run_dir: &Path) -> PathBuf {
    run_dir.join(CASES)
}
