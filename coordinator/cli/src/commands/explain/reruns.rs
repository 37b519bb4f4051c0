//! Settings that `rerun` stored for a patient, with the values that they replace.

use cardiotwin_engine::{self as engine, LeafChange};
use cardiotwin_input::Patient;
use serde::Serialize;

use super::places::line;

/// A setting that a rerun changed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stored {
    #[serde(flatten)]
    change: LeafChange,
    /// Command that sets it.
    command: String,
}

/// The settings that differ between the patient with and without its stored settings.
///
/// - `of`: the cohort, as an argument
#[must_use]
pub fn of(with: &Patient, without: &Patient, of: &str) -> Vec<Stored> {
    let json =
        |patient: &Patient| serde_json::to_value(&patient.settings.settings).unwrap_or_default();
    engine::leaf_changes(&json(without), &json(with))
        .into_iter()
        .map(|change| {
            let value = change
                .new
                .as_ref()
                .map_or("null".to_owned(), ToString::to_string);
            let from = engine::first_stage(&change.path);
            let command = format!(
                "cardiotwin rerun {} --from {} --set {}={value}{of}",
                with.id,
                from.as_str().replace("step-", "step"),
                change.path
            );
            Stored { change, command }
        })
        .collect()
}

/// A line for each setting below a sentence; empty without any.
#[must_use]
pub fn words(stored: &[Stored]) -> String {
    if stored.is_empty() {
        return String::new();
    }
    let mut text = "set by `rerun`, for this patient alone:\n".to_owned();
    for one in stored {
        text.push_str(&line(&one.change, &[format!("`{}`", one.command)]));
    }
    text
}

#[cfg(test)]
mod tests {
    use cardiotwin_input::{self as input, Options, Report};

    use super::*;

    #[test]
    fn a_setting_of_a_rerun_has_both_values_and_its_command() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("patients/P1")).unwrap();
        std::fs::write(
            folder.path().join("cohort.toml"),
            "name = 'c'\n[step1]\ndamping = 0.8\n",
        )
        .unwrap();
        let patient = "id = 'P1'\ncycle_length_ms = 700\n[measured]\n";
        std::fs::write(folder.path().join("patients/P1/patient.toml"), patient).unwrap();
        let load = |options: &Options| {
            input::load(folder.path(), options, &mut Report::default())
                .unwrap()
                .patients
                .remove(0)
        };
        let stored = Options {
            overrides: [(
                "P1".to_owned(),
                serde_json::json!({"step1": {"damping": 0.5}}),
            )]
            .into(),
            ..Options::default()
        };
        let (with, without) = (load(&stored), load(&Options::default()));
        let said = words(&of(&with, &without, " --cohort c"));
        for part in [
            "step1.damping: 0.8 -> 0.5",
            "`cardiotwin rerun P1 --from step1 --set step1.damping=0.5 --cohort c`",
        ] {
            assert!(said.contains(part), "{said}");
        }
        assert_eq!(words(&of(&without, &without, "")), "");
    }
}
