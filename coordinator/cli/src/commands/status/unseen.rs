//! Patients of the cohort that the run does not know yet, and those whose files changed since.

use cardiotwin_engine::{self as engine, Foreseen};
use cardiotwin_input::{self as input, Options, Report};
use cardiotwin_schemas::status::{ChangedPatient, Status};

use crate::error::CliError;
use crate::kept;
use crate::place::Folders;

/// Most patients whose files are read again for the status of a run.
const MOST: usize = 100;

/// Adds to the status what a run would take up; nothing while a coordinator works, without the cohort's
/// folder, and in large cohorts, whose files take long to read.
///
/// # Errors
/// Errors of the store.
pub async fn add(status: &mut Status, folders: &Folders) -> Result<(), CliError> {
    let n: u64 = status.counts.values().sum();
    let Some(cohort) = folders
        .cohort
        .as_ref()
        .filter(|cohort| cohort.join("cohort.toml").exists())
        .filter(|_| !status.coordinator_running && n <= MOST as u64)
    else {
        return Ok(());
    };
    let options = Options {
        kept: kept::assignments(&folders.run).await?,
        ..Options::default()
    };
    // `check` tells the problems.
    let Some(cohort) = input::load(cohort, &options, &mut Report::default()) else {
        return Ok(());
    };
    let plans = cohort.plans();
    let foreseen = engine::foresee(&folders.run, &plans).await?;
    for plan in &plans {
        let patient = plan.id.to_string();
        match foreseen.get(&plan.id) {
            None if status.patients.iter().all(|one| one.patient != patient) => {
                status.new_patients.push(patient);
            }
            Some(Foreseen::Redone(step)) => status.changed_patients.push(ChangedPatient {
                patient,
                from: step.to_string(),
            }),
            _ => {}
        }
    }
    Ok(())
}

/// Lines below the table; empty if the run knows all files.
pub fn words(status: &Status, folders: &Folders) -> String {
    match lines(status) {
        text if text.is_empty() => text,
        text => format!("{text}{} takes them up\n", folders.run_command()),
    }
}

/// A line for new patients and one for changed ones, where there are any.
pub fn lines(status: &Status) -> String {
    let changed: Vec<String> = status
        .changed_patients
        .iter()
        .map(|one| format!("{} (from {} on)", one.patient, one.from))
        .collect();
    [
        ("not in the run yet", &status.new_patients),
        ("changed since the run", &changed),
    ]
    .into_iter()
    .filter(|(_, patients)| !patients.is_empty())
    .map(|(what, patients)| format!("{what}: {}\n", patients.join(", ")))
    .collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::commands::status::table_tests::status;

    #[test]
    fn new_and_changed_patients_are_named_with_the_command() {
        let folders = Folders::of(Path::new("my-cohort"), None);
        assert_eq!(words(&status(), &folders), "");
        let unseen = Status {
            new_patients: vec!["P9".into()],
            changed_patients: vec![ChangedPatient {
                patient: "P3".into(),
                from: "step-1".into(),
            }],
            ..status()
        };
        assert_eq!(
            words(&unseen, &folders),
            "not in the run yet: P9\nchanged since the run: P3 (from step-1 on)\n`cardiotwin run \
             my-cohort` takes them up\n"
        );
    }
}
