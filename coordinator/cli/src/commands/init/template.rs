//! Files of a cohort to fill in.

use std::path::Path;

/// Settings of a cohort, with `{name}` for its name.
pub const COHORT: &str = include_str!("../../templates/cohort.toml");
/// The patient to fill in.
pub const PATIENT: &str = include_str!("../../templates/patient.toml");

/// Whether a patient's folder holds nothing but the template that this command writes, unedited.
#[must_use]
pub fn is_untouched(patient: &Path) -> bool {
    let Ok(entries) = std::fs::read_dir(patient) else {
        return false;
    };
    let only_the_template = entries
        .map_while(Result::ok)
        .all(|entry| entry.file_name() == "patient.toml");
    // Some editors and version control write other line ends.
    let text = std::fs::read_to_string(patient.join("patient.toml")).unwrap_or_default();
    only_the_template && text.replace("\r\n", "\n") == PATIENT
}

/// The text as a quoted TOML string.
pub fn toml_text(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}
