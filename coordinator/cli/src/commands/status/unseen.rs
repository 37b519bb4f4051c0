//! Patients of the cohort that the run does not know yet, and those whose files changed since.

use cardiotwin_engine::{self as engine, Foreseen};
use cardiotwin_input::{self as input, Options, Report};
use cardiotwin_schemas::status::Status;

use crate::error::CliError;
use crate::kept;
use crate::place::Folders;

/// Most patients whose files are read again for the status of a run.
const MOST: usize = 100;

/// What a run would take up.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Unseen {
    /// Patients that the run does not know.
    new: Vec<String>,
    /// Patients that are over and would be redone, each with the first step.
    changed: Vec<String>,
}

/// Compares the cohort's files with the run; nothing while a coordinator works, without the cohort's
/// folder, and in large cohorts, whose files take long to read.
///
/// # Errors
/// Errors of the store.
pub async fn unseen(status: &Status, folders: &Folders) -> Result<Unseen, CliError> {
    let n: u64 = status.counts.values().sum();
    let Some(cohort) = folders
        .cohort
        .as_ref()
        .filter(|cohort| cohort.join("cohort.toml").exists())
        .filter(|_| !status.coordinator_running && n <= MOST as u64)
    else {
        return Ok(Unseen::default());
    };
    let options = Options {
        kept: kept::assignments(&folders.run).await?,
        ..Options::default()
    };
    // `check` tells the problems.
    let Some(cohort) = input::load(cohort, &options, &mut Report::default()) else {
        return Ok(Unseen::default());
    };
    let plans = cohort.plans();
    let foreseen = engine::foresee(&folders.run, &plans).await?;
    let is_known = |id: &str| status.patients.iter().any(|one| one.patient == id);
    let mut unseen = Unseen::default();
    for plan in &plans {
        match foreseen.get(&plan.id) {
            None if !is_known(plan.id.as_str()) => unseen.new.push(plan.id.to_string()),
            Some(Foreseen::Redone(step)) => {
                unseen.changed.push(format!("{} (from {step} on)", plan.id));
            }
            _ => {}
        }
    }
    Ok(unseen)
}

impl Unseen {
    /// Lines below the table; empty if the run knows all files.
    pub fn words(&self, folders: &Folders) -> String {
        let mut text = String::new();
        for (what, patients) in [
            ("not in the run yet", &self.new),
            ("changed since the run", &self.changed),
        ] {
            if !patients.is_empty() {
                text.push_str(&format!("{what}: {}\n", patients.join(", ")));
            }
        }
        if !text.is_empty() {
            text.push_str(&format!("{} takes them up\n", folders.run_command()));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn new_and_changed_patients_are_named_with_the_command() {
        let folders = Folders::of(Path::new("my-cohort"), None);
        assert_eq!(Unseen::default().words(&folders), "");
        let unseen = Unseen {
            new: vec!["P9".into()],
            changed: vec!["P3 (from step-1 on)".into()],
        };
        assert_eq!(
            unseen.words(&folders),
            "not in the run yet: P9\nchanged since the run: P3 (from step-1 on)\n`cardiotwin run \
             my-cohort` takes them up\n"
        );
    }
}
