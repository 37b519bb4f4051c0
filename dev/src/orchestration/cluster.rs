//! Benchmark of the coordinator's own time on a cluster: ticks over many live jobs, status and
//! restart of many samples.
//!
//! Slurm is replaced by its model, which answers in Slurm's formats; the time that the model takes
//! to answer is not counted. Everything else is as in a run: the store, the job folders with the
//! drivers' claims, the attempts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use cardiotwin_engine::dispatch::{
    DispatchError, Executor, Found, News, Order, claim_of_this_process,
};
use cardiotwin_engine::{
    DriverPlace, EngineError, Reader, RunOptions, StopSignal, Surroundings, drive_job, run,
    run_on_cluster,
};
use cardiotwin_protocol::claim;
use cardiotwin_schemas::ids::{AttemptId, ExternalId, PatientId};
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings, SlurmSettings};
use cardiotwin_schemas::task::{NoopSpec, TaskSpec};
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm_model::{Behaviour, Model, Settings};
use serde::Serialize;
use tokio::sync::Notify;

/// Options of the benchmark of a cluster.
#[derive(Debug, Clone)]
pub struct ClusterBenchOptions {
    /// Folder in which the runs are made; must be empty or absent.
    pub folder: PathBuf,
    /// Number of live jobs, half of which run.
    pub jobs: usize,
    /// Number of samples, each a task of its own.
    pub samples: usize,
}

/// Results of the benchmark of a cluster.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClusterBenchResult {
    /// Number of live jobs.
    pub jobs: usize,
    /// Cost of the tick that placed and submitted them.
    pub submit: TickCost,
    /// Cost of the tick that saw half of them begin, each with a begun task.
    pub news: TickCost,
    /// Cost of a tick in which nothing had happened, the slowest of five.
    pub quiet: TickCost,
    /// Cost of the tick that saw one in a hundred of the running jobs fail and submitted them
    /// again.
    pub failures: TickCost,
    /// Number of samples of the sweep from which the next figures come.
    pub samples: usize,
    /// Coordinator's time per sample in their in-process run, µs.
    pub us_per_sample: f64,
    /// Time to read one screen of their status (all counted, the first 60 rows read), best of five,
    /// ms.
    pub status_ms: f64,
    /// Time to read the status of all samples and write it as JSON, best of five, ms.
    pub status_json_ms: f64,
    /// Time from the start of a coordinator to its first commit, with all samples loaded, s.
    pub restart_s: f64,
}

/// Cost of a tick.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct TickCost {
    /// Coordinator's time for opening the store, observing, deciding, committing and closing it,
    /// ms.
    pub ours_ms: f64,
    /// Number of commands run, by program.
    pub commands: BTreeMap<&'static str, u32>,
}

/// Measures ticks over the jobs, then the run, the status and the restart of the samples.
///
/// # Errors
/// [`EngineError`] if a tick or a run fails.
pub async fn measure_cluster(
    options: &ClusterBenchOptions,
) -> Result<ClusterBenchResult, EngineError> {
    let stand = Stand::new(options)?;
    let submit = stand.tick().await?;
    // Drivers of the started jobs: each claims its place and begins its first task.
    stand.model().advance(3);
    stand.begin_all().await?;
    let news = stand.tick().await?;
    let mut quiet = TickCost::default();
    for _ in 0..5 {
        let cost = stand.tick().await?;
        if cost.ours_ms > quiet.ours_ms {
            quiet = cost;
        }
    }
    stand.fail_some();
    let failures = stand.tick().await?;

    let run_dir = options.folder.join("samples");
    let samples = samples(&run_dir, options.samples);
    let began = Instant::now();
    drive(&samples, StopSignal::new()).await?;
    let us_per_sample = began.elapsed().as_secs_f64() * 1e6 / options.samples.max(1) as f64;
    let (mut status_ms, mut status_json_ms) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..5 {
        let began = Instant::now();
        let status = Reader::open(&run_dir).await?.screen(60).await?;
        status_ms = status_ms.min(began.elapsed().as_secs_f64() * 1e3);
        assert_eq!(
            status.counts.values().sum::<u64>(),
            options.samples as u64,
            "a screen counts every sample"
        );
        let began = Instant::now();
        let status = Reader::open(&run_dir).await?.status().await?;
        let text = serde_json::to_string(&status).expect("a status is JSON");
        status_json_ms = status_json_ms.min(began.elapsed().as_secs_f64() * 1e3);
        assert!(
            text.len() > status.patients.len(),
            "a status names every sample"
        );
    }
    // The run is asked to stop before it begins, so only its start-up and shutdown are measured.
    let stop = StopSignal::new();
    stop.ask();
    stop.ask();
    let began = Instant::now();
    drive(&samples, stop).await?;
    let restart_s = began.elapsed().as_secs_f64();
    Ok(ClusterBenchResult {
        jobs: options.jobs,
        submit,
        news,
        quiet,
        failures,
        samples: options.samples,
        us_per_sample,
        status_ms,
        status_json_ms,
        restart_s,
    })
}

async fn drive(options: &RunOptions, stop: StopSignal) -> Result<(), EngineError> {
    let (events, _) = tokio::sync::mpsc::unbounded_channel();
    run(options.clone(), events, stop).await.map(drop)
}

fn samples(run_dir: &Path, n: usize) -> RunOptions {
    let sample = |i: usize| {
        let task = TaskSpec::Noop(NoopSpec {
            label: format!("sample {i}"),
            sleep_ms: 0,
        });
        ResolvedPatient::without_data(
            PatientId::from(format!("S{i:06}").as_str()),
            Workflow::Task {
                task: Box::new(task),
            },
        )
    };
    RunOptions {
        patients: Some((1..=n).map(sample).collect()),
        ..options_of(
            run_dir,
            ExecutorSettings {
                kind: ExecutorKind::InProcess,
                ..ExecutorSettings::default()
            },
        )
    }
}

fn options_of(run_dir: &Path, executor: ExecutorSettings) -> RunOptions {
    RunOptions {
        run_dir: run_dir.to_owned(),
        chosen: None,
        cohort_name: "bench".into(),
        description: "no-op tasks".into(),
        cohort_dir: run_dir.to_owned(),
        patients: None,
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        executor,
        worker: None,
        adopt_version: true,
        watch: false,
    }
}

/// Profile that allows only single jobs of one core, since job arrays would make the ticks too
/// cheap.
const SITE: &str = "name = \"model\"\ndescription = \"a model of Slurm\"\nscheduler = \"slurm\"\n\
                    node = { cores = 1, memory_mib = 4000, unit = \"core\" }\narrays = { allowed = false }\n\
                    [[queue]]\nname = \"q\"\nqos = \"normal\"\nuses = [\"chunks\", \"simulations\"]\nwalltime = \"24:00:00\"\n";

/// A run on the model of Slurm.
struct Stand {
    options: RunOptions,
    slurm: Modelled,
}

impl Stand {
    fn new(options: &ClusterBenchOptions) -> Result<Self, EngineError> {
        let file = |what, path: &Path| {
            let path = path.to_owned();
            move |source| EngineError::File { what, path, source }
        };
        std::fs::create_dir_all(&options.folder).map_err(file("make", &options.folder))?;
        let site = options.folder.join("site.toml");
        std::fs::write(&site, SITE).map_err(file("write", &site))?;
        let n_nodes = u32::try_from(options.jobs / 2).unwrap_or(u32::MAX);
        let behaviour = Behaviour {
            seconds: i64::MAX / 2_000_000,
            code: 0,
            signal: 0,
        };
        let model = Model::new(Settings {
            n_nodes,
            behaviour,
            ..Settings::default()
        });
        let slurm = SlurmSettings {
            site: site.to_string_lossy().into_owned(),
            job_s: 1,
            ..SlurmSettings::default()
        };
        let executor = ExecutorSettings {
            kind: ExecutorKind::Slurm,
            slurm,
            ..ExecutorSettings::default()
        };
        let patients = (1..=options.jobs)
            .map(|n| ResolvedPatient::noop(&format!("N{n:05}"), 3_600_000))
            .collect();
        Ok(Self {
            options: RunOptions {
                patients: Some(patients),
                ..options_of(&options.folder.join("jobs"), executor)
            },
            slurm: Modelled {
                model: Arc::new(Mutex::new(model)),
                log: Arc::default(),
            },
        })
    }

    fn model(&self) -> MutexGuard<'_, Model> {
        self.slurm
            .model
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    async fn tick(&self) -> Result<TickCost, EngineError> {
        let (events, _) = tokio::sync::mpsc::unbounded_channel();
        *self
            .slurm
            .log
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = Log::default();
        let nowhere = (PathBuf::from("/worker"), PathBuf::from("/cardiotwin"));
        let options = self.options.clone();
        let began = Instant::now();
        let slurm = self.slurm.clone();
        let (surroundings, stop) = (Surroundings::default(), StopSignal::new());
        run_on_cluster(options, slurm, nowhere, surroundings, events, stop).await?;
        let log = std::mem::take(
            &mut *self
                .slurm
                .log
                .lock()
                .unwrap_or_else(PoisonError::into_inner),
        );
        let ours = began.elapsed().saturating_sub(log.spent);
        Ok(TickCost {
            ours_ms: ours.as_secs_f64() * 1e3,
            commands: log.asked,
        })
    }

    /// Runs the driver of each started job up to the moment when it works at its first task.
    async fn begin_all(&self) -> Result<(), EngineError> {
        let runs = self.model().runs().to_vec();
        for (n, run) in runs.into_iter().enumerate() {
            let place = DriverPlace {
                folder: self.options.run_dir.join("slurm").join(&run.name),
                element: run.element.unwrap_or(0),
                node: 0,
                id: Some((n + 1).to_string()),
                hosts: Vec::new(),
                leave_at_ms: None,
            };
            let begun = Arc::new(Notify::new());
            let executor = |_: &_| AtWork {
                begun: Arc::clone(&begun),
                holds: false,
            };
            tokio::select! {
                biased;
                end = drive_job(&place, executor, StopSignal::new(), || false, Surroundings::default()) => drop(end?),
                () = begun.notified() => {}
            }
        }
        Ok(())
    }

    /// Lets every 50th running job end with exit code 1 without a final record of its driver.
    fn fail_some(&self) {
        let mut model = self.model();
        let names: Vec<String> = model
            .runs()
            .iter()
            .step_by(50)
            .map(|run| run.name.clone())
            .collect();
        for name in names {
            model.behaviours.insert(
                name,
                Behaviour {
                    seconds: 1,
                    code: 1,
                    signal: 0,
                },
            );
        }
        model.advance(5); // long enough for accounting to list them as well
    }
}

/// Commands that were asked, and the time that the model took to answer them.
#[derive(Debug, Default)]
struct Log {
    asked: BTreeMap<&'static str, u32>,
    spent: Duration,
}

/// The model of Slurm, with a log of its commands and of its own time.
#[derive(Debug, Clone)]
struct Modelled {
    model: Arc<Mutex<Model>>,
    log: Arc<Mutex<Log>>,
}

impl Scheduler for Modelled {
    async fn ask(&mut self, command: &Command) -> Output {
        let began = Instant::now();
        let output = match command.program {
            // The model has no configuration to report, so these answers are empty.
            "scontrol" | "sacctmgr" => Output {
                exit: Exit::Code(0),
                stdout: String::new(),
                stderr: String::new(),
            },
            _ => {
                let mut model = self.model.lock().unwrap_or_else(PoisonError::into_inner);
                model.answer(command, |path| std::fs::read_to_string(path).ok(), None)
            }
        };
        let mut log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        log.spent += began.elapsed();
        *log.asked.entry(command.program).or_default() += 1;
        output
    }
}

/// A worker that keeps working and never ends.
struct AtWork {
    begun: Arc<Notify>,
    holds: bool,
}

impl Executor for AtWork {
    fn kind(&self) -> &'static str {
        "at-work"
    }

    fn free(&self) -> usize {
        usize::from(!self.holds)
    }

    async fn submit(&mut self, order: Order) -> Result<ExternalId, DispatchError> {
        let by = claim_of_this_process();
        claim::take(&order.directory, &by).map_err(|source| DispatchError::File {
            what: "claim",
            path: order.directory,
            source,
        })?;
        self.holds = true;
        self.begun.notify_one();
        Ok(ExternalId::from("1"))
    }

    fn adopt(&mut self, _: &AttemptId, _: &Path) -> Result<Found, DispatchError> {
        Ok(Found::Unclaimed)
    }

    fn stop(&mut self, _: &AttemptId, _: &Path, _: bool) -> Result<bool, DispatchError> {
        Ok(false)
    }

    async fn news(&mut self) -> Vec<News> {
        std::future::pending().await
    }
}
