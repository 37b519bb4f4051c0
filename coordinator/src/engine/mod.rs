//! The loop: observe, decide, commit, act. Resume is this same loop: nothing in memory matters that the store and the
//! attempt directories do not hold.
//!
//! [`run`] drives a cohort; [`rerun`], [`retry`] and [`cancel`] ask for a change, which the coordinator that holds the
//! run takes up, or which is made at once where none runs. What is asked for takes effect at the next [`run`].

use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};

pub use cardiotwin_workflow::patient::Stage;

use crate::clock::{self, Clock};
use crate::dispatch::slurm::{Installed, Scheduler};
use crate::dispatch::{self, Executor, InProcess, Launcher, Local};
use crate::store::Writer;
use crate::store::lease::Lease;
use crate::store::lock::RunLock;
use crate::store::outbox::Action;
use cluster::{Cluster, load_site};
use local_loop::LocalLoop;
use requests::Request;
use surroundings::Surroundings;
use transitions::Decider;
use world::World;

mod act;
mod apply_requests;
mod book_rows;
mod cluster;
mod cores;
mod crash;
mod error;
mod events;
mod foresee;
mod housekeeping;
mod in_job_loop;
mod job_book;
mod local_loop;
mod notices;
mod overlay;
mod program_identity;
mod programs;
mod purged;
mod requests;
mod settings;
mod show;
mod shutdown;
mod stop;
mod surroundings;
#[cfg(test)]
mod tests;
mod transitions;
mod watch;
mod worker_identity;
mod world;
mod world_jobs;

pub use crate::store::file_system::shared as shared_file_system;
pub use crate::store::lock::{LockError, LockHolder};
pub use crate::store::{
    AttemptRecord, EventRecord, JobRecord, LeafChange, MemberRecord, Reader, StepExplanation,
    StoreError,
};
pub use crate::store::{back_up, try_locks};
pub use cardiotwin_workflow::cell_fit::contraction;
#[cfg(feature = "dev")]
pub use cluster::{ClusterBenchOptions, ClusterBenchResult, TickCost, measure_cluster};
pub use cluster::{
    DiskNeed, PlannedRow, PlannedRun, QueueReport, SiteReport, examine_site, preview,
};
pub use error::EngineError;
pub use events::{EngineEvent, EventSender, PatientEnding, RunSummary};
pub use foresee::{Foreseen, foresee};
pub use housekeeping::{Archived, Class, Cleaned, DiskUsage, Usage, archive, clean, disk_usage};
pub use in_job_loop::{DriverPlace, drive_here};
pub use notices::tell;
pub use programs::first_line;
pub use stop::{StopLevel, StopSignal};
pub use world::ATTEMPTS;

/// What to run, where and how.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Directory of database, attempts and results; made if absent.
    pub run_dir: PathBuf,
    /// Short name of the cohort.
    pub cohort_name: String,
    /// One sentence.
    pub description: String,
    /// Where the cohort's files lie.
    pub cohort_dir: PathBuf,
    /// All patients of the cohort, in its order. `None`: go on with what the store holds.
    pub patients: Option<Vec<ResolvedPatient>>,
    /// Work on these only; empty: on all.
    pub only: Vec<PatientId>,
    /// Where tasks run and how many at once.
    pub executor: ExecutorSettings,
    /// The worker's executable; `None`: `cardiotwin-worker` beside our own.
    pub worker: Option<PathBuf>,
    /// Go on with this worker, though the run began with another.
    pub adopt_version: bool,
    /// With a cluster: stay and tick until everything is over; else one tick.
    pub watch: bool,
}

/// What became of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// It was made; say `run` to go on.
    Applied {
        /// What changed, for a person, a line each.
        changes: Vec<String>,
    },
    /// A coordinator runs and was asked to make it.
    Asked {
        /// Which.
        holder: LockHolder,
    },
}

/// Drives a cohort until every patient is over or `stop` is raised.
///
/// Opens (or makes) the run directory, takes its lock, adopts what an earlier coordinator left, then observes, decides,
/// commits and acts until nothing is left. What was published is never done again; changed inputs or settings lead to
/// other tasks, and only these are done. Calling it again continues.
///
/// # Errors
/// [`EngineError`]: another coordinator holds the run, the store or a file system fails, a state is impossible. Never
/// because of what a task did: that is in the summary.
pub async fn run(
    options: RunOptions,
    events: EventSender,
    stop: StopSignal,
) -> Result<RunSummary, EngineError> {
    if options.executor.kind == ExecutorKind::Slurm {
        let (_lock, lease, run_dir) = enter_with_lease(&options.run_dir)?;
        let worker = find_worker(options.worker.as_deref())?;
        // The launcher itself may be on the nodes alone, or come with a module of the job.
        Launcher::beside(&options.executor.launcher, &worker)
            .map_or(Ok(()), |launcher| is_built(&launcher))?;
        let program = std::env::current_exe().map_err(|source| EngineError::File {
            what: "find",
            path: "this program".into(),
            source,
        })?;
        return tick(
            options,
            (run_dir, lease),
            Installed::default(),
            (worker, program),
            Surroundings::of_this_process(),
            events,
            stop,
        )
        .await;
    }
    let (lock, run_dir) = enter(&options.run_dir)?;
    let workers = cores::workers(&options.executor);
    let summary = match options.executor.kind {
        ExecutorKind::Local => {
            let worker = find_worker(options.worker.as_deref())?;
            let launcher = find_launcher(&options.executor.launcher, &worker)?;
            let local = Local::new(worker.clone(), workers).with_launcher(launcher);
            drive(options, &run_dir, Some(&worker), local, events, stop).await
        }
        // As many as fit in a commit: there is no process to wait for.
        ExecutorKind::InProcess => {
            drive(options, &run_dir, None, InProcess::new(4096), events, stop).await
        }
        ExecutorKind::Slurm => unreachable!("taken above"),
    };
    drop(lock);
    summary
}

async fn drive<E: Executor>(
    options: RunOptions,
    run_dir: &Path,
    worker: Option<&Path>,
    executor: E,
    events: EventSender,
    stop: StopSignal,
) -> Result<RunSummary, EngineError> {
    let surroundings = Surroundings::of_this_process();
    let (mut writer, mut world, decider) = open(&options, run_dir, &surroundings.clock).await?;
    if let Some(worker) = worker {
        let kept =
            worker_identity::keep(&mut writer, &world, worker, options.adopt_version).await?;
        world.refused_worker = kept;
    }
    if !world.jobs.rows.is_empty() {
        let jobs = world
            .jobs
            .rows
            .values()
            .map(|row| row.spec.elements.len())
            .sum::<usize>();
        return Err(EngineError::OnCluster {
            jobs: format!("{jobs} jobs"),
        });
    }
    let pid = std::process::id().to_string();
    let host = crate::store::lock::host_name();
    world.allocation = writer
        .open_allocation(executor.kind(), &pid, &host, world.now_ms)
        .await?;
    LocalLoop::new(
        (writer, world, decider),
        executor,
        options.executor,
        surroundings,
        events,
        stop,
    )
    .run()
    .await
}

/// A run on a cluster: one tick, or ticks until it is over. `programs` are worker and driver.
async fn tick<S: Scheduler>(
    options: RunOptions,
    (run_dir, lease): (PathBuf, Lease),
    scheduler: S,
    programs: (PathBuf, PathBuf),
    surroundings: Surroundings,
    events: EventSender,
    stop: StopSignal,
) -> Result<RunSummary, EngineError> {
    let began = std::time::Instant::now();
    let site = load_site(&options.executor.slurm)?;
    let mut opened = open(&options, &run_dir, &surroundings.clock).await?;
    opened.0.under(lease);
    let (writer, world, _) = &mut opened;
    let kept = worker_identity::keep(writer, world, &programs.0, options.adopt_version).await?;
    world.refused_worker = kept;
    let mut cluster = Cluster::new(
        opened,
        scheduler,
        site,
        options.executor,
        programs,
        events,
        surroundings,
    )
    .await?;
    cluster.begin().await?;
    if options.watch {
        cluster.watch(&stop).await?;
    } else {
        cluster.tick().await?;
    }
    let summary = cluster.summary(began, stop.level() > StopLevel::Run);
    cluster.close().await?;
    Ok(summary)
}

/// Ends jobs of patients that nobody works on any more, and waits for the truth: `scancel` alone is a wish.
///
/// # Errors
/// [`EngineError`]; what was committed stays.
pub async fn end_unwanted_jobs(run_dir: &Path, stop: StopSignal) -> Result<(), EngineError> {
    let (_lock, lease, run_dir) = enter_with_lease(run_dir)?;
    let options = RunOptions {
        run_dir: run_dir.clone(),
        cohort_name: String::new(),
        description: String::new(),
        cohort_dir: PathBuf::new(),
        patients: None,
        only: Vec::new(),
        executor: ExecutorSettings::default(),
        worker: None,
        adopt_version: true,
        watch: false,
    };
    let surroundings = Surroundings::of_this_process();
    let mut opened = open(&options, &run_dir, &surroundings.clock).await?;
    // Nobody is to be taken further: only ends are taken up.
    opened.0.under(lease);
    opened
        .1
        .patients
        .iter_mut()
        .for_each(|patient| patient.selected = false);
    let site = load_site(&options.executor.slurm)?;
    let (events, _) = tokio::sync::mpsc::unbounded_channel();
    let nowhere = (PathBuf::new(), PathBuf::new());
    let mut cluster = Cluster::new(
        opened,
        Installed::default(),
        site,
        options.executor,
        nowhere,
        events,
        surroundings,
    )
    .await?;
    cluster.begin().await?;
    cluster.end_jobs(&stop).await?;
    cluster.close().await
}

/// Store, mirror and decider of a run, with the cohort taken up.
async fn open(
    options: &RunOptions,
    run_dir: &Path,
    clock: &Clock,
) -> Result<(Writer, World, Decider), EngineError> {
    let mut writer = Writer::open(run_dir).await?;
    let now_ms = clock.now_ms();
    let mut world = World::new(run_dir, writer.load().await?, now_ms)?;
    let mut decider = Decider {
        site_retries: options.executor.site_retries,
        ..Decider::default()
    };
    let cohort_dir = options.cohort_dir.to_string_lossy();
    if let Some(plans) = &options.patients {
        writer
            .set_meta(&[
                ("cohort", options.cohort_name.as_str()),
                ("description", options.description.as_str()),
                ("cohort_dir", &cohort_dir),
            ])
            .await?;
        decider.take_up(&mut world, plans)?;
    }
    for patient in &mut world.patients {
        let named = options.only.is_empty()
            || options
                .only
                .iter()
                .any(|id| id.as_str() == patient.row.patient);
        patient.selected = patient.row.active && named;
    }
    decider.of = world.patients.iter().filter(|p| p.selected).count();
    decider.over = world
        .patients
        .iter()
        .filter(|p| p.selected && p.row.state.is_final())
        .count();
    Ok((writer, world, decider))
}

/// The run directory, made if need be, absolute and locked.
fn enter(run_dir: &Path) -> Result<(RunLock, PathBuf), EngineError> {
    let file = |what| {
        move |source| EngineError::File {
            what,
            path: run_dir.to_owned(),
            source,
        }
    };
    std::fs::create_dir_all(run_dir).map_err(file("make"))?;
    let run_dir = std::path::absolute(run_dir).map_err(file("find"))?;
    Ok((RunLock::acquire(&run_dir)?, run_dir))
}

/// As [`enter`], with a lease as well, which holds among hosts that share the run's file system; locks need not be known
/// to it.
fn enter_with_lease(run_dir: &Path) -> Result<(Option<RunLock>, Lease, PathBuf), EngineError> {
    let file = |what| {
        move |source| EngineError::File {
            what,
            path: run_dir.to_owned(),
            source,
        }
    };
    std::fs::create_dir_all(run_dir).map_err(file("make"))?;
    let run_dir = std::path::absolute(run_dir).map_err(file("find"))?;
    let lock = match RunLock::acquire(&run_dir) {
        Ok(lock) => Some(lock),
        Err(LockError::Io { source, .. }) if source.kind() == std::io::ErrorKind::Unsupported => {
            None
        }
        Err(error) => return Err(error.into()),
    };
    let claim = dispatch::claim_of_this_process();
    let lease = Lease::acquire(&run_dir, &claim, dispatch::lives_here, clock::now_ms())?;
    Ok((lock, lease, run_dir))
}

/// The worker's executable: as named, else beside our own.
///
/// # Errors
/// [`EngineError::NoWorker`].
pub fn find_worker(named: Option<&Path>) -> Result<PathBuf, EngineError> {
    let path = match named {
        Some(path) => path.to_owned(),
        None => {
            let own = std::env::current_exe().unwrap_or_else(|_| PathBuf::from("."));
            own.with_file_name("cardiotwin-worker")
        }
    };
    // Absolute, since workers are started from wherever we are.
    let path = std::path::absolute(&path).unwrap_or(path);
    if path.is_file() {
        Ok(path)
    } else {
        Err(EngineError::NoWorker { path })
    }
}

/// The launcher of MPI ranks, where one is set; their program lies beside the worker.
fn find_launcher(command: &[String], worker: &Path) -> Result<Option<Launcher>, EngineError> {
    let Some(program) = command.first() else {
        return Ok(None);
    };
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let is_found = match Path::new(program) {
        path if path.components().count() > 1 => path.is_file(),
        name => std::env::split_paths(&folders).any(|folder| folder.join(name).is_file()),
    };
    if !is_found {
        return Err(EngineError::NoLauncher {
            program: program.clone(),
        });
    }
    let launcher = Launcher::beside(command, worker);
    launcher.as_ref().map_or(Ok(()), is_built)?;
    Ok(launcher)
}

fn is_built(launcher: &Launcher) -> Result<(), EngineError> {
    let path = launcher.worker.clone();
    if path.is_file() {
        Ok(())
    } else {
        Err(EngineError::NoMpiWorker { path })
    }
}

/// Changes settings of a patient from a stage on; step 1 goes on from its stored iterations without repeating them.
///
/// `overrides` has the tables of `cohort.toml`, win over every other layer, and stay until changed by another rerun.
///
/// # Errors
/// [`EngineError::Request`] for an unknown patient, a stage or a setting that makes no sense; the store's errors.
pub async fn rerun(
    run_dir: &Path,
    patient: &PatientId,
    from: Stage,
    overrides: &SettingsLayer,
) -> Result<Answer, EngineError> {
    ask(
        run_dir,
        &[Request::Rerun {
            patient: patient.clone(),
            from,
            overrides: Box::new(overrides.clone()),
        }],
    )
    .await
}

/// Opens the failed tasks of a patient for another try with the same settings; a cancelled patient goes on.
///
/// # Errors
/// [`EngineError::Request`] where nothing failed; the store's errors.
pub async fn retry(run_dir: &Path, patient: &PatientId) -> Result<Answer, EngineError> {
    retry_all(run_dir, std::slice::from_ref(patient)).await
}

/// [`retry`] for several patients, in one commit.
///
/// # Errors
/// As [`retry`], and then for none of them.
pub async fn retry_all(run_dir: &Path, patients: &[PatientId]) -> Result<Answer, EngineError> {
    let requests: Vec<Request> = patients
        .iter()
        .map(|patient| Request::Retry {
            patient: patient.clone(),
        })
        .collect();
    ask(run_dir, &requests).await
}

/// Ends a patient's chain; `None`: those of all patients. What is published stays.
///
/// # Errors
/// [`EngineError::Request`] for an unknown patient; the store's errors.
pub async fn cancel(run_dir: &Path, patient: Option<&PatientId>) -> Result<Answer, EngineError> {
    ask(
        run_dir,
        &[Request::Cancel {
            patient: patient.cloned(),
        }],
    )
    .await
}

/// Makes changes where no coordinator runs, and asks the one that does.
async fn ask(run_dir: &Path, requests: &[Request]) -> Result<Answer, EngineError> {
    // A run that is not there, or no patient of that name, is said at once, whoever would make the change.
    let reader = Reader::open(run_dir).await?;
    if let [
        Request::Rerun { patient, .. }
        | Request::Retry { patient }
        | Request::Cancel {
            patient: Some(patient),
        },
    ] = requests
    {
        reader.patient_record(patient).await?;
    }
    drop(reader);
    let (_lock, lease, run_dir) = match enter_with_lease(run_dir) {
        Ok(entered) => entered,
        Err(EngineError::Lock(LockError::Held { holder, .. })) => {
            requests
                .iter()
                .try_for_each(|request| requests::put(run_dir, request))?;
            return Ok(Answer::Asked { holder });
        }
        Err(error) => return Err(error),
    };
    let mut writer = Writer::open(&run_dir).await?;
    writer.under(lease);
    let mut world = World::new(&run_dir, writer.load().await?, clock::now_ms())?;
    for i in 0..world.patients.len() {
        world.await_present_task(i);
    }
    let mut decider = Decider::default();
    let mut changes = Vec::new();
    for request in requests {
        changes.extend(decider.request(&mut world, request)?);
    }
    writer.commit(&mut world.flush()).await?;
    // Workers that outlived their coordinator and are not wanted any more are ended now, not at the next run.
    let mut local = Local::new(PathBuf::new(), 0);
    for (_, action) in &world.outbox {
        if let Action::Stop { attempt } = action {
            let directory = world.directory(attempt);
            local.adopt(attempt, &directory)?;
            local.stop(attempt, &directory, true)?;
        }
    }
    writer.close("none", clock::now_ms()).await?;
    Ok(Answer::Applied { changes })
}
