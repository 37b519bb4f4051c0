//! The engine: observe, decide, commit, act. A resumed run uses the same loop, because memory holds
//! nothing of importance that the store and the attempt directories lack.
//!
//! [`run`] drives a cohort. [`rerun`], [`retry`] and [`cancel`] request a change: the coordinator
//! that holds the run applies it, or else it is applied at once. It takes effect at the next
//! [`run`].

use std::io;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::SettingsLayer;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings};
use cardiotwin_schemas::status::RefusedPatient;
use cardiotwin_slurm::access::{Installed, Scheduler};
use cardiotwin_store::chosen::CHOSEN;
use cardiotwin_store::lease::Lease;
use cardiotwin_store::lock::RunLock;
use cardiotwin_store::outbox::Action;
use cardiotwin_store::patients::REFUSED;
use cardiotwin_store::seen::{SEEN, SeenInputs};
use cardiotwin_store::{Extent, Patience, Writer};

pub use cardiotwin_workflow::patient::{Stage, Step};
pub use cardiotwin_workflow::task::Task;

use books::Books;
use cluster::Cluster;
use decider::Decider;
use dispatch::{Executor, InProcess, Launcher, Local};
use local_loop::LocalLoop;
use requests::Request;

mod books;
mod cluster;
mod cores;
mod crash;
mod decider;
pub mod dispatch;
mod error;
mod events;
mod files_seen;
mod foresee;
mod housekeeping;
mod in_job_loop;
mod local_loop;
mod locked;
mod mesh_size;
mod notices;
mod overlay;
mod program_identity;
mod programs;
mod requests;
mod settings;
mod stop;
mod surroundings;
#[cfg(test)]
mod tests;
mod turn;
mod verify;
mod watch;
mod worker_identity;

pub use books::ATTEMPTS;
pub use cardiotwin_slurm::commands::without_effect;
pub use cardiotwin_slurm::script::HOSTS;
pub use cardiotwin_store::clock;
pub use cardiotwin_store::file_system::shared as shared_file_system;
pub use cardiotwin_store::lock::{LockError, LockHolder};
pub use cardiotwin_store::seen;
pub use cardiotwin_store::{
    AttemptRecord, Chosen, ElementCost, EventRecord, JobCosts, JobRecord, LeafChange, MemberRecord,
    Pace, Reader, StepExplanation, StoreError, leaf_changes,
};
pub use cardiotwin_store::{back_up, try_locks};
pub use cardiotwin_workflow::cell_fit::contraction;
pub use cluster::{
    DiskNeed, JobUsage, NoQueue, PlannedRow, PlannedRun, QueueReport, SiteReport, examine_site,
    load_site, preview, usage_of, without_queue,
};
pub use error::EngineError;
pub use events::{EngineEvent, EventSender, PatientEnding, RunSummary};
pub use foresee::{Foreseen, foresee};
pub use housekeeping::{Archived, Class, Cleaned, DiskUsage, Usage, archive, clean, disk_usage};
pub use in_job_loop::{DriverPlace, drive_here, drive_job};
pub use notices::tell;
pub use program_identity::of_this_program;
pub use programs::first_line;
pub use settings::first_stage;
pub use stop::{StopLevel, StopSignal};
pub use surroundings::Surroundings;
pub use verify::{FileState, Verified, VerifiedFile, verify};

/// Options of a run.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Directory of database, attempts and results; created if absent.
    pub run_dir: PathBuf,
    /// Short name of the cohort.
    pub cohort_name: String,
    /// Description of the cohort in one sentence.
    pub description: String,
    /// Directory of the cohort's files.
    pub cohort_dir: PathBuf,
    /// All patients of the cohort, in its order, without the unchanged ones. `None` continues with
    /// the plans in the store.
    pub patients: Option<Vec<ResolvedPatient>>,
    /// Patients of the cohort that were recognised without being read.
    pub recognised: Recognised,
    /// Patients of the cohort whose files have errors. Their jobs are followed and their results
    /// stay, but no task of them begins.
    pub refused: Vec<RefusedPatient>,
    /// Patients to work on; empty means all.
    pub only: Vec<PatientId>,
    /// Choice that the run keeps; `None` leaves the one that is kept.
    pub chosen: Option<Chosen>,
    /// Executor, number of workers and further settings of the execution.
    pub executor: ExecutorSettings,
    /// Path of the worker's executable; `None` means `cardiotwin-worker` next to this program.
    pub worker: Option<PathBuf>,
    /// Whether to continue with this worker although the run began with another.
    pub adopt_version: bool,
    /// On a cluster: whether to keep ticking until everything is over, instead of one tick.
    pub watch: bool,
}

/// Patients whose files are as an earlier run saw them.
#[derive(Debug, Clone, Default)]
pub struct Recognised {
    /// Their positions among all patients with a plan, ascending, and their names.
    pub unchanged: Vec<(usize, PatientId)>,
    /// Revision of the store with which they were compared.
    pub revision: String,
    /// Marks of all patients for the next run; `None` keeps those in the store.
    pub marks: Option<SeenInputs>,
}

impl Recognised {
    /// Whether the stored plan of each unchanged patient is still the one that its files gave.
    fn fits(&self, books: &Books) -> bool {
        let marks = self.marks.as_ref().map(|SeenInputs(marks)| marks);
        self.unchanged.iter().all(|(_, id)| {
            let stored = books.by_name(id.as_str()).map(|i| books.patient(i));
            let given = marks.and_then(|marks| marks.get(id.as_str()));
            stored.zip(given).is_some_and(|(stored, of)| {
                sha256_hex(stored.plan_row.given.as_bytes()) == of.given
            })
        })
    }
}

/// Result of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// The change was applied; `run` continues with it.
    Applied {
        /// Effects, one line each, for a person.
        changes: Vec<String>,
        /// Reasons why some of several requests were left out.
        refused: Vec<String>,
    },
    /// A running coordinator was asked to apply the change.
    Asked {
        /// Process that holds the run.
        holder: LockHolder,
    },
}

/// Drives a cohort until every patient is over or `stop` is raised.
///
/// Opens (or creates) the run directory, takes its lock and adopts the attempts of an earlier
/// coordinator. It then observes, decides, commits and acts until nothing is left. Published tasks
/// are never computed again; changed inputs or settings lead to other tasks, and only these are
/// computed. Another call continues the run.
///
/// # Errors
/// [`EngineError`] if another coordinator holds the run, the store or a file system fails, or a
/// state is impossible. A failed task is not an error but part of the summary.
pub async fn run(
    options: RunOptions,
    events: EventSender,
    stop: StopSignal,
) -> Result<RunSummary, EngineError> {
    if options.executor.kind == ExecutorKind::Slurm {
        let (_lock, lease, run_dir) = enter_with_lease(&options.run_dir)?;
        let worker = find_worker(options.worker.as_deref())?;
        // The launcher itself may exist only on the nodes, or come with a module of the job.
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
            drive(
                options,
                &run_dir,
                Some(&worker),
                local,
                Surroundings::of_this_process(),
                events,
                stop,
            )
            .await
        }
        // As many tasks as fit in a commit, because there is no process to wait for.
        ExecutorKind::InProcess => {
            let in_process = InProcess::new(4096);
            let surroundings = Surroundings::of_this_process();
            drive(
                options,
                &run_dir,
                None,
                in_process,
                surroundings,
                events,
                stop,
            )
            .await
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
    surroundings: Surroundings,
    events: EventSender,
    stop: StopSignal,
) -> Result<RunSummary, EngineError> {
    let patience = locked::until_stopped(&events, &stop);
    let (mut writer, mut books, decider) = open(&options, run_dir, patience, &surroundings).await?;
    let mut refused = None;
    if let Some(worker) = worker {
        refused = worker_identity::keep(&mut writer, &books, worker, options.adopt_version).await?;
    }
    if !books.jobs().rows().is_empty() {
        let jobs = books
            .jobs()
            .rows()
            .values()
            .map(|row| row.spec.elements.len())
            .sum::<usize>();
        return Err(EngineError::OnCluster {
            jobs: format!("{jobs} jobs"),
        });
    }
    let pid = std::process::id().to_string();
    let host = cardiotwin_store::lock::host_name();
    let allocation = writer
        .open_allocation(executor.kind(), &pid, &host, books.now_ms())
        .await?;
    books.set_allocation(allocation);
    LocalLoop::new(
        (writer, books, decider),
        refused,
        executor,
        options.executor,
        surroundings,
        events,
        stop,
    )
    .run()
    .await
}

/// As [`run`] on a cluster whose scheduler is `scheduler`. `programs` are the paths of worker and
/// driver, which need not exist.
///
/// # Errors
/// As [`run`].
pub async fn run_on_cluster<S: Scheduler>(
    options: RunOptions,
    scheduler: S,
    programs: (PathBuf, PathBuf),
    surroundings: Surroundings,
    events: EventSender,
    stop: StopSignal,
) -> Result<RunSummary, EngineError> {
    let (_lock, lease, run_dir) = enter_with_lease(&options.run_dir)?;
    let entered = (run_dir, lease);
    tick(
        options,
        entered,
        scheduler,
        programs,
        surroundings,
        events,
        stop,
    )
    .await
}

/// Runs one tick on a cluster, or ticks until the run is over. `programs` are the paths of worker
/// and driver.
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
    let patience = match options.watch {
        true => locked::until_stopped(&events, &stop),
        false => Patience::default(),
    };
    let mut opened = open(&options, &run_dir, patience, &surroundings).await?;
    opened.0.under(lease);
    let (writer, books, _) = &mut opened;
    let refused = worker_identity::keep(writer, books, &programs.0, options.adopt_version).await?;
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
    cluster.begin(refused).await?;
    if options.watch {
        cluster.watch(&stop).await?;
    } else {
        cluster.tick().await?;
    }
    let summary = cluster.summary(began, stop.level() > StopLevel::Run);
    cluster.close().await?;
    Ok(summary)
}

/// Ends jobs whose patients are not wanted any more, and waits until they have ended: `scancel`
/// alone is only a request.
///
/// # Errors
/// Any [`EngineError`]; what was committed before stays committed.
pub async fn end_unwanted_jobs(run_dir: &Path, stop: StopSignal) -> Result<bool, EngineError> {
    let (_lock, lease, run_dir) = enter_with_lease(run_dir)?;
    let options = RunOptions {
        run_dir: run_dir.clone(),
        cohort_name: String::new(),
        description: String::new(),
        cohort_dir: PathBuf::new(),
        patients: None,
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        chosen: None,
        executor: ExecutorSettings::default(),
        worker: None,
        adopt_version: true,
        watch: false,
    };
    let surroundings = Surroundings::of_this_process();
    let mut opened = open(&options, &run_dir, Patience::default(), &surroundings).await?;
    // No patient is selected, so that only ends of jobs are taken up.
    opened.0.under(lease);
    opened.1.select(|_| false);
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
    cluster.begin(None).await?;
    let is_over = cluster.end_jobs(&stop).await?;
    cluster.close().await?;
    Ok(is_over)
}

/// Store, mirror and decider of a run, with the cohort's plans taken up.
async fn open(
    options: &RunOptions,
    run_dir: &Path,
    patience: Patience,
    surroundings: &Surroundings,
) -> Result<(Writer, Books, Decider), EngineError> {
    let passed = |place: &str| surroundings.crash.pass(place).map_err(io::Error::other);
    let mut writer = Writer::open_past(run_dir, patience, &passed)
        .await
        .map_err(EngineError::of_opening)?;
    writer.lies_in(run_dir).await?;
    let now_ms = surroundings.clock.now_ms();
    let mut books = Books::new(run_dir, writer.load(Extent::States).await?, now_ms)?;
    let mut decider = Decider::new(options.executor.site_retries);
    let cohort_dir = options.cohort_dir.to_string_lossy();
    if let Some(plans) = &options.patients {
        let refused = serde_json::to_string(&options.refused).expect("texts are JSON");
        writer
            .set_meta(&[
                ("cohort", options.cohort_name.as_str()),
                ("description", options.description.as_str()),
                ("cohort_dir", &cohort_dir),
                (REFUSED, &refused),
            ])
            .await?;
        if let Some(chosen) = &options.chosen {
            let chosen = serde_json::to_string(chosen).expect("texts and settings are JSON");
            writer.set_meta(&[(CHOSEN, &chosen)]).await?;
        }
        let recognised = &options.recognised;
        if !recognised.unchanged.is_empty()
            && writer.revision().await? != recognised.revision
            && !recognised.fits(&books)
        {
            return Err(EngineError::Request {
                message: "another command changed the run while the input was compared with it: \
                          give the command again"
                    .to_owned(),
            });
        }
        if let Some(marks) = &recognised.marks {
            let marks = serde_json::to_string(marks).expect("texts are JSON");
            writer.set_meta(&[(SEEN, &marks)]).await?;
        }
        decider.take_up(&mut books, plans, &recognised.unchanged, &options.refused)?;
    }
    let only = &options.only;
    let is_refused = |patient: &str| options.refused.iter().any(|one| one.patient == patient);
    books.select(|patient| {
        let is_wanted = only.is_empty() || only.iter().any(|id| id.as_str() == patient);
        is_wanted && !is_refused(patient)
    });
    decider.count(&books);
    Ok((writer, books, decider))
}

/// Creates and locks the run directory. Returns its absolute path.
fn enter(run_dir: &Path) -> Result<(RunLock, PathBuf), EngineError> {
    let file = |what| {
        move |source| EngineError::File {
            what,
            path: run_dir.to_owned(),
            source,
        }
    };
    std::fs::create_dir_all(run_dir).map_err(file("create"))?;
    let run_dir = std::path::absolute(run_dir).map_err(file("find"))?;
    Ok((RunLock::acquire(&run_dir)?, run_dir))
}

/// As [`enter`], but also takes a lease, which holds among hosts that share the run's file system.
/// The file system need not support locks.
fn enter_with_lease(run_dir: &Path) -> Result<(Option<RunLock>, Lease, PathBuf), EngineError> {
    let file = |what| {
        move |source| EngineError::File {
            what,
            path: run_dir.to_owned(),
            source,
        }
    };
    std::fs::create_dir_all(run_dir).map_err(file("create"))?;
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

/// Path of the worker's executable: the named one, or else the one next to this program.
///
/// # Errors
/// [`EngineError::NoWorker`] if the file does not exist.
pub fn find_worker(named: Option<&Path>) -> Result<PathBuf, EngineError> {
    let path = match named {
        Some(path) => path.to_owned(),
        None => {
            let own = std::env::current_exe().unwrap_or_else(|_| PathBuf::from("."));
            own.with_file_name("cardiotwin-worker")
        }
    };
    // The path is absolute because workers are started in other directories.
    let path = std::path::absolute(&path).unwrap_or(path);
    if path.is_file() {
        Ok(path)
    } else {
        Err(EngineError::NoWorker { path })
    }
}

/// The launcher of MPI ranks, if one is set. The program of the ranks is next to the worker.
fn find_launcher(command: &[String], worker: &Path) -> Result<Option<Launcher>, EngineError> {
    let Some(launcher) = Launcher::beside(command, worker) else {
        return Ok(None);
    };
    let program = launcher.program();
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let is_found = match Path::new(program) {
        path if path.components().count() > 1 => path.is_file(),
        name => std::env::split_paths(&folders).any(|folder| folder.join(name).is_file()),
    };
    if !is_found {
        return Err(EngineError::NoLauncher {
            program: program.to_owned(),
        });
    }
    is_built(&launcher)?;
    Ok(Some(launcher))
}

fn is_built(launcher: &Launcher) -> Result<(), EngineError> {
    let path = launcher.worker.clone();
    if path.is_file() {
        Ok(())
    } else {
        Err(EngineError::NoMpiWorker { path })
    }
}

/// Changes settings of a patient from a stage on. Step 1 continues from its stored iterations
/// without repeating them.
///
/// `overrides` has the tables of `cohort.toml`. They override every other layer and stay until
/// another rerun changes them.
///
/// # Errors
/// [`EngineError::Request`] for an unknown patient, or a stage or setting that makes no sense;
/// [`StoreError`] in [`EngineError::Store`].
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

/// Opens the failed tasks of a patient for another attempt with the same settings. A cancelled
/// patient continues.
///
/// # Errors
/// [`EngineError::Request`] if nothing failed; [`StoreError`] in [`EngineError::Store`].
pub async fn retry(run_dir: &Path, patient: &PatientId) -> Result<Answer, EngineError> {
    retry_all(run_dir, std::slice::from_ref(patient)).await
}

/// [`retry`] for several patients, in one commit. A patient that cannot be retried is left out and
/// told.
///
/// # Errors
/// As [`retry`], for a single patient; [`StoreError`] in [`EngineError::Store`].
pub async fn retry_all(run_dir: &Path, patients: &[PatientId]) -> Result<Answer, EngineError> {
    let requests: Vec<Request> = patients
        .iter()
        .map(|patient| Request::Retry {
            patient: patient.clone(),
        })
        .collect();
    ask(run_dir, &requests).await
}

/// Cancels a patient, or all patients with `None`. Published results stay.
///
/// # Errors
/// [`EngineError::Request`] for an unknown patient; [`StoreError`] in [`EngineError::Store`].
pub async fn cancel(run_dir: &Path, patient: Option<&PatientId>) -> Result<Answer, EngineError> {
    ask(
        run_dir,
        &[Request::Cancel {
            patient: patient.cloned(),
        }],
    )
    .await
}

/// Applies changes if no coordinator runs, and else passes them to the running one.
async fn ask(run_dir: &Path, requests: &[Request]) -> Result<Answer, EngineError> {
    // A missing run or an unknown patient is reported at once, whichever process would apply the
    // change.
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
    let mut books = Books::new(&run_dir, writer.load(Extent::All).await?, clock::now_ms())?;
    for i in 0..books.patients().len() {
        books.await_present_task(i);
    }
    let mut decider = Decider::default();
    let (mut changes, mut refused) = (Vec::new(), Vec::new());
    for request in requests {
        match decider.request(&mut books, request) {
            Ok(made) => changes.extend(made),
            // One of many changes nothing for the others.
            Err(EngineError::Request { message }) if requests.len() > 1 => refused.push(message),
            Err(error) => return Err(error),
        }
    }
    decider.look_and_answer(&mut books)?;
    writer.commit(&mut books.flush()).await?;
    // Workers that outlived their coordinator and are not wanted any more are ended now, not at the
    // next run.
    let mut local = Local::new(PathBuf::new(), 0);
    for (_, action) in books.outbox() {
        if let Action::Stop { attempt } = action {
            let directory = books.directory(attempt);
            local.adopt(attempt, &directory)?;
            local.stop(attempt, &directory, true)?;
        }
    }
    writer.close("none", clock::now_ms()).await?;
    Ok(Answer::Applied { changes, refused })
}
