//! `cardiotwin cancel`: ends a patient's chain of tasks; published results stay.

use std::path::Path;

use cardiotwin_engine::{self as engine, Answer, Reader, StopSignal};
use cardiotwin_schemas::ids::PatientId;
use clap::Args;

use crate::answer;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::OfCohort;
use crate::talk::Talk;

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
    end_jobs(&folders.run, &answer, talk).await
}

/// Waits until jobs that are no longer needed have ended, unless a running coordinator sees to it.
///
/// # Errors
/// Errors of the engine.
pub(super) async fn end_jobs(run: &Path, answer: &Answer, talk: &Talk) -> Result<Exit, CliError> {
    let jobs = Reader::open(run)
        .await?
        .status()
        .await?
        .cluster
        .map_or(0, |cluster| cluster.jobs.len());
    if jobs > 0 && !matches!(answer, Answer::Asked { .. }) {
        let stop = StopSignal::from_signals().map_err(|source| CliError::Io {
            what: "cannot listen to signals",
            source,
        })?;
        talk.say(
            "waiting for cancelled jobs to end; Ctrl-C stops waiting, and `advance` continues",
        );
        if !engine::end_unwanted_jobs(run, stop).await? {
            return Ok(Exit::Unfinished);
        }
    }
    Ok(Exit::Ok)
}
