//! Fragments of the report's address: which view and which part of it is shown.

/// Views and sections that every report has, and words of the address that are commands.
const TAKEN: [&str; 11] = [
    "top",
    "cohort",
    "errors",
    "notes",
    "patients",
    "pressures",
    "missing",
    "summary",
    "dark",
    "light",
    "all",
];

/// Anchor of a patient's view: the patient's name, with `p-` before a name that the report itself uses.
/// Different patients have different anchors.
#[must_use]
pub fn of(patient: &str) -> String {
    let bare = patient.trim_start_matches("p-");
    if TAKEN.contains(&bare) || bare.starts_with("missing-") {
        format!("p-{patient}")
    } else {
        patient.to_owned()
    }
}

/// Anchor of a part of a view. Names of patients are names of folders, so none contains `/`.
#[must_use]
pub fn part(view: &str, part: &str) -> String {
    format!("{view}/{part}")
}

/// Anchor of what a search for missing effects found for a patient.
#[must_use]
pub fn missing(patient: &str) -> String {
    format!("missing-{patient}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_patient_takes_an_anchor_of_the_report_or_of_another_patient() {
        let names = [
            "01-CoA",
            "p-01-CoA",
            "all",
            "p-all",
            "p-p-all",
            "missing-01-CoA",
        ];
        let anchors: Vec<String> = names.iter().map(|name| of(name)).collect();
        assert_eq!(
            anchors,
            [
                "01-CoA",
                "p-01-CoA",
                "p-all",
                "p-p-all",
                "p-p-p-all",
                "p-missing-01-CoA"
            ]
        );
        assert!(!anchors.contains(&missing("01-CoA")));
    }
}
