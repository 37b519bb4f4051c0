//! Runs of a sweep's members, with progress on stderr and Ctrl-C as in `run`.

use cardiotwin_engine::{self as engine, EngineEvent, RunOptions, RunSummary, StopSignal};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::status::PatientState;

use crate::access;
use crate::error::CliError;
use crate::progress::Watcher;
use crate::talk::Talk;

/// Runs the unfinished members. Cancelled members are run, too, because the user has called the
/// command again.
///
/// - `members`: plural noun for the members in messages
///
/// # Errors
/// Errors of the engine.
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
            // A member with a single task ends when that task is published: one line is enough for
            // both events.
            if !matches!(event, EngineEvent::TaskPublished { ref step, .. } if step == "task") {
                watcher.on(&event, None);
            }
        }
        watcher.finish();
    });
    let outcome = engine::run(options, events, stop).await;
    // The watcher ends when the engine drops its sender.
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
        .filter(|member| member.state == PatientState::Cancelled);
    let cancelled: Vec<PatientId> = cancelled.map(|member| PatientId(member.patient)).collect();
    if !cancelled.is_empty() {
        engine::retry_all(&options.run_dir, &cancelled).await?;
        talk.say(&format!(
            "{} cancelled {members} are resumed",
            cancelled.len()
        ));
    }
    Ok(())
}
