//! The driver inside an allocation: it walks patients' chains by the same decisions as the
//! coordinator, without the coordinator's database.
//!
//! A patient waits in the queue only once: the task that follows from a simulation is derived here
//! ([`derivation::evaluate`]) and begun at once. Every simulation is an attempt in a directory of
//! its own, as if the coordinator had begun it; the coordinator finds these directories and updates
//! its books from them. A task that is expected to exceed the remaining time is not begun.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cardiotwin_protocol::closing;
use cardiotwin_schemas::SCHEMA_VERSION;
use cardiotwin_schemas::allocation::{
    AttemptAllocation, DriverClaim, DriverEnd, DriverEnding, JobOrder, Standing,
};
use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, PatientId, TaskKey};
use cardiotwin_schemas::outcome::{Ending, TaskOutcome};
use cardiotwin_schemas::task::{AttemptSpec, TaskSpec};
use cardiotwin_workflow::attempt::AttemptEnding;
use cardiotwin_workflow::derivation::{self, Next, Settled};
use cardiotwin_workflow::judge::judge;
use cardiotwin_workflow::task::{Task, TaskEvent};
use tokio::signal::unix::{SignalKind, signal};

use super::surroundings::Surroundings;
use super::world::{attempt_directory, settled};
use super::{EngineError, StopLevel, StopSignal};
use crate::clock::utc_text;
use crate::dispatch::slurm::folder::{self, JobFolder};
use crate::dispatch::{self, Evidence, Executor, Launcher, Local, News, Order};

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
    let executor = executor(&order);
    let mut driver = InJobLoop {
        ledger: Ledger::new(&order),
        queue: (0..order.patients.len()).collect(),
        order,
        place,
        folder: folder.clone(),
        executor,
        surroundings: surroundings.clone(),
        running: HashMap::new(),
        left: BTreeMap::new(),
        defects: BTreeSet::new(),
        leaving: None,
    };
    driver.run(&stop, &warned).await?;
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
        Local::new(order.worker.clone(), order.lanes.max(1) as usize)
            .with_grace(GRACE)
            .with_launcher(launcher)
    };
    let surroundings = Surroundings::of_this_process();
    let is_warned = || warned.load(Ordering::Relaxed);
    drive_job(place, local, stop, is_warned, surroundings).await
}

struct InJobLoop<'a, E> {
    order: JobOrder,
    place: &'a DriverPlace,
    folder: JobFolder,
    executor: E,
    surroundings: Surroundings,
    ledger: Ledger,
    /// Patients that no driver has taken yet, as far as this driver knows.
    queue: VecDeque<usize>,
    /// Running attempts, with the patients that wait for each.
    running: HashMap<AttemptId, Vec<usize>>,
    left: BTreeMap<usize, String>,
    /// Patients in `left` whose worker died of a defect.
    defects: BTreeSet<usize>,
    leaving: Option<DriverEnding>,
}

impl<E: Executor> InJobLoop<'_, E> {
    async fn run(
        &mut self,
        stop: &StopSignal,
        warned: &impl Fn() -> bool,
    ) -> Result<(), EngineError> {
        loop {
            self.leave_if_told(stop, warned)?;
            while self.leaving.is_none() && self.executor.free() > 0 {
                let Some(patient) = self.queue.pop_front() else {
                    break;
                };
                if self.folder.take(self.place.element, patient)? {
                    self.pass("after a patient was taken")?;
                    self.walk(patient).await?;
                }
            }
            if self.leaving.is_some() {
                self.queue.drain(..).for_each(|patient| {
                    self.left
                        .insert(patient, "not begun: the job was at its end".to_owned());
                });
            }
            if self.running.is_empty() {
                return Ok(());
            }
            let news = tokio::select! {
                biased;
                news = self.executor.news() => news,
                () = stop.raised_above(StopLevel::Run), if self.leaving.is_none() => Vec::new(),
                () = tokio::time::sleep(TICK) => Vec::new(),
            };
            for item in news {
                match item {
                    News::Ended {
                        attempt, evidence, ..
                    } => self.ended(&attempt, evidence).await?,
                    News::Vanished { attempt } => {
                        self.leave(&attempt, "its worker went out of sight")
                    }
                    News::Alive { .. } => {}
                }
            }
        }
    }

    /// Reacts to the warning before the walltime, a stop or a fence: workers write their
    /// checkpoints and end.
    fn leave_if_told(
        &mut self,
        stop: &StopSignal,
        warned: &impl Fn() -> bool,
    ) -> Result<(), EngineError> {
        if self.leaving.is_some() {
            return Ok(());
        }
        self.leaving = if self.folder.is_fenced(self.place.element) {
            Some(DriverEnding::Fenced)
        } else if stop.level() > StopLevel::Run || self.is_late(0.0) {
            Some(if warned() || self.is_late(0.0) {
                DriverEnding::OutOfTime
            } else {
                DriverEnding::Stopped
            })
        } else {
            None
        };
        if self.leaving == Some(DriverEnding::Stopped) {
            self.folder
                .note_asked_to_end(self.place.element, self.place.node);
        }
        if self.leaving.is_some() {
            for attempt in self.running.keys().cloned().collect::<Vec<_>>() {
                let directory = self.directory(&attempt);
                self.executor.stop(&attempt, &directory, false)?;
            }
        }
        Ok(())
    }

    /// Passes a crash point.
    fn pass(&self, place: &str) -> Result<(), EngineError> {
        self.surroundings.crash.pass(place)
    }

    /// Whether work that takes `takes_s` would not be done in time.
    fn is_late(&self, takes_s: f64) -> bool {
        self.place.leave_at_ms.is_some_and(|at| {
            self.surroundings.clock.now_ms() as f64 + takes_s * 1000.0 >= at as f64
        })
    }

    fn id(&self, patient: usize) -> PatientId {
        self.order.patients[patient].plan.id.clone()
    }

    fn directory(&self, attempt: &AttemptId) -> PathBuf {
        self.order.run_dir.join(attempt_directory(attempt))
    }

    /// Continues with a patient until an attempt runs or nothing is left to do.
    async fn walk(&mut self, patient: usize) -> Result<(), EngineError> {
        loop {
            let of = &self.order.patients[patient];
            let next =
                derivation::evaluate(&of.plan, &of.carried, &|key| self.ledger.settled(key)).next;
            let Next::Run { key, spec, .. } = next else {
                return Ok(());
            };
            if let Some((_, waiters)) = self
                .running
                .iter_mut()
                .find(|(attempt, _)| attempt.task == key)
            {
                waiters.push(patient); // two patients want the same task
                return Ok(());
            }
            if let Some(why) = self.hindrance(spec.kind()) {
                self.left.insert(patient, why);
                return Ok(());
            }
            let attempt = AttemptId {
                generation: self.ledger.generation(&key) + 1,
                task: key,
            };
            if self.begin(&attempt, &spec).await? {
                self.running.insert(attempt, vec![patient]);
                return Ok(());
            }
            if let Some(why) = self.take_over(&attempt, &spec)? {
                self.left.insert(patient, why);
                return Ok(());
            }
        }
    }

    fn hindrance(&self, kind: &str) -> Option<String> {
        let expected_s = self
            .order
            .expected_s
            .get(kind)
            .copied()
            .unwrap_or(0.0)
            .max(self.ledger.longest_s(kind));
        if self.folder.is_fenced(self.place.element) {
            Some("the job was revoked".to_owned())
        } else if self.leaving.is_some() {
            Some("the job was at its end".to_owned())
        } else if self.is_late(expected_s) {
            Some(format!(
                "{kind} is expected to take {expected_s:.0} s, more than the job had left"
            ))
        } else {
            None
        }
    }

    /// Begins an attempt; false if its directory existed before.
    async fn begin(&mut self, attempt: &AttemptId, task: &TaskSpec) -> Result<bool, EngineError> {
        let directory = self.directory(attempt);
        let spec = AttemptSpec {
            schema_version: SCHEMA_VERSION,
            attempt: attempt.clone(),
            threads: self.order.threads,
            instruction_set: self.order.instruction_set,
            vtu_every_ms: self.order.vtu_every_ms,
            task: task.clone(),
        };
        let (job, element, id) = (
            self.order.job.clone(),
            self.place.element,
            self.place.id.clone(),
        );
        if !folder::make_attempt(&directory, &spec, &AttemptAllocation { job, element, id })? {
            return Ok(false);
        }
        self.pass("after an attempt's directory was made")?;
        self.ledger.start(attempt, task.kind());
        self.executor.submit(Order { spec, directory }).await?;
        self.pass("after an attempt was begun")?;
        Ok(true)
    }

    /// Deals with an attempt of this generation that another job began. A result that it left is
    /// used. If that job was revoked, the attempt is revoked as well and skipped. If that job may
    /// be live, the patient is left to it. Returns the reason for which the patient is left.
    fn take_over(
        &mut self,
        attempt: &AttemptId,
        spec: &TaskSpec,
    ) -> Result<Option<String>, EngineError> {
        let directory = self.directory(attempt);
        let owner = folder::allocation_of(&directory);
        let revoked = closing::is_revoked(&directory)
            || owner
                .as_ref()
                .is_some_and(|o| JobFolder::of(&self.order.run_dir, &o.job).is_fenced(o.element));
        // An attempt that is revoked here has no outcome, now or later.
        let evidence = if revoked {
            let reason = format!("job {} went past it", self.order.job);
            let evidence = dispatch::revoke(&directory, attempt, &reason)?;
            self.pass("after an attempt was revoked")?;
            evidence
        } else {
            dispatch::outcome(&directory)?
        };
        if let Some(evidence) = evidence {
            if matches!(&evidence, Evidence::Outcome { outcome, .. } if matches!(outcome.ending, Ending::Cancelled))
            {
                self.ledger.skip(&attempt.task);
                return Ok(None);
            }
            self.ledger.start(attempt, spec.kind());
            self.settle(attempt, spec.kind(), evidence);
            return Ok(None);
        }
        if !revoked {
            let owner = owner.map_or("a local worker".to_owned(), |owner| {
                format!("job {}", owner.job)
            });
            return Ok(Some(format!("{owner} is at the same task")));
        }
        self.ledger.skip(&attempt.task);
        Ok(None)
    }

    async fn ended(&mut self, attempt: &AttemptId, evidence: Evidence) -> Result<(), EngineError> {
        let Some(waiters) = self.running.remove(attempt) else {
            return Ok(());
        };
        let (reason, defect) = match &evidence {
            Evidence::Nothing { reason, class } => (reason.clone(), *class == FailureClass::Bug),
            Evidence::Outcome { .. } => ("its worker was stopped".to_owned(), false),
        };
        let kind = self.ledger.kind(&attempt.task);
        let settled = self.settle(attempt, &kind, evidence);
        for patient in waiters {
            if settled {
                Box::pin(self.walk(patient)).await?;
            } else {
                // The coordinator decides on the class of the failure, because it also has the
                // scheduler's account.
                self.left.insert(patient, reason.clone());
                if defect {
                    self.defects.insert(patient);
                }
            }
        }
        Ok(())
    }

    fn leave(&mut self, attempt: &AttemptId, why: &str) {
        for patient in self.running.remove(attempt).unwrap_or_default() {
            self.left.insert(patient, why.to_owned());
        }
    }

    /// Enters the end of an attempt in the ledger. Returns whether the attempt settled its task.
    fn settle(&mut self, attempt: &AttemptId, kind: &str, evidence: Evidence) -> bool {
        let (how, outcome) = match evidence {
            Evidence::Outcome { outcome, .. } => (judge(attempt, kind, &outcome), Some(*outcome)),
            Evidence::Nothing { reason, .. } => (AttemptEnding::Lost { reason }, None),
        };
        self.ledger.ended(attempt, how, outcome)
    }
}

/// States and outcomes of tasks, as far as a driver knows them.
#[derive(Debug, Default)]
struct Ledger {
    run_dir: PathBuf,
    tasks: HashMap<TaskKey, Entry>,
}

#[derive(Debug, Default)]
struct Entry {
    state: Task,
    outcome: Option<TaskOutcome>,
    kind: String,
}

impl Ledger {
    fn new(order: &JobOrder) -> Self {
        let mut ledger = Self {
            run_dir: order.run_dir.clone(),
            tasks: HashMap::new(),
        };
        for known in order.patients.iter().flat_map(|patient| &patient.known) {
            let generation = known.generation;
            let (state, outcome) = match &known.standing {
                Standing::Open => (
                    Task::Open {
                        generation,
                        site_failures: 0,
                    },
                    None,
                ),
                Standing::Failed(failure) => (
                    Task::Failed {
                        generation,
                        failure: failure.clone(),
                    },
                    None,
                ),
                Standing::Published => match read_outcome(&ledger.run_dir, &known.task, generation)
                {
                    Some(outcome) => (Task::Published { generation }, Some(outcome)),
                    // The files of the result are gone, so it is computed once more under a further
                    // generation.
                    None => (
                        Task::Open {
                            generation,
                            site_failures: 0,
                        },
                        None,
                    ),
                },
            };
            ledger.tasks.insert(
                known.task.clone(),
                Entry {
                    state,
                    outcome,
                    kind: String::new(),
                },
            );
        }
        ledger
    }

    fn settled(&self, key: &TaskKey) -> Option<Settled<'_>> {
        let entry = self.tasks.get(key)?;
        settled(key, &entry.state, || entry.outcome.as_ref(), &self.run_dir)
    }

    fn generation(&self, key: &TaskKey) -> u32 {
        self.tasks
            .get(key)
            .map_or(0, |entry| entry.state.generation())
    }

    fn kind(&self, key: &TaskKey) -> String {
        self.tasks
            .get(key)
            .map(|entry| entry.kind.clone())
            .unwrap_or_default()
    }

    /// Longest wall time among the outcomes of this kind of task, s.
    fn longest_s(&self, kind: &str) -> f64 {
        let outcomes = self
            .tasks
            .values()
            .filter(|entry| entry.kind == kind)
            .filter_map(|entry| entry.outcome.as_ref());
        outcomes
            .map(|outcome| outcome.provenance.wall_s)
            .fold(0.0, f64::max)
    }

    fn start(&mut self, attempt: &AttemptId, kind: &str) {
        let entry = self.tasks.entry(attempt.task.clone()).or_default();
        kind.clone_into(&mut entry.kind);
        entry.state = Task::Attempting {
            generation: attempt.generation,
            site_failures: 0,
        };
    }

    /// Skips a generation that another, revoked job had begun.
    fn skip(&mut self, key: &TaskKey) {
        let generation = self.generation(key) + 1;
        self.tasks.entry(key.clone()).or_default().state = Task::Open {
            generation,
            site_failures: 0,
        };
    }

    fn ended(
        &mut self,
        attempt: &AttemptId,
        how: AttemptEnding,
        outcome: Option<TaskOutcome>,
    ) -> bool {
        let Some(entry) = self.tasks.get_mut(&attempt.task) else {
            return false;
        };
        // The coordinator decides whether a site failure is tried again.
        if how.failure().is_some_and(|f| f.class == FailureClass::Site) {
            return false;
        }
        let event = TaskEvent::Ended {
            generation: attempt.generation,
            how,
            site_retries: 0,
        };
        if let Ok(state) = entry.state.clone().on(event) {
            entry.state = state;
            entry.outcome = outcome;
        }
        entry.state.is_final()
    }
}

fn read_outcome(run_dir: &Path, task: &TaskKey, generation: u32) -> Option<TaskOutcome> {
    let attempt = AttemptId {
        task: task.clone(),
        generation,
    };
    match dispatch::outcome(&run_dir.join(attempt_directory(&attempt))) {
        Ok(Some(Evidence::Outcome { outcome, .. })) => Some(*outcome),
        _ => None,
    }
}
