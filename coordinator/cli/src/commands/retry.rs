//! `cardiotwin retry`: repeats tasks with the same settings.

use std::collections::BTreeMap;

use cardiotwin_engine::{self as engine, Answer, Reader};
use cardiotwin_schemas::failure::{Failure, FailureCause};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::status::PatientState;
use clap::Args;

use crate::answer;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::OfCohort;
use crate::store::open;
use crate::talk::{Talk, count};

/// Repeat the task of failed or cancelled patients with the same settings
#[derive(Debug, Args)]
#[command(after_help = "To change settings instead, use `cardiotwin rerun`.")]
pub struct RetryArgs {
    /// Patient to retry
    #[arg(
        required_unless_present_any = ["failed", "all", "class"],
        conflicts_with_all = ["failed", "all", "class"]
    )]
    patient: Option<String>,
    /// Retry all failed patients
    #[arg(long, conflicts_with = "all")]
    failed: bool,
    /// Retry all failed and all cancelled patients
    #[arg(long)]
    all: bool,
    /// Retry only patients whose failure is of this class; `cancelled` are those that a person
    /// stopped
    #[arg(long, value_name = "CLASS", value_parser = CLASSES)]
    class: Option<String>,
    /// Show which patients would be retried without retrying them
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    of: OfCohort,
}

/// The class of patients that a person stopped, by `cancel` or `scancel`.
const CANCELLED: &str = "cancelled";

/// Classes of failures, and the causes of a site failure, by which `--class` selects.
const CLASSES: [&str; 11] = [
    "input",
    "site",
    "numerics",
    "bug",
    "walltime",
    "oom",
    "node",
    "preemption",
    CANCELLED,
    "refused",
    "unexplained",
];

/// Words by which `--class` finds a patient, the nearest to the fault first; empty for a patient
/// that nothing holds.
fn classes(state: PatientState, failure: Option<&Failure>) -> Vec<&'static str> {
    match (state, failure) {
        (PatientState::Cancelled, _) => vec![CANCELLED],
        (PatientState::Failed, Some(failure)) => {
            let cause = FailureCause::ALL
                .iter()
                .find(|(cause, _)| Some(*cause) == failure.cause)
                .map(|(_, word)| *word);
            cause.into_iter().chain([failure.class.as_str()]).collect()
        }
        (PatientState::Failed, None) => vec!["failed"],
        _ => Vec::new(),
    }
}

impl RetryArgs {
    fn wants(&self, state: PatientState, classes: &[&str]) -> bool {
        match &self.class {
            // A class that is named is meant, whichever state it has.
            Some(class) => classes.contains(&class.as_str()),
            None => state == PatientState::Failed || self.all && state == PatientState::Cancelled,
        }
    }
}

/// Requests the repetition of the tasks.
///
/// # Errors
/// Errors of the engine and the store.
pub async fn execute(args: &RetryArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let reader = open(&folders).await?;
    let chosen = match &args.patient {
        Some(patient) => {
            let id = PatientId(patient.clone());
            let record = reader.patient_record(&id).await?;
            let classes = classes(record.status.state, record.failure.as_ref());
            vec![(id, classes.first().copied().unwrap_or("not failed"))]
        }
        None => chosen(args, &reader).await?,
    };
    drop(reader);
    if chosen.is_empty() {
        talk.say("no failed patients of these classes: nothing to retry");
        return Ok(Exit::Ok);
    }
    if args.dry_run {
        for (patient, class) in &chosen {
            talk.data(&format!("{patient}  {class}\n"))?;
        }
        talk.data(&format!("{} would be retried\n", counted(&chosen)))?;
        return Ok(Exit::Ok);
    }
    let patients: Vec<PatientId> = chosen.iter().map(|(id, _)| id.clone()).collect();
    let answer = engine::retry_all(&folders.run, &patients).await?;
    answer::tell(&answer, Some(&folders), talk)?;
    if args.patient.is_none() {
        let left_out = match &answer {
            Answer::Applied { refused, .. } if !refused.is_empty() => {
                format!("; {} left out", refused.len())
            }
            _ => String::new(),
        };
        talk.data(&format!("{} to retry{left_out}\n", counted(&chosen)))?;
    }
    Ok(Exit::Ok)
}

/// Patients that the arguments select, each with its class, in the order of `status`.
async fn chosen(
    args: &RetryArgs,
    reader: &Reader,
) -> Result<Vec<(PatientId, &'static str)>, CliError> {
    let mut chosen = Vec::new();
    for patient in reader.status().await?.patients {
        let id = PatientId(patient.patient);
        let failure = match patient.state {
            PatientState::Failed => reader.patient_record(&id).await?.failure,
            _ => None,
        };
        let classes = classes(patient.state, failure.as_ref());
        if let Some(class) = classes.first()
            && args.wants(patient.state, &classes)
        {
            chosen.push((id, *class));
        }
    }
    Ok(chosen)
}

/// Numbers in words, such as `3 patients (2 cancelled, 1 oom)`.
fn counted(chosen: &[(PatientId, &str)]) -> String {
    let mut of_class: BTreeMap<&str, usize> = BTreeMap::new();
    for (_, class) in chosen {
        *of_class.entry(class).or_default() += 1;
    }
    let parts: Vec<String> = of_class
        .iter()
        .map(|(class, n)| format!("{n} {class}"))
        .collect();
    format!("{} ({})", count(chosen.len(), "patient"), parts.join(", "))
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::failure::FailureClass;

    use super::*;

    #[test]
    fn every_state_that_status_shows_as_held_has_a_class_and_no_other_has() {
        let oom = Failure {
            cause: Some(FailureCause::OutOfMemory),
            ..Failure::new(FailureClass::Site, "out of memory")
        };
        for state in PatientState::ALL {
            let found = classes(state, Some(&oom));
            let wanted: &[&str] = match state {
                PatientState::Cancelled => &["cancelled"],
                PatientState::Failed => &["oom", "site"],
                _ => &[],
            };
            assert_eq!(found, wanted, "{state:?}");
        }
        let ids = ["P1", "P2", "P3"].map(PatientId::from);
        let classes = ["oom", "cancelled", "cancelled"];
        let chosen: Vec<(PatientId, &str)> = ids.into_iter().zip(classes).collect();
        assert_eq!(counted(&chosen), "3 patients (2 cancelled, 1 oom)");
    }
}
