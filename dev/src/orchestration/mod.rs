//! Cost of the coordinator: alone, and over the jobs of a modelled Slurm.

mod cluster;
pub mod dashboard;
mod local;
pub mod sleepers;

use std::path::PathBuf;

use anyhow::Context as _;
use cardiotwin_engine::StopSignal;
use clap::Args;

use crate::arguments::Output;
use cluster::{ClusterBenchOptions, ClusterBenchResult, TickCost, measure_cluster};
use local::{BenchOptions, BenchResult};

/// Arguments of `cardiotwin-dev bench orchestration`.
#[derive(Debug, Args)]
pub struct OrchestrationArgs {
    /// Number of patients
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
    /// The worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
    /// Drive the run and measure nothing: --kill starts this program so
    #[arg(long, hide = true, requires = "run_dir")]
    drive_only: bool,
}

/// Arguments of `cardiotwin-dev bench slurm`.
#[derive(Debug, Args)]
pub struct SlurmArgs {
    /// Living jobs, of which half run
    #[arg(long, value_name = "N", default_value_t = 1000)]
    jobs: usize,
    /// Samples, each a task of its own
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    samples: usize,
    #[command(flatten)]
    output: Output,
}

/// Measures the coordinator over the jobs of a modelled Slurm and prints the figures.
///
/// # Errors
/// Errors of the engine, or of the temporary folder.
pub fn measure_slurm(args: &SlurmArgs) -> anyhow::Result<()> {
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    let options = ClusterBenchOptions {
        folder: scratch.path().join("bench"),
        jobs: args.jobs,
        samples: args.samples,
    };
    let result = runtime()?.block_on(measure_cluster(&options))?;
    args.output.print_as(&result, slurm_text)
}

/// Measures the coordinator alone and prints the figures.
///
/// # Errors
/// Errors of the engine; a folder that is not empty.
pub fn measure(args: &OrchestrationArgs) -> anyhow::Result<()> {
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
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
        runtime()?.block_on(local::once(&options, StopSignal::new()))?;
        return Ok(());
    }
    let used =
        std::fs::read_dir(&options.run_dir).is_ok_and(|mut entries| entries.next().is_some());
    anyhow::ensure!(
        !used,
        "{} is not empty: a benchmark needs a folder of its own",
        options.run_dir.display()
    );
    if args.kill {
        options.victim = Some(victim(&options));
    }
    let result = runtime()?.block_on(local::orchestration(&options))?;
    args.output.print_as(&result, text)
}

fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime")
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
