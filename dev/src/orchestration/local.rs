//! Cost of orchestration: many patients of three no-op tasks, through store, outbox and executor.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use cardiotwin_engine::{
    EngineError, EventRecord, Reader, RunOptions, RunSummary, StopSignal, run,
};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};
use cardiotwin_schemas::status::PatientState;
use cardiotwin_store::DATABASE_FILE;
use serde::Serialize;

/// Options of the benchmark of the orchestration.
#[derive(Debug, Clone)]
pub struct BenchOptions {
    /// Run directory; must be empty or absent.
    pub run_dir: PathBuf,
    /// Number of patients, of three tasks each.
    pub patients: usize,
    /// Whether a worker process is started for each task. Otherwise tasks run in-process.
    pub spawn: bool,
    /// Number of workers at once; 0 means one per core.
    pub workers: u32,
    /// Path of the worker's executable; `None` means the one next to this program.
    pub worker: Option<PathBuf>,
    /// Arguments (after the program's name) of a command that drives the same run in a process of
    /// its own. This process is killed midway to measure the restart. `None`: the restart of a
    /// finished run is measured.
    pub victim: Option<Vec<String>>,
}

/// Results of the benchmark of the orchestration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchResult {
    /// Number of patients, of three tasks each.
    pub patients: usize,
    /// Number of tasks of all patients.
    pub tasks: usize,
    /// Executor: `in-process` or `local`.
    pub executor: &'static str,
    /// Wall time of the whole run, s.
    pub run_s: f64,
    /// Wall time per task, ms.
    pub ms_per_task: f64,
    /// Time to open the store and read the status of all patients, best of five, ms.
    pub status_ms: f64,
    /// Time from the start of a coordinator to its first commit, with everything loaded, s.
    /// Measured after the kill -9 if there was one.
    pub restart_s: f64,
    /// Number of tasks published before the kill -9; `None` if there was none.
    pub published_before_kill: Option<u64>,
    /// Size of the database at the end, MB.
    pub database_mb: f64,
}

/// Measures the run, the status and the restart.
///
/// # Errors
/// [`EngineError`] if the run fails or its store cannot be read.
pub async fn orchestration(options: &BenchOptions) -> Result<BenchResult, EngineError> {
    let (mut restart_s, mut published_before_kill) = (None, None);
    if let Some(arguments) = &options.victim {
        kill_midway(options, arguments).await?;
        let status = Reader::open(&options.run_dir).await?.status().await?;
        published_before_kill = Some(published(&options.run_dir).await?);
        if status.counts.get(&PatientState::Done).copied().unwrap_or(0) < options.patients as u64 {
            restart_s = Some(time_restart(options).await?);
        }
    }
    let began = Instant::now();
    let summary = once(options, StopSignal::new()).await?;
    let run_s = began.elapsed().as_secs_f64();
    let restart_s = match restart_s {
        Some(restart_s) => restart_s,
        None => time_restart(options).await?,
    };
    let mut status_ms = f64::INFINITY;
    for _ in 0..5 {
        let began = Instant::now();
        let status = Reader::open(&options.run_dir).await?.status().await?;
        let text = serde_json::to_string(&status).expect("a status is JSON");
        status_ms = status_ms.min(began.elapsed().as_secs_f64() * 1e3);
        assert!(
            text.len() > status.patients.len(),
            "a status names every patient"
        );
    }
    let database = options.run_dir.join(DATABASE_FILE);
    Ok(BenchResult {
        patients: options.patients,
        tasks: options.patients * 3,
        executor: if options.spawn { "local" } else { "in-process" },
        run_s,
        ms_per_task: run_s * 1e3 / summary.published.max(1) as f64,
        status_ms,
        restart_s,
        published_before_kill,
        database_mb: std::fs::metadata(database).map_or(0.0, |m| m.len() as f64 / 1e6),
    })
}

/// Runs the cohort of no-ops, or what is left of it.
///
/// # Errors
/// [`EngineError`] as for [`run`].
pub async fn once(options: &BenchOptions, stop: StopSignal) -> Result<RunSummary, EngineError> {
    let (events, _) = tokio::sync::mpsc::unbounded_channel();
    run(run_options(options), events, stop).await
}

fn run_options(options: &BenchOptions) -> RunOptions {
    let kind = if options.spawn {
        ExecutorKind::Local
    } else {
        ExecutorKind::InProcess
    };
    RunOptions {
        run_dir: options.run_dir.clone(),
        chosen: None,
        cohort_name: "bench".into(),
        description: "no-op tasks".into(),
        cohort_dir: options.run_dir.clone(),
        patients: Some(
            (1..=options.patients)
                .map(|n| ResolvedPatient::noop(&format!("N{n:05}"), 0))
                .collect(),
        ),
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        executor: ExecutorSettings {
            kind,
            workers: options.workers,
            ..ExecutorSettings::default()
        },
        worker: options.worker.clone(),
        adopt_version: true,
        watch: false,
    }
}

/// Time from the start of a coordinator until it has loaded the run, inspected what was left,
/// decided and committed, s.
async fn time_restart(options: &BenchOptions) -> Result<f64, EngineError> {
    let stop = StopSignal::new();
    // The run is asked to stop before it begins, so only its start-up and shutdown are measured.
    stop.ask();
    stop.ask();
    let (events, _) = tokio::sync::mpsc::unbounded_channel();
    let options = run_options(options);
    let began = Instant::now();
    run(options, events, stop).await?;
    Ok(began.elapsed().as_secs_f64())
}

async fn published(run_dir: &Path) -> Result<u64, EngineError> {
    let history = Reader::open(run_dir).await?.history(None).await?;
    let published = |e: &&EventRecord| e.machine == "task" && e.event["how"]["how"] == "succeeded";
    Ok(history.iter().filter(published).count() as u64)
}

/// Starts a coordinator in a process of its own and kills it as soon as half of the work is done.
async fn kill_midway(options: &BenchOptions, arguments: &[String]) -> Result<(), EngineError> {
    let own = std::env::current_exe().unwrap_or_default();
    let failed = |source| EngineError::File {
        what: "start",
        path: own.clone(),
        source,
    };
    let mut victim = Command::new(&own)
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map_err(failed)?;
    loop {
        tokio::time::sleep(Duration::from_millis(20)).await;
        let over = victim.try_wait().map_err(failed)?.is_some();
        let Ok(reader) = Reader::open(&options.run_dir).await else {
            continue;
        };
        let Ok(status) = reader.status().await else {
            continue;
        };
        let done = status.counts.get(&PatientState::Done).copied().unwrap_or(0);
        if over || done * 2 >= options.patients as u64 {
            // SIGKILL: no handler, no destructor.
            let _ = victim.kill();
            victim.wait().map_err(failed)?;
            return Ok(());
        }
    }
}
