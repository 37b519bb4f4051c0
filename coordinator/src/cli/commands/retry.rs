//! `cardiotwin retry`: repeats a task with the same settings.

use cardiotwin_schemas::failure::{Failure, FailureCause};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::status::PatientState;
use clap::Args;

use crate::cli::answer;
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::OfCohort;
use crate::cli::store::open;
use crate::cli::talk::Talk;
use crate::engine;

/// Repeat the task of a failed or cancelled patient with the same settings
#[derive(Debug, Args)]
#[command(after_help = "To change settings instead, use `cardiotwin rerun`.")]
pub struct RetryArgs {
    /// Patient to retry
    #[arg(required_unless_present = "failed", conflicts_with = "failed")]
    patient: Option<String>,
    /// Retry all failed patients
    #[arg(long)]
    failed: bool,
    /// With --failed, retry only failures of this class
    #[arg(long, value_name = "CLASS", requires = "failed", value_parser = CLASSES)]
    class: Option<String>,
    #[command(flatten)]
    of: OfCohort,
}

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
    "cancelled",
    "refused",
    "unexplained",
];

fn is_of(failure: &Failure, class: &str) -> bool {
    let cause = FailureCause::ALL
        .iter()
        .find(|(cause, _)| Some(*cause) == failure.cause);
    failure.class.as_str() == class || cause.is_some_and(|(_, word)| *word == class)
}

/// Requests the repetition of the tasks.
///
/// # Errors
/// Errors of the engine and the store.
pub async fn execute(args: &RetryArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let patients: Vec<PatientId> = match &args.patient {
        Some(patient) => vec![PatientId(patient.clone())],
        None => {
            let reader = open(&folders).await?;
            let mut failed = Vec::new();
            for patient in reader
                .status()
                .await?
                .patients
                .into_iter()
                .filter(|p| p.state == PatientState::Failed)
            {
                let id = PatientId(patient.patient);
                let failure = match args.class {
                    Some(_) => reader.patient_record(&id).await?.failure,
                    None => None,
                };
                if args
                    .class
                    .as_ref()
                    .is_none_or(|class| failure.is_some_and(|failure| is_of(&failure, class)))
                {
                    failed.push(id);
                }
            }
            failed
        }
    };
    if patients.is_empty() {
        talk.say("no patient has such a failure: nothing to retry");
    }
    for patient in &patients {
        let answer = engine::retry(&folders.run, patient).await?;
        answer::tell(&answer, Some(&folders), talk)?;
    }
    Ok(Exit::Ok)
}
