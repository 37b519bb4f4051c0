//! The driver inside an allocation: it walks patients' chains by the same decisions as the
//! coordinator, without the coordinator's database.
//!
//! A patient waits in the queue only once: the task that follows from a simulation is derived here
//! ([`evaluate`](cardiotwin_workflow::derivation::evaluate)) and begun at once. Every simulation is an attempt in a directory of
//! its own, as if the coordinator had begun it; the coordinator finds these directories and updates
//! its books from them. A task that is expected to exceed the remaining time is not begun.

mod decide;
mod job_books;

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::convert::Infallible;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cardiotwin_protocol::closing;
use cardiotwin_schemas::allocation::{
    AttemptAllocation, DriverClaim, DriverEnd, DriverEnding, JobOrder,
};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::{AttemptId, PatientId};
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use cardiotwin_slurm::access::folder::{self, JobFolder};
use cardiotwin_store::clock::utc_text;
use tokio::signal::unix::{SignalKind, signal};

use super::books::attempt_directory;
use super::surroundings::Surroundings;
use super::turn::{self, Engine};
use super::watch::Watch;
use super::{EngineError, StopLevel, StopSignal};
use crate::dispatch::{self, AttemptFindings, Executor, Launcher, Local, News, Order, Places};
use job_books::JobBooks;

/// Interval at which fence and clock are checked.
const TICK: Duration = Duration::from_millis(500);
/// Time that workers have to write their checkpoints when the job ends.
const GRACE: Duration = Duration::from_secs(60);

/// Position of a driver in its job.
#[derive(Debug, Clone)]
pub struct DriverPlace {
    /// Path of the job's folder.
    pub folder: PathBuf,
    /// Element of the array; 0 for a single job.
    pub element: u32,
    /// Number of the node within the element, from 0.
    pub node: u32,
    /// The scheduler's number of the job; `None` if it is unknown.
    pub id: Option<String>,
    /// Names of the element's nodes, for a driver that makes steps on them.
    pub hosts: Vec<String>,
    /// Time at which the driver must have left, milliseconds since 1970; `None` if there is no
    /// limit.
    pub leave_at_ms: Option<i64>,
}

/// Executes the order of a driver's place.
///
/// `warned` returns whether a stop means that the time ran out. Returns `None` if another driver
/// had claimed the place before.
///
/// # Errors
/// [`EngineError`] if the folder of the job or of an attempt cannot be read or written.
pub async fn drive_job<E: Executor>(
    place: &DriverPlace,
    executor: impl FnOnce(&JobOrder) -> E,
    stop: StopSignal,
    warned: impl Fn() -> bool,
    surroundings: Surroundings,
) -> Result<Option<DriverEnd>, EngineError> {
    let began = Instant::now();
    let folder = JobFolder::at(&place.folder);
    let order = folder.order(place.element)?;
    let claim = DriverClaim {
        job: place.id.clone(),
        claim: dispatch::claim_of_this_process(),
    };
    if !folder.claim(place.element, place.node, &claim)? {
        return Ok(None);
    }
    if let Some(steps) = order
        .steps
        .filter(|s| (s.nodes as usize) > place.hosts.len())
    {
        return Err(EngineError::Site {
            message: format!(
                "a simulation needs {} nodes, but the job has {}: {:?} (from {})",
                steps.nodes,
                place.hosts.len(),
                place.hosts,
                cardiotwin_slurm::script::HOSTS
            ),
        });
    }
    let executor = executor(&order);
    let mut driver = InJobLoop {
        ledger: JobBooks::new(&order),
        queue: (0..order.patients.len()).collect(),
        order,
        place,
        folder: folder.clone(),
        executor,
        surroundings: surroundings.clone(),
        stop,
        warned,
        is_fenced: false,
        now_ms: surroundings.clock.now_ms(),
        wanted: HashMap::new(),
        running: HashMap::new(),
        watch: Watch::default(),
        errands: Vec::new(),
        met: Vec::new(),
        has_run_errands: false,
        left: BTreeMap::new(),
        defects: BTreeSet::new(),
        leaving: None,
    };
    turn::run(&mut driver).await?;
    let end = DriverEnd {
        at: utc_text(surroundings.clock.now_ms()),
        because: driver.leaving.unwrap_or(DriverEnding::Finished),
        left: driver
            .left
            .iter()
            .map(|(&p, why)| (driver.id(p), why.clone()))
            .collect(),
        defects: driver.defects.iter().map(|&p| driver.id(p)).collect(),
        wall_s: began.elapsed().as_secs_f64(),
    };
    surroundings.crash.pass("before a driver's last word")?;
    folder.leave(place.element, place.node, &end)?;
    Ok(Some(end))
}

/// Executes the order of a job's folder with worker processes on this node. SIGUSR1 is the warning
/// before the walltime.
///
/// # Errors
/// [`EngineError`] if the folder of the job or of an attempt cannot be read or written.
pub async fn drive_here(place: &DriverPlace) -> Result<Option<DriverEnd>, EngineError> {
    let file = |source| EngineError::File {
        what: "catch signals for",
        path: place.folder.clone(),
        source,
    };
    let stop = StopSignal::from_signals().map_err(file)?;
    let warned = Arc::new(AtomicBool::new(false));
    let mut warnings = signal(SignalKind::user_defined1()).map_err(file)?;
    let (told, asks) = (Arc::clone(&warned), stop.clone());
    tokio::spawn(async move {
        while warnings.recv().await.is_some() {
            if !told.swap(true, Ordering::Relaxed) {
                asks.ask();
            }
        }
    });
    let local = |order: &JobOrder| {
        let launcher = Launcher::beside(&order.launcher, &order.worker);
        let lanes = order.lanes.max(1) as usize;
        let places = order.steps.map(|steps| {
            let memory = Some(steps.memory_mib);
            Places::on(&place.hosts, steps.nodes as usize, lanes, memory)
        });
        Local::new(order.worker.clone(), lanes)
            .with_grace(GRACE)
            .with_launcher(launcher)
            .with_places(places)
    };
    let surroundings = Surroundings::of_this_process();
    let is_warned = || warned.load(Ordering::Relaxed);
    drive_job(place, local, stop, is_warned, surroundings).await
}

/// A driver over its [`JobBooks`]. It commits nothing: what it began is found by its directories.
struct InJobLoop<'a, E, W> {
    order: JobOrder,
    place: &'a DriverPlace,
    folder: JobFolder,
    executor: E,
    surroundings: Surroundings,
    stop: StopSignal,
    /// Returns whether a stop means that the time ran out.
    warned: W,
    ledger: JobBooks,
    /// Whether the element was revoked when it was last observed.
    is_fenced: bool,
    /// Time of the last observation.
    now_ms: i64,
    /// Patients that no driver has taken yet, as far as this driver knows.
    queue: VecDeque<usize>,
    /// Attempts that are decided on and not begun.
    wanted: HashMap<AttemptId, Wanted>,
    /// Running attempts, with the patients that wait for each.
    running: HashMap<AttemptId, Vec<usize>>,
    watch: Watch,
    /// Errands of the last decision.
    errands: Vec<FileRequest>,
    /// Results of the last errands, which the next turn observes.
    met: Vec<FileAnswer>,
    /// Whether the last turn ran errands after which others may follow at once.
    has_run_errands: bool,
    left: BTreeMap<usize, String>,
    /// Patients in `left` whose worker died of a defect.
    defects: BTreeSet<usize>,
    leaving: Option<DriverEnding>,
}

/// An attempt that is to begin.
struct Wanted {
    spec: TaskSpec,
    /// Patients that wait for it.
    patients: Vec<usize>,
}

/// An errand that a decision asks for.
enum FileRequest {
    /// Take a patient of the element's list, unless another driver has it.
    Take(usize),
    /// Begin a wanted attempt, unless its directory exists.
    Begin(AttemptId),
    /// Revoke an attempt that a revoked job has begun.
    Revoke(AttemptId),
    /// Leave a note that the driver was told to stop.
    NoteAskedToEnd,
    /// End the worker of a running attempt. Unless by force, it may write its checkpoint.
    Stop { attempt: AttemptId, by_force: bool },
}

/// Result of an errand.
enum FileAnswer {
    /// The patient is this driver's.
    Taken(usize),
    /// The directory of the attempt was there before.
    Existing(AttemptId),
    /// The attempt is revoked, or has published the evidence first.
    Revoked(AttemptId, Option<AttemptFindings>),
}

/// Observations of workers, directories and signals.
struct Observation {
    now_ms: i64,
    stop: StopLevel,
    is_warned: bool,
    is_fenced: bool,
    /// Number of attempts that the executor would take.
    room: usize,
    news: Vec<News>,
    /// Attempts without progress, with the reason.
    hung: Vec<(AttemptId, String)>,
    taken: Vec<usize>,
    existing: Vec<(AttemptId, Existing)>,
    revoked: Vec<(AttemptId, Option<AttemptFindings>)>,
}

/// An attempt of the wanted generation that another job, or a local worker, has begun.
struct Existing {
    /// Name of the job that made the directory; `None` for a local worker.
    job: Option<String>,
    /// Whether the attempt or its job was revoked.
    is_revoked: bool,
    /// Outcome that it published; `None` before that, and for a revoked attempt.
    evidence: Option<AttemptFindings>,
}

impl<E: Executor, W: Fn() -> bool> Engine for InJobLoop<'_, E, W> {
    type Seen = Observation;
    /// A driver asks nothing: a worker that misses a file says so.
    type Question = Infallible;

    async fn observe(&mut self) -> Result<Observation, EngineError> {
        let goes_on = self.running.is_empty() || self.has_run_errands;
        let patience = if goes_on { Duration::ZERO } else { TICK };
        let news = tokio::select! {
            biased;
            news = self.executor.news() => news,
            () = self.stop.raised_above(StopLevel::Run), if self.leaving.is_none() => Vec::new(),
            () = tokio::time::sleep(patience) => Vec::new(),
        };
        let mut seen = Observation {
            now_ms: self.surroundings.clock.now_ms(),
            stop: self.stop.level(),
            is_warned: (self.warned)(),
            is_fenced: self.folder.is_fenced(self.place.element),
            room: self.executor.free(),
            news,
            hung: self.hung_workers(),
            taken: Vec::new(),
            existing: Vec::new(),
            revoked: Vec::new(),
        };
        for met in std::mem::take(&mut self.met) {
            match met {
                FileAnswer::Taken(patient) => seen.taken.push(patient),
                FileAnswer::Existing(attempt) => {
                    let existing = self.examine(&attempt)?;
                    seen.existing.push((attempt, existing));
                }
                FileAnswer::Revoked(attempt, evidence) => seen.revoked.push((attempt, evidence)),
            }
        }
        Ok(seen)
    }

    fn decide(&mut self, seen: Observation) -> Result<Option<Infallible>, EngineError> {
        self.take_up(seen);
        Ok(None)
    }

    async fn look(&mut self, question: Infallible) -> Result<Observation, EngineError> {
        match question {}
    }

    async fn commit(&mut self) -> Result<(), EngineError> {
        Ok(())
    }

    async fn act(&mut self) -> Result<(), EngineError> {
        self.has_run_errands = false;
        for errand in std::mem::take(&mut self.errands) {
            self.run_errand(errand).await?;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.running.is_empty()
            && self.wanted.is_empty()
            && self.met.is_empty()
            && self.queue.is_empty()
    }
}

impl<E: Executor, W: Fn() -> bool> InJobLoop<'_, E, W> {
    /// Ends the loop here if a test wants a crash at this point.
    fn pass(&self, place: &str) -> Result<(), EngineError> {
        self.surroundings.crash.pass(place)
    }

    fn id(&self, patient: usize) -> PatientId {
        self.order.patients[patient].plan.id.clone()
    }

    fn directory(&self, attempt: &AttemptId) -> PathBuf {
        self.order.run_dir.join(attempt_directory(attempt))
    }

    /// Running attempts whose workers make no progress, with the reason.
    fn hung_workers(&mut self) -> Vec<(AttemptId, String)> {
        let (running, order) = (&self.running, &self.order);
        let timeout_s = |attempt: &AttemptId| {
            let patient = *running.get(attempt)?.first()?;
            let settings = &order.patients[patient].plan.settings;
            settings.executor.hang_timeout_s
        };
        self.watch.look(timeout_s, Instant::now()).hung
    }

    /// Reads what is in a directory that was there before.
    fn examine(&self, attempt: &AttemptId) -> Result<Existing, EngineError> {
        let directory = self.directory(attempt);
        let owner = folder::allocation_of(&directory);
        let is_fenced = |owner: &AttemptAllocation| {
            JobFolder::of(&self.order.run_dir, &owner.job).is_fenced(owner.element)
        };
        let is_revoked = closing::is_revoked(&directory) || owner.as_ref().is_some_and(is_fenced);
        let evidence = if is_revoked {
            None // The revocation tells.
        } else {
            dispatch::outcome(&directory)?
        };
        Ok(Existing {
            job: owner.map(|owner| owner.job),
            is_revoked,
            evidence,
        })
    }

    async fn run_errand(&mut self, errand: FileRequest) -> Result<(), EngineError> {
        match errand {
            FileRequest::Take(patient) => {
                self.has_run_errands = true;
                if self.folder.take(self.place.element, patient)? {
                    self.pass("after a patient was taken")?;
                    self.met.push(FileAnswer::Taken(patient));
                }
            }
            FileRequest::Begin(attempt) => {
                self.has_run_errands = true;
                self.begin(attempt).await?;
            }
            FileRequest::Revoke(attempt) => {
                self.has_run_errands = true;
                let reason = format!("superseded by job {}", self.order.job);
                let evidence = dispatch::revoke(&self.directory(&attempt), &attempt, &reason)?;
                self.pass("after an attempt was revoked")?;
                self.met.push(FileAnswer::Revoked(attempt, evidence));
            }
            FileRequest::NoteAskedToEnd => self
                .folder
                .note_asked_to_end(self.place.element, self.place.node),
            FileRequest::Stop { attempt, by_force } => {
                let directory = self.directory(&attempt);
                self.executor.stop(&attempt, &directory, by_force)?;
            }
        }
        Ok(())
    }

    /// Begins a wanted attempt, unless its directory was there before.
    async fn begin(&mut self, attempt: AttemptId) -> Result<(), EngineError> {
        let Some(wanted) = self.wanted.get(&attempt) else {
            return Ok(());
        };
        let directory = self.directory(&attempt);
        let spec = AttemptSpec {
            schema_version: formats::SPEC.version,
            attempt: attempt.clone(),
            threads: self.order.threads,
            instruction_set: self.order.instruction_set,
            vtu_every_ms: self.order.vtu_every_ms,
            task: wanted.spec.clone(),
        };
        let allocation = AttemptAllocation {
            job: self.order.job.clone(),
            element: self.place.element,
            id: self.place.id.clone(),
        };
        if !folder::make_attempt(&directory, &spec, &allocation)? {
            self.met.push(FileAnswer::Existing(attempt));
            return Ok(());
        }
        self.pass("after an attempt's directory was made")?;
        self.ledger.start(&attempt, spec.task.kind());
        self.watch.begin(&attempt, &directory);
        self.executor.submit(Order { spec, directory }).await?;
        if let Some(wanted) = self.wanted.remove(&attempt) {
            self.running.insert(attempt, wanted.patients);
        }
        self.pass("after an attempt was begun")
    }
}
