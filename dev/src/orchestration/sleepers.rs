//! Makespan of many tasks that sleep, on a real Slurm: next to the pilots of other workflow systems
//! (`deploy/next to-pilots.py`).

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context as _;
use cardiotwin_engine::{RunOptions, StopSignal, run};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};
use cardiotwin_schemas::task::{NoopSpec, TaskSpec};
use clap::Args;
use serde::Serialize;

use crate::arguments::Output;

/// Arguments of `cardiotwin-dev bench sleepers`.
#[derive(Debug, Args)]
pub struct SleepersArgs {
    /// Profile of the site: a file, or the name of a shipped one
    #[arg(long, value_name = "SITE")]
    site: String,
    /// Number of tasks, each a process
    #[arg(long, value_name = "N", default_value_t = 1000)]
    tasks: usize,
    /// Time that each task sleeps
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    task_s: f64,
    /// Tasks that the nodes run at once; with it, jobs are as long as all tasks take on them
    #[arg(long, value_name = "N")]
    slots: u32,
    /// Keep the run in this folder, which must be empty or absent [default: a temporary one]
    #[arg(long, value_name = "DIR")]
    run_dir: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

#[derive(Serialize)]
struct Sleepers {
    tasks: usize,
    task_s: f64,
    slots: u32,
    /// Time from the call to the last published outcome, s.
    makespan_s: f64,
    /// Share of the slots' time in which a task slept.
    utilisation: f64,
    published: u64,
}

/// Runs the tasks and prints the makespan.
///
/// # Errors
/// Errors of the engine; a task that was not published.
pub fn measure(args: &SleepersArgs) -> anyhow::Result<()> {
    let scratch = tempfile::tempdir_in(".").context("cannot make a folder here")?;
    let run_dir = args.run_dir.clone();
    let run_dir = run_dir.unwrap_or_else(|| scratch.path().join("run"));
    let patient = |n: usize| {
        let id = PatientId(format!("S{n:05}"));
        let spec = NoopSpec {
            label: id.to_string(),
            sleep_ms: (args.task_s * 1e3) as u64,
        };
        let task = Box::new(TaskSpec::Noop(spec));
        ResolvedPatient::without_data(id, Workflow::Task { task })
    };
    let mut executor = ExecutorSettings {
        kind: ExecutorKind::Slurm,
        ..ExecutorSettings::default()
    };
    executor.slurm.site.clone_from(&args.site);
    let ideal_s = args.task_s * args.tasks as f64 / f64::from(args.slots.max(1));
    executor.slurm.job_s = (1.1 * ideal_s).ceil() as u64;
    let options = RunOptions {
        run_dir: run_dir.clone(),
        chosen: None,
        cohort_name: "sleepers".into(),
        description: "tasks that sleep".into(),
        cohort_dir: run_dir,
        patients: Some((1..=args.tasks).map(patient).collect()),
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        executor,
        worker: None,
        adopt_version: true,
        watch: true,
    };
    let (events, _) = tokio::sync::mpsc::unbounded_channel();
    let began = Instant::now();
    let summary = super::runtime()?.block_on(run(options, events, StopSignal::new()))?;
    let makespan_s = began.elapsed().as_secs_f64();
    anyhow::ensure!(
        summary.published == args.tasks as u64,
        "{} of {} tasks were published",
        summary.published,
        args.tasks
    );
    let result = Sleepers {
        tasks: args.tasks,
        task_s: args.task_s,
        slots: args.slots,
        makespan_s,
        utilisation: ideal_s / makespan_s,
        published: summary.published,
    };
    args.output.print_as(&result, |result| {
        format!(
            "{} tasks of {} s on {} slots: {:.1} s, {:.0} % of the slots' time\n",
            result.tasks,
            result.task_s,
            result.slots,
            result.makespan_s,
            100.0 * result.utilisation
        )
    })
}
