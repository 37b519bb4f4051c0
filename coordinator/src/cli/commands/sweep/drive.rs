//! Running a sweep's members: progress on stderr, Ctrl-C as in `run`.

use cardiotwin_schemas::ids::PatientId;

use crate::cli::access;
use crate::cli::error::CliError;
use crate::cli::progress::Watcher;
use crate::cli::talk::Talk;
use crate::engine::{self, EngineEvent, RunOptions, RunSummary, StopSignal};

/// Runs what is left; a cancelled member is taken up again, since it was asked for once more.
///
/// - `members`: what they are called, in the plural
///
/// # Errors
/// The engine's.
pub async fn drive(
    options: RunOptions,
    members: &'static str,
    talk: &Talk,
) -> Result<RunSummary, CliError> {
    access::apply(&options.executor, &options.run_dir)?;
    take_up_cancelled(&options, members, talk).await?;
    let stop = StopSignal::from_signals().map_err(|source| CliError::Io {
        what: "cannot listen to signals",
        source,
    })?;
    let (events, mut received) = tokio::sync::mpsc::unbounded_channel();
    let mut watcher = Watcher::new(talk, members);
    let watching = tokio::spawn(async move {
        while let Some(event) = received.recv().await {
            // A member of one task is over when its task is published: one line for both.
            if !matches!(event, EngineEvent::TaskPublished { ref step, .. } if step == "task") {
                watcher.on(&event, None);
            }
        }
        watcher.finish();
    });
    let outcome = engine::run(options, events, stop).await;
    // The watcher ends when the engine has dropped its sender.
    let _ = watching.await;
    Ok(outcome?)
}

async fn take_up_cancelled(
    options: &RunOptions,
    members: &str,
    talk: &Talk,
) -> Result<(), CliError> {
    if !options.run_dir.join("cardiotwin.db").exists() {
        return Ok(());
    }
    let status = engine::Reader::open(&options.run_dir)
        .await?
        .status()
        .await?;
    let cancelled = status
        .patients
        .into_iter()
        .filter(|member| member.state == "cancelled");
    let cancelled: Vec<PatientId> = cancelled.map(|member| PatientId(member.patient)).collect();
    if !cancelled.is_empty() {
        engine::retry_all(&options.run_dir, &cancelled).await?;
        talk.say(&format!(
            "{} cancelled {members} are taken up again",
            cancelled.len()
        ));
    }
    Ok(())
}
