//! `cardiotwin bench`: cost of the orchestration itself.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::talk::Talk;
use crate::engine::bench::{self, BenchOptions, BenchResult};
use crate::engine::{
    ClusterBenchOptions, ClusterBenchResult, StopSignal, TickCost, measure_cluster,
};

/// Measure what orchestration costs
#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(subcommand)]
    command: BenchCommand,
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    Orchestration(OrchestrationArgs),
    Slurm(SlurmArgs),
}

/// Patients of three no-op tasks each, through database, outbox and executor
#[derive(Debug, Args)]
struct OrchestrationArgs {
    /// How many
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    patients: usize,
    /// A worker process for each task instead of in-process
    #[arg(long)]
    spawn: bool,
    /// Workers at once; 0 is one for each core
    #[arg(long, value_name = "N", default_value_t = 0)]
    workers: u32,
    /// Kill the coordinator (-9) when half is done, and measure how fast the next one is back
    #[arg(long)]
    kill: bool,
    /// Keep the run in this folder, which must be empty or absent [default: a temporary one]
    #[arg(long, value_name = "DIR")]
    run_dir: Option<PathBuf>,
    /// The worker's executable [default: cardiotwin-worker beside this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    /// One JSON object instead of text
    #[arg(long)]
    json: bool,
    /// Drive the run and measure nothing: what --kill starts
    #[arg(long, hide = true, requires = "run_dir")]
    drive_only: bool,
}

/// Ticks over many living jobs of a modelled Slurm; status and restart of many samples
#[derive(Debug, Args)]
struct SlurmArgs {
    /// Living jobs, of which half run
    #[arg(long, value_name = "N", default_value_t = 1000)]
    jobs: usize,
    /// Samples, each a task of its own
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    samples: usize,
    /// One JSON object instead of text
    #[arg(long)]
    json: bool,
}

/// Runs the benchmark and prints its result.
///
/// # Errors
/// Errors of the engine.
pub async fn execute(args: &BenchArgs, talk: &Talk) -> Result<Exit, CliError> {
    match &args.command {
        BenchCommand::Orchestration(args) => orchestration(args, talk).await,
        BenchCommand::Slurm(args) => slurm(args, talk).await,
    }
}

async fn slurm(args: &SlurmArgs, talk: &Talk) -> Result<Exit, CliError> {
    let scratch =
        tempfile::tempdir().map_err(CliError::file("make a folder in", std::env::temp_dir()))?;
    let folder = scratch.path().join("bench");
    let options = ClusterBenchOptions {
        folder,
        jobs: args.jobs,
        samples: args.samples,
    };
    let result = measure_cluster(&options).await?;
    if args.json {
        talk.json(&result)?
    } else {
        talk.data(&slurm_text(&result))?
    }
    Ok(Exit::Ok)
}

fn slurm_text(result: &ClusterBenchResult) -> String {
    let tick = |what: &str, cost: &TickCost| {
        let asked: Vec<String> = cost
            .commands
            .iter()
            .map(|(program, n)| format!("{n} {program}"))
            .collect();
        format!(
            "{what:<26}{:9.1} ms of ours   {}\n",
            cost.ours_ms,
            asked.join(", ")
        )
    };
    format!("{} living jobs\n", result.jobs)
        + &tick("tick that submits them", &result.submit)
        + &tick("tick, half have begun", &result.news)
        + &tick("tick, nothing happened", &result.quiet)
        + &tick("tick, 1 in 100 failed", &result.failures)
        + &format!("{} samples, each a task\n", result.samples)
        + &format!(
            "{:<26}{:9.1} µs a sample\n",
            "run in-process", result.us_per_sample
        )
        + &format!("{:<26}{:9.1} ms\n", "status, one screen", result.status_ms)
        + &format!(
            "{:<26}{:9.1} ms\n",
            "status --json, all", result.status_json_ms
        )
        + &format!("{:<26}{:9.3} s\n", "restart", result.restart_s)
}

async fn orchestration(args: &OrchestrationArgs, talk: &Talk) -> Result<Exit, CliError> {
    let scratch =
        tempfile::tempdir().map_err(CliError::file("make a folder in", std::env::temp_dir()))?;
    let run_dir = args
        .run_dir
        .clone()
        .unwrap_or_else(|| scratch.path().join("run"));
    let mut options = BenchOptions {
        run_dir,
        patients: args.patients,
        spawn: args.spawn,
        workers: args.workers,
        worker: args.worker.clone(),
        victim: None,
    };
    if args.drive_only {
        bench::once(&options, StopSignal::new()).await?;
        return Ok(Exit::Ok);
    }
    let used =
        std::fs::read_dir(&options.run_dir).is_ok_and(|mut entries| entries.next().is_some());
    if used {
        let message = format!(
            "{} is not empty: a benchmark needs a folder of its own",
            options.run_dir.display()
        );
        return Err(CliError::Usage(message));
    }
    if args.kill {
        options.victim = Some(victim(&options));
    }
    let result = bench::orchestration(&options).await?;
    if args.json {
        talk.json(&result)?
    } else {
        talk.data(&text(&result))?
    }
    Ok(Exit::Ok)
}

/// Arguments of a process that drives the same run and is killed half-way.
fn victim(options: &BenchOptions) -> Vec<String> {
    let mut arguments: Vec<String> = ["bench", "orchestration", "--drive-only"]
        .iter()
        .map(|word| (*word).to_owned())
        .collect();
    arguments.extend(["--patients".to_owned(), options.patients.to_string()]);
    arguments.extend(["--workers".to_owned(), options.workers.to_string()]);
    arguments.extend([
        "--run-dir".to_owned(),
        options.run_dir.to_string_lossy().into_owned(),
    ]);
    if options.spawn {
        arguments.push("--spawn".to_owned());
    }
    if let Some(worker) = &options.worker {
        arguments.extend(["--worker".to_owned(), worker.to_string_lossy().into_owned()]);
    }
    arguments
}

fn text(result: &BenchResult) -> String {
    let mut lines = vec![
        format!(
            "{} patients, {} tasks, executor {}",
            result.patients, result.tasks, result.executor
        ),
        format!(
            "run       {:9.2} s   {:.3} ms a task",
            result.run_s, result.ms_per_task
        ),
        format!("status    {:9.1} ms", result.status_ms),
        format!("restart   {:9.3} s", result.restart_s),
        format!("database  {:9.1} MB", result.database_mb),
    ];
    if let Some(published) = result.published_before_kill {
        lines.push(format!(
            "killed after {published} published tasks; the run's time is that of the rest"
        ));
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}
