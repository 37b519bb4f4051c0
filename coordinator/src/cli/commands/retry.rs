//! `cardiotwin retry`: the same task again, with the same settings.

use cardiotwin_schemas::ids::PatientId;
use clap::Args;

use crate::cli::answer;
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::OfCohort;
use crate::cli::store::open;
use crate::cli::talk::Talk;
use crate::engine;

/// Repeat a failed or cancelled patient's task with the same settings
#[derive(Debug, Args)]
#[command(after_help = "To change settings instead: `cardiotwin rerun`.")]
pub struct RetryArgs {
    /// Whose task to repeat
    #[arg(required_unless_present = "failed", conflicts_with = "failed")]
    patient: Option<String>,
    /// Those of all failed patients
    #[arg(long)]
    failed: bool,
    #[command(flatten)]
    of: OfCohort,
}

/// Asks for it.
///
/// # Errors
/// The engine's.
pub async fn execute(args: &RetryArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let patients: Vec<PatientId> = match &args.patient {
        Some(patient) => vec![PatientId(patient.clone())],
        None => {
            let status = open(&folders).await?.status().await?;
            let failed = status.patients.into_iter().filter(|patient| patient.state == "failed");
            failed.map(|patient| PatientId(patient.patient)).collect()
        }
    };
    if patients.is_empty() {
        talk.say("no patient has failed: nothing to retry");
    }
    for patient in &patients {
        let answer = engine::retry(&folders.run, patient).await?;
        answer::tell(&answer, Some(&folders), talk)?;
    }
    Ok(Exit::Ok)
}
