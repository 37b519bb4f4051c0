//! `cardiotwin cancel`: ends a patient's chain of tasks; published results stay.

use cardiotwin_schemas::ids::PatientId;
use clap::Args;

use crate::cli::answer;
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::OfCohort;
use crate::cli::store::open;
use crate::cli::talk::Talk;
use crate::engine::{self, Answer, StopSignal};

/// Stop the work on one patient or on all; results so far are kept
#[derive(Debug, Args)]
pub struct CancelArgs {
    /// Patient to cancel
    #[arg(required_unless_present = "all", conflicts_with = "all")]
    patient: Option<String>,
    /// Cancel all patients
    #[arg(long)]
    all: bool,
    #[command(flatten)]
    of: OfCohort,
}

/// Requests the cancellation and waits until jobs that are no longer needed have ended.
///
/// # Errors
/// Errors of the engine.
pub async fn execute(args: &CancelArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let patient = args.patient.as_deref().map(PatientId::from);
    let answer = engine::cancel(&folders.run, patient.as_ref()).await?;
    answer::tell(&answer, None, talk)?;
    let jobs = open(&folders)
        .await?
        .status()
        .await?
        .cluster
        .map_or(0, |cluster| cluster.jobs.len());
    if jobs > 0 && matches!(answer, Answer::Applied { .. }) {
        let stop = StopSignal::from_signals().map_err(|source| CliError::Io {
            what: "cannot listen to signals",
            source,
        })?;
        talk.say(
            "waiting for cancelled jobs to end; Ctrl-C stops waiting, and `advance` continues",
        );
        engine::end_unwanted_jobs(&folders.run, stop).await?;
    }
    Ok(Exit::Ok)
}
