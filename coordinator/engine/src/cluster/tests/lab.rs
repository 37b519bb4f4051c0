//! A run on a model of Slurm: the real tick, the real driver in the jobs, and workers with scripted
//! results.

use std::collections::{BTreeMap, HashSet, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use cardiotwin_protocol::closing::{self, Closing, PreparedOutcome, Winner};
use cardiotwin_protocol::{claim, names};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::{AttemptId, ExternalId};
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::settings::{ExecutorKind, ExecutorSettings, SlurmSettings};
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::answers::{Exit, Output};
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm_model::{Fault, Model, Settings};
use cardiotwin_store::clock::Clock;

use crate::crash::CrashPoints;
use crate::dispatch::{self, DispatchError, Executor, Found, News, Order};
use crate::in_job_loop::{DriverPlace, drive_job};
use crate::surroundings::Surroundings;
use crate::tests::scripted::{Script, artefact};
use crate::{
    EngineError, EventRecord, Reader, RunOptions, RunSummary, StopSignal, enter_with_lease, tick,
};

/// The scheduler that the tick talks to.
#[derive(Debug, Clone)]
pub struct Modelled {
    pub model: Arc<Mutex<Model>>,
    /// Faults of the next commands, by program. Each is used once, in order.
    pub faults: Arc<Mutex<Vec<(&'static str, Fault)>>>,
    pub asked: Arc<Mutex<Vec<&'static str>>>,
    /// Answers of squeue and sacct in place of the model's.
    pub replay: Arc<Mutex<Option<(Output, Output)>>>,
    /// Answer of the next sbatch in place of the model's.
    pub submission: Arc<Mutex<Option<Output>>>,
}

impl Scheduler for Modelled {
    async fn ask(&mut self, command: &Command) -> Output {
        self.asked.lock().unwrap().push(command.program);
        if matches!(command.program, "scontrol" | "sacctmgr") {
            return Output {
                exit: Exit::Code(0),
                stdout: String::new(),
                stderr: String::new(),
            };
        }
        if let Some((queue, accounting)) = self.replay.lock().unwrap().clone() {
            match command.program {
                "squeue" => return queue,
                "sacct" => return accounting,
                _ => {}
            }
        }
        if command.program == "sbatch"
            && let Some(answer) = self.submission.lock().unwrap().take()
        {
            return answer;
        }
        let mut faults = self.faults.lock().unwrap();
        let next = faults
            .iter()
            .position(|(program, _)| *program == command.program);
        let fault = next.map(|n| faults.remove(n).1);
        let mut model = self.model.lock().unwrap();
        model.answer(command, |path| fs::read_to_string(path).ok(), fault)
    }
}

/// Workers that claim, respect revocations and publish as the real one does, with scripted results.
pub struct OnDisk {
    script: Arc<Mutex<Script>>,
    ended: VecDeque<AttemptId>,
    /// The worker dies with its driver at the attempt of this number (from 0), after claiming it if
    /// true.
    pub dies: Option<(usize, bool)>,
    /// Number of attempts begun by this worker.
    begun: usize,
    directories: BTreeMap<AttemptId, PathBuf>,
}

impl Executor for OnDisk {
    fn kind(&self) -> &'static str {
        "on-disk"
    }

    fn free(&self) -> usize {
        1_usize.saturating_sub(self.directories.len())
    }

    async fn submit(&mut self, order: Order) -> Result<ExternalId, DispatchError> {
        let died = |path: &Path| DispatchError::File {
            what: "die in",
            path: path.to_owned(),
            source: std::io::ErrorKind::Other.into(),
        };
        if self.dies == Some((self.begun, false)) {
            return Err(died(&order.directory)); // the directory exists, but nobody has claimed it
        }
        self.begun += 1;
        let attempt = order.spec.attempt.clone();
        let by = dispatch::claim_of_this_process();
        let is_revoked = closing::is_revoked(&order.directory);
        if is_revoked || !claim::take(&order.directory, &by).unwrap() {
            return Err(died(&order.directory));
        }
        if self.dies == Some((self.begun - 1, true)) {
            return Err(died(&order.directory)); // claimed, without an outcome
        }
        let (made, content) = artefact(&order.spec);
        fs::write(order.directory.join(&made.file), &content).unwrap();
        let outcome = TaskOutcome {
            schema_version: formats::OUTCOME.version,
            attempt: attempt.clone(),
            ending: self.script.lock().unwrap().ending(&order.spec.task),
            artefacts: vec![made],
            provenance: Provenance::default(),
            sha256: None,
        };
        let outcome = PreparedOutcome::new(&order.directory, &outcome).unwrap();
        if outcome.publish().unwrap() == Winner::Coordinator {
            return Err(died(&order.directory));
        }
        self.directories.insert(attempt.clone(), order.directory);
        self.ended.push_back(attempt);
        Ok(ExternalId::from("1"))
    }

    fn adopt(&mut self, _: &AttemptId, _: &Path) -> Result<Found, DispatchError> {
        Ok(Found::Unclaimed)
    }

    fn stop(&mut self, _: &AttemptId, _: &Path, _: bool) -> Result<bool, DispatchError> {
        Ok(false)
    }

    async fn news(&mut self) -> Vec<News> {
        let Some(attempt) = self.ended.pop_front() else {
            return std::future::pending().await;
        };
        let directory = self.directories.remove(&attempt).unwrap();
        let evidence = dispatch::outcome(&directory).unwrap().unwrap();
        vec![News::Ended {
            attempt,
            evidence,
            claim: None,
        }]
    }
}

/// Number of nodes of each element of a job. The job's script starts a driver on each of them.
fn n_nodes(folder: &Path) -> u32 {
    let script = fs::read_to_string(folder.join("job.sh")).unwrap();
    script
        .lines()
        .find_map(|line| line.strip_prefix("#SBATCH --nodes=")?.parse().ok())
        .unwrap()
}

pub struct Lab {
    dir: tempfile::TempDir,
    pub slurm: Modelled,
    pub script: Arc<Mutex<Script>>,
    pub patients: Vec<ResolvedPatient>,
    pub settings: SlurmSettings,
    pub site_retries: u32,
    /// Clock of ticks and drivers.
    pub clock: Clock,
    /// Whether ticks continue with the stored plans instead of `patients`.
    pub has_stored_plans: bool,
    driven: HashSet<usize>,
}

/// Start of the lab's clock, ms since 1970: a moment in 2023.
const START_MS: i64 = 1_700_000_000_000;

const SITE: &str = "name = 'model'\ndescription = ''\nscheduler = 'slurm'\nnode = { cores = 4, memory_mib = 8000, unit = 'core' }\n\
                    [[queue]]\nname = 'q'\nqos = 'normal'\nuses = ['chunks', 'simulations']\nwalltime = '01:00:00'\n";

impl Lab {
    pub fn new(patients: Vec<ResolvedPatient>, settings: Settings) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let site = dir.path().join("site.toml");
        fs::write(&site, SITE).unwrap();
        let slurm = Modelled {
            model: Arc::new(Mutex::new(Model::new(settings))),
            faults: Arc::default(),
            asked: Arc::default(),
            replay: Arc::default(),
            submission: Arc::default(),
        };
        let site = site.to_string_lossy().into_owned();
        let settings = SlurmSettings {
            site,
            grace_s: 0,
            job_s: 1,
            ..SlurmSettings::default()
        };
        Self {
            dir,
            slurm,
            script: Arc::default(),
            patients,
            settings,
            site_retries: 2,
            clock: Clock::manual(START_MS),
            has_stored_plans: false,
            driven: HashSet::new(),
        }
    }

    /// The same lab on a site that gives whole nodes.
    pub fn with_whole_nodes(self) -> Self {
        fs::write(
            &self.settings.site,
            SITE.replace("unit = 'core'", "unit = 'node'"),
        )
        .unwrap();
        self
    }

    /// The same lab on a site that allows no job arrays, so that each patient is a job of its own.
    pub fn without_arrays(self) -> Self {
        let arrays = "[[queue]]";
        let site = SITE.replace(
            arrays,
            &format!("arrays = {{ allowed = false, max_size = 1 }}\n{arrays}"),
        );
        fs::write(&self.settings.site, site).unwrap();
        self
    }

    pub fn run_dir(&self) -> PathBuf {
        self.dir.path().join("run")
    }

    /// Runs one tick to its end, without a crash.
    pub async fn tick(&self) -> RunSummary {
        self.tick_until(&CrashPoints::default()).await.unwrap()
    }

    /// Runs one tick, which dies at its n-th crash point.
    pub async fn tick_dying_at(&self, n: u64) -> Result<RunSummary, EngineError> {
        self.tick_until(&CrashPoints::ending_at(n)).await
    }

    /// Runs one tick, which dies at these crash points. They are counted over all ticks that share
    /// them.
    pub async fn tick_until(&self, crash: &CrashPoints) -> Result<RunSummary, EngineError> {
        let slurm = self.settings.clone();
        let options = RunOptions {
            run_dir: self.run_dir(),
            chosen: None,
            cohort_name: "lab".into(),
            description: String::new(),
            cohort_dir: self.dir.path().to_owned(),
            patients: (!self.has_stored_plans).then(|| self.patients.clone()),
            refused: Vec::new(),
            recognised: Default::default(),
            only: vec![],
            executor: ExecutorSettings {
                kind: ExecutorKind::Slurm,
                slurm,
                site_retries: self.site_retries,
                ..ExecutorSettings::default()
            },
            worker: None,
            adopt_version: true,
            watch: false,
        };
        let (events, _) = tokio::sync::mpsc::unbounded_channel();
        let (_lock, lease, run_dir) = enter_with_lease(&self.run_dir())?;
        let programs = (PathBuf::from("/w"), PathBuf::from("/p"));
        tick(
            options,
            (run_dir, lease),
            self.slurm.clone(),
            programs,
            self.surroundings(crash),
            events,
            StopSignal::new(),
        )
        .await
    }

    fn surroundings(&self, crash: &CrashPoints) -> Surroundings {
        Surroundings {
            clock: self.clock.clone(),
            crash: crash.clone(),
        }
    }

    /// Lets time pass, for Slurm and for the coordinator.
    pub fn pass(&self, seconds: i64) {
        self.slurm.model.lock().unwrap().advance(seconds);
        self.clock.advance_ms(seconds * 1000);
    }

    /// Lets a moment pass for the coordinator alone, after which a grace of zero is over.
    pub fn moment(&self) {
        self.clock.advance_ms(1);
    }

    /// Lets the next command of this program meet this fault.
    pub fn fault(&self, program: &'static str, fault: Fault) {
        self.slurm.faults.lock().unwrap().push((program, fault));
    }

    /// Number of times that this program was run.
    pub fn n_asked(&self, program: &str) -> usize {
        let asked = self.slurm.asked.lock().unwrap();
        asked.iter().filter(|p| **p == program).count()
    }

    /// Runs the drivers of the jobs that Slurm has started. A driver whose processes were killed
    /// does not run any more.
    pub async fn drive(&mut self, dies: impl FnMut() -> Option<(usize, bool)>) {
        self.drive_until(dies, &CrashPoints::default()).await;
    }

    /// The same with drivers that die at these crash points. A dead driver does nothing more.
    pub async fn drive_until(
        &mut self,
        mut dies: impl FnMut() -> Option<(usize, bool)>,
        crash: &CrashPoints,
    ) {
        let runs = self.slurm.model.lock().unwrap().runs().to_vec();
        for (n, run) in runs.into_iter().enumerate() {
            if run.ended.is_some() || !self.driven.insert(n) {
                continue;
            }
            let element = run.element.unwrap_or(0);
            let folder = self.run_dir().join("slurm").join(&run.name);
            for node in 0..n_nodes(&folder) {
                let id = Some(n.to_string());
                let place = DriverPlace {
                    folder: folder.clone(),
                    element,
                    node,
                    id,
                    hosts: Vec::new(),
                    leave_at_ms: None,
                };
                let (script, dies) = (Arc::clone(&self.script), dies());
                let executor = |_: &_| OnDisk {
                    script,
                    ended: VecDeque::new(),
                    dies,
                    begun: 0,
                    directories: BTreeMap::new(),
                };
                // A driver that dies writes no end; its job ends all the same.
                let surroundings = self.surroundings(crash);
                let _ =
                    drive_job(&place, executor, StopSignal::new(), || false, surroundings).await;
            }
        }
    }

    /// Ticks, lets time pass and runs drivers until the run is over.
    pub async fn finish(&mut self) -> RunSummary {
        for _ in 0..400 {
            let summary = self.tick().await;
            if !summary.on_cluster() {
                return summary;
            }
            self.pass(30);
            self.drive(|| None).await;
        }
        panic!(
            "it does not end: {:#?}",
            self.slurm.model.lock().unwrap().runs()
        );
    }

    pub async fn reader(&self) -> Reader {
        Reader::open(&self.run_dir()).await.unwrap()
    }

    pub async fn events(&self) -> Vec<EventRecord> {
        self.reader().await.history(None).await.unwrap()
    }

    /// Asserts that every published task was published once and was not begun again afterwards.
    pub async fn assert_published_once(&self) {
        let mut published: HashSet<String> = HashSet::new();
        for event in self
            .events()
            .await
            .into_iter()
            .filter(|event| event.machine == "task")
        {
            let task = event.task.as_ref().unwrap().to_string();
            assert!(
                !published.contains(&task),
                "task {task} went on after it was published: {event:?}"
            );
            if event.event["event"] == "ended" && event.event["how"]["how"] == "succeeded" {
                published.insert(task);
            }
        }
    }

    fn attempt_directories(&self) -> Vec<PathBuf> {
        let folders = |path: &Path| -> Vec<PathBuf> {
            fs::read_dir(path)
                .map(|entries| entries.flatten().map(|e| e.path()).collect())
                .unwrap_or_default()
        };
        let shards = folders(&self.run_dir().join("attempts"));
        shards.iter().flat_map(|p| folders(p)).collect()
    }

    /// Attempts that a worker claimed and that are still open.
    pub fn attempts_at_work(&self) -> Vec<PathBuf> {
        let mut all = self.attempt_directories();
        all.retain(|path| {
            path.join(names::CLAIM).exists() && closing::read(path).unwrap() == Closing::Open
        });
        all
    }

    /// Number of attempts that were claimed, and number of attempts that were published.
    pub fn attempts(&self) -> (usize, usize) {
        let all = self.attempt_directories();
        let n = |is: fn(&PathBuf) -> bool| all.iter().filter(|path| is(path)).count();
        (
            n(|path| path.join(names::CLAIM).exists()),
            n(|path| matches!(closing::read(path), Ok(Closing::Published(_)))),
        )
    }
}
