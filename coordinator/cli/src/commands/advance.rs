//! `cardiotwin advance`: one tick of a run on a cluster.

use cardiotwin_engine::{self as engine, EngineEvent, RunOptions, RunSummary, StopSignal};
use clap::Args;
use serde::Serialize;

use super::run::{done, load_for_cluster, on_cluster};
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::store::open;
use crate::talk::{Talk, count};
use crate::tick::without_a_tick;
use crate::{access, notices, progress, scratch};

/// Advance a run on a cluster by one tick: collect results of jobs, decide, submit jobs, and exit
#[derive(Debug, Args)]
#[command(
    after_help = "For use in cron, scrontab and self-resubmitting jobs (docs/slurm.md): it asks no \
                  questions and does not wait for jobs.\n\
                  Killing it at any moment loses nothing."
)]
pub struct AdvanceArgs {
    #[command(flatten)]
    place: Place,
    /// Set KEY to VALUE, overriding all files (may be given several times)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<std::path::PathBuf>,
    /// Continue with this worker although the run began with another version
    #[arg(long)]
    adopt_version: bool,
    /// Do nothing if the files of any patient have errors, instead of advancing the other patients
    #[arg(long)]
    strict: bool,
    /// Print one JSON object about this tick instead of the table
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct Tick {
    patients: usize,
    done: usize,
    failed: usize,
    cancelled: usize,
    unfinished: usize,
    /// Patients left out because of errors in their files.
    refused: usize,
    /// Job elements that have not ended.
    jobs: usize,
    submitted: u64,
    published: u64,
    wall_s: f64,
}

/// Runs one tick.
///
/// # Errors
/// The same as for `run`.
pub async fn execute(args: &AdvanceArgs, talk: &Talk) -> Result<Exit, CliError> {
    let mut folders = args.place.folders();
    folders.find_cohort().await?;
    let options = load_for_cluster(
        &folders,
        &args.set,
        args.strict,
        args.worker.as_deref(),
        false,
        talk,
    )
    .await?;
    let options = RunOptions {
        adopt_version: args.adopt_version,
        ..options
    };
    let stop = StopSignal::from_signals().map_err(|source| CliError::Io {
        what: "cannot listen to signals",
        source,
    })?;
    let (events, mut received) = tokio::sync::mpsc::unbounded_channel();
    access::apply(&options.executor, &options.run_dir)?;
    scratch::lay_out(&options.executor, &options.run_dir)?;
    let n_refused = options.refused.len();
    let (run_dir, told) = (options.run_dir.clone(), options.executor.notices.clone());
    let summary = match engine::run(options, events, stop).await {
        Ok(summary) => summary,
        Err(error) => return without_a_tick(error, talk),
    };
    while let Ok(event) = received.try_recv() {
        if matches!(event, EngineEvent::Vanished { .. })
            && let Some(line) = progress::line(&event, "patients", talk.colour_err)
        {
            talk.say(&line);
        }
    }
    notices::tell(&run_dir, &told, talk).await;
    let over = !summary.on_cluster();
    if args.json {
        talk.json(&tick(&summary, n_refused))?;
    } else if over {
        let mut parts = format!(
            "{} done, {} failed, {} cancelled",
            summary.done, summary.failed, summary.cancelled
        );
        if summary.held > 0 {
            parts.push_str(&format!(", {} waiting for pilots", summary.held));
        }
        if n_refused > 0 {
            parts.push_str(&format!(", {n_refused} refused for errors in their files"));
        }
        talk.data(&format!(
            "{}: {parts}; nothing left to do\n",
            count(summary.patients, "patient")
        ))?;
    } else {
        on_cluster(&summary, &folders, talk).await?;
    }
    match (
        over,
        summary.failed + summary.cancelled + summary.held + n_refused,
    ) {
        (false, _) => Ok(Exit::Unfinished),
        (true, 0) => done(&open(&folders).await?).await,
        (true, _) => Ok(Exit::Problems),
    }
}

fn tick(summary: &RunSummary, refused: usize) -> Tick {
    Tick {
        patients: summary.patients,
        done: summary.done,
        failed: summary.failed,
        cancelled: summary.cancelled,
        unfinished: summary.unfinished,
        refused,
        jobs: summary.jobs,
        submitted: summary.submitted,
        published: summary.published,
        wall_s: summary.wall_s,
    }
}
