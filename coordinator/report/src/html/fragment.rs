//! Parts of the report for a page that is made elsewhere: a patient's section, and what it needs.

use cardiotwin_schemas::record::PatientRecord;

use super::{page, patient};
use crate::results::Signals;

/// The section of a patient as an HTML element, without scripts and inline styles.
#[must_use]
pub fn patient_section(record: &PatientRecord) -> String {
    patient::section(record, &Signals::read(record), None).into_string()
}

/// Style sheet of all sections.
#[must_use]
pub fn style_sheet() -> String {
    page::sheet(true)
}

/// Script that reads values off plots. It defines `cardiotwinRead`, which takes an element whose
/// plots are new on the page.
#[must_use]
pub fn script() -> &'static str {
    page::JS
}

/// Viewer of the beating heart: a script that defines `cardiotwinHeart`.
#[must_use]
pub fn heart_viewer() -> &'static str {
    page::HEART_JS
}
