//! A model of Slurm for tests: deterministic, without processes or clock, and faulty on demand.
//!
//! Its answers have the format of the real ones (`coordinator/slurm/tests/recorded`), so that a test exercises the
//! same commands, parsers and decisions. It behaves as observed in a real Slurm 22.05: an sbatch
//! that fails may have submitted; a controller that is killed loses its youngest jobs, hands out
//! their numbers again and runs other jobs twice; a lost node says nothing about the process on it;
//! the database lags, and never lists jobs that were cancelled before they could start.

mod script;
mod speech;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use cardiotwin_slurm::state::{Liveness, SlurmState};

/// Behaviour of a job's processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Behaviour {
    /// Time after which they end by themselves \[s\].
    pub seconds: i64,
    /// Exit code with which they end.
    pub code: u8,
    /// Signal that ends them, or 0 for none; 125 stands for out of memory.
    pub signal: u8,
}

/// Limits of a QoS on a user's jobs; `None` means no limit.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Limits {
    /// Largest number of jobs that are queued or running.
    pub max_queued: Option<u32>,
    /// Largest number of running jobs.
    pub max_running: Option<u32>,
    /// Largest number of nodes of a job.
    pub max_nodes_per_job: Option<u32>,
    /// Longest walltime of a job, s.
    pub walltime_s: Option<u64>,
}

/// Configuration of the modelled cluster.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Number of nodes, named `n1` to `n<N>`, each for one job at a time.
    pub n_nodes: u32,
    /// Limits by the name of the QoS. A QoS that is not listed does not exist.
    pub qos: BTreeMap<String, Limits>,
    /// Time for which the queue shows an ended job, s.
    pub min_job_age_s: i64,
    /// Delay after which the database shows a change, s.
    pub accounting_lag_s: i64,
    /// Whether the cluster has a database.
    pub has_accounting: bool,
    /// Largest number of elements of an array.
    pub max_array_size: u32,
    /// Behaviour of processes whose jobs are not in [`Model::behaviours`].
    pub behaviour: Behaviour,
}

impl Default for Settings {
    fn default() -> Self {
        let qos = BTreeMap::from([("normal".to_owned(), Limits::default())]);
        let behaviour = Behaviour {
            seconds: 60,
            code: 0,
            signal: 0,
        };
        Self {
            n_nodes: 4,
            qos,
            min_job_age_s: 300,
            accounting_lag_s: 2,
            has_accounting: true,
            max_array_size: 1001,
            behaviour,
        }
    }
}

/// Fault of a single command. The command takes effect unless the fault says otherwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fault {
    /// The command took effect, but its answer is "Socket timed out".
    TimeoutAfter,
    /// The command had no effect, and its answer is "Socket timed out".
    TimeoutBefore,
    /// The command took effect, but its answer was lost because the process was killed.
    KilledAfter,
    /// The command took effect, but its answer is replaced by this text.
    Garbage(String),
    /// The command took effect, but its answer stops after this number of bytes.
    Cut(usize),
    /// The answer is preceded by this banner.
    Banner(String),
    /// Neither the controller nor the database answers.
    Down,
    /// The controller refuses the command with these words.
    Refused(String),
}

/// A run of a job's processes, regardless of the state that Slurm shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Run {
    /// Name of the job.
    pub name: String,
    /// Element of the array; `None` for a single job.
    pub element: Option<u32>,
    /// Time at which the processes began, s.
    pub began: i64,
    /// Time at which they ended or were killed, s; `None` while they live.
    pub ended: Option<i64>,
    /// Whether they ended by themselves with exit code 0.
    pub completed: bool,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Job {
    number: u64,
    array: Option<(u64, u32)>,
    request: script::Request,
    state: SlurmState,
    reason: String,
    submitted: i64,
    start: Option<i64>,
    end: Option<i64>,
    nodes: Vec<u32>,
    code: u8,
    signal: u8,
    cancelled: bool,
    run: Option<usize>,
}

/// The modelled cluster. Times are seconds since 1970.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Model {
    settings: Settings,
    /// Behaviour of processes, by the name of the job.
    pub behaviours: BTreeMap<String, Behaviour>,
    now: i64,
    next_number: u64,
    jobs: Vec<Job>,
    runs: Vec<Run>,
    down: Vec<u32>,
    /// Numbers of the jobs that the controller forgot, with the indices of their runs.
    forgotten: Vec<(u64, usize)>,
    /// Reports to the database: the time, and a copy of the job.
    told: Vec<(i64, Job)>,
}

impl Model {
    /// An idle cluster at a fixed time.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            behaviours: BTreeMap::new(),
            now: 1_800_000_000,
            next_number: 1,
            jobs: Vec::new(),
            runs: Vec::new(),
            down: Vec::new(),
            forgotten: Vec::new(),
            told: Vec::new(),
        }
    }

    /// Present time, seconds since 1970.
    #[must_use]
    pub fn now(&self) -> i64 {
        self.now
    }

    /// All past and present runs: the truth that a client cannot see.
    #[must_use]
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Lets time pass in steps of a second.
    pub fn advance(&mut self, seconds: i64) {
        for _ in 0..seconds {
            self.now += 1;
            self.end_what_is_due();
            self.start_what_fits();
            let forgotten = self.now - self.settings.min_job_age_s;
            self.jobs
                .retain(|job| job.end.is_none_or(|end| end > forgotten));
        }
    }

    fn behaviour(&self, name: &str) -> Behaviour {
        self.behaviours
            .get(name)
            .copied()
            .unwrap_or(self.settings.behaviour)
    }

    fn end_what_is_due(&mut self) {
        let now = self.now;
        // Processes end by themselves, whether Slurm knows them or not.
        for run in 0..self.runs.len() {
            let behaviour = self.behaviour(&self.runs[run].name);
            if self.runs[run].ended.is_none() && now >= self.runs[run].began + behaviour.seconds {
                self.runs[run].ended = Some(now);
                self.runs[run].completed = behaviour.code == 0 && behaviour.signal == 0;
            }
        }
        for i in 0..self.jobs.len() {
            let job = &self.jobs[i];
            let (Some(start), Some(run)) = (job.start, job.run) else {
                continue;
            };
            if job.state != SlurmState::Running {
                continue;
            }
            if self.runs[run].ended.is_some() {
                let Behaviour { code, signal, .. } = self.behaviour(&job.request.name);
                let (state, reason) = match (code, signal) {
                    (0, 0) => (SlurmState::Completed, "None"),
                    (_, 125) => (SlurmState::OutOfMemory, "OutOfMemory"),
                    (_, 0) => (SlurmState::Failed, "NonZeroExitCode"),
                    // squeue's reason for a killed script.
                    _ => (SlurmState::Failed, "JobLaunchFailure"),
                };
                self.end(i, state, reason, (code, signal));
            } else if now - start >= i64::try_from(job.request.walltime_s).unwrap_or(i64::MAX) {
                self.kill(run);
                self.end(i, SlurmState::Timeout, "TimeLimit", (0, 0));
            }
        }
    }

    fn start_what_fits(&mut self) {
        for i in 0..self.jobs.len() {
            if self.jobs[i].state != SlurmState::Pending || self.jobs[i].request.held {
                continue;
            }
            let qos = self.jobs[i].request.qos.clone();
            let runs = |job: &&Job| job.state == SlurmState::Running;
            let running = self
                .jobs
                .iter()
                .filter(runs)
                .filter(|job| job.request.qos == qos)
                .count();
            let of_array = self.jobs[i].array.map(|(array, _)| array);
            let of_same = self
                .jobs
                .iter()
                .filter(runs)
                .filter(|j| of_array.is_some() && j.array.map(|a| a.0) == of_array)
                .count();
            let limit = self
                .settings
                .qos
                .get(&qos)
                .and_then(|limits| limits.max_running);
            let request = &self.jobs[i].request;
            if request.at_once.is_some_and(|n| of_same >= n as usize) {
                "JobArrayTaskLimit".clone_into(&mut self.jobs[i].reason);
                continue;
            }
            if limit.is_some_and(|n| running >= n as usize) {
                "QOSMaxJobsPerUserLimit".clone_into(&mut self.jobs[i].reason);
                continue;
            }
            let taken = self
                .jobs
                .iter()
                .filter(runs)
                .flat_map(|job| job.nodes.iter().copied())
                .collect::<Vec<_>>();
            let free = (1..=self.settings.n_nodes)
                .filter(|node| !taken.contains(node) && !self.down.contains(node))
                .filter(|node| !request.exclude.contains(&format!("n{node}")))
                .take(request.n_nodes as usize)
                .collect::<Vec<_>>();
            if free.len() < request.n_nodes as usize {
                "Resources".clone_into(&mut self.jobs[i].reason);
                continue;
            }
            let of_same_number = |(number, run): &(u64, usize)| {
                *number == self.jobs[i].number && self.runs[*run].ended.is_none()
            };
            if self.forgotten.iter().any(of_same_number) {
                // A forgotten job of this number still runs on the node: the new one is cancelled
                // as it starts, in the name of the controller's user.
                let (job, now) = (&mut self.jobs[i], self.now);
                (job.state, job.nodes, job.cancelled) = (SlurmState::Cancelled, free, true);
                (job.start, job.end) = (Some(now), Some(now));
                self.tell(i);
                continue;
            }
            let run = Run {
                name: request.name.clone(),
                element: self.jobs[i].array.map(|(_, element)| element),
                began: self.now,
                ended: None,
                completed: false,
            };
            self.runs.push(run);
            let (n_runs, now) = (self.runs.len(), self.now);
            let job = &mut self.jobs[i];
            (job.state, job.nodes, job.start, job.run) =
                (SlurmState::Running, free, Some(now), Some(n_runs - 1));
            "None".clone_into(&mut job.reason);
            self.tell(i);
        }
    }

    fn kill(&mut self, run: usize) {
        self.runs[run].ended.get_or_insert(self.now);
    }

    fn end(&mut self, i: usize, state: SlurmState, reason: &str, (code, signal): (u8, u8)) {
        let now = self.now;
        let job = &mut self.jobs[i];
        (job.state, job.end, job.code, job.signal) = (state, Some(now), code, signal);
        reason.clone_into(&mut job.reason);
        // A held job that was cancelled is never in the database.
        if !(job.start.is_none() && job.request.held) {
            self.tell(i);
        }
    }

    fn tell(&mut self, i: usize) {
        self.told.push((self.now, self.jobs[i].clone()));
    }

    fn cancel(&mut self, i: usize) {
        if self.jobs[i].state.bearing() == Liveness::Ended {
            return;
        }
        if let Some(run) = self.jobs[i].run {
            self.kill(run);
        }
        self.jobs[i].cancelled = true;
        let reason = self.jobs[i].reason.clone();
        self.end(i, SlurmState::Cancelled, &reason, (0, 0));
    }

    /// Takes a node away from Slurm. Its jobs end as NODE_FAIL, or are queued again under the same
    /// number. Their processes live on.
    pub fn lose_node(&mut self, node: u32) {
        self.down.push(node);
        for i in 0..self.jobs.len() {
            if self.jobs[i].state != SlurmState::Running || !self.jobs[i].nodes.contains(&node) {
                continue;
            }
            let again = self.jobs[i].request.requeue;
            let mut queued = self.jobs[i].clone();
            self.end(i, SlurmState::NodeFail, "NodeDown", (0, 0));
            if again {
                (queued.state, queued.start, queued.nodes, queued.run) =
                    (SlurmState::Pending, None, Vec::new(), None);
                (queued.submitted, queued.reason) = (self.now, "BeginTime".to_owned());
                self.jobs[i] = queued;
                self.tell(i);
            }
        }
    }

    /// Gives a node back to Slurm.
    pub fn return_node(&mut self, node: u32) {
        self.down.retain(|down| *down != node);
    }

    /// Kills the controller and restarts it with its saved state. It does not know the jobs of the
    /// last five seconds, hands out their numbers again, and kills none of their processes: a new
    /// job with the number of one that still runs is cancelled as it starts. Older jobs that began
    /// in these five seconds are queued once more.
    pub fn crash_controller(&mut self) {
        let saved = self.now - 5;
        let lost = self.jobs.iter().filter(|job| job.submitted >= saved);
        self.forgotten
            .extend(lost.filter_map(|job| Some((job.number, job.run?))));
        self.jobs.retain(|job| job.submitted < saved);
        self.next_number = self.jobs.iter().map(|job| job.number).max().unwrap_or(0) + 1;
        for job in &mut self.jobs {
            if job.state == SlurmState::Running && job.start.is_some_and(|start| start >= saved) {
                if let Some(run) = job.run.take() {
                    // Killed as an orphan when its node registers again.
                    self.runs[run].ended.get_or_insert(self.now);
                }
                (job.state, job.start, job.nodes) = (SlurmState::Pending, None, Vec::new());
            }
        }
    }

    /// Preempts the running jobs of this name.
    pub fn preempt(&mut self, name: &str) {
        for i in 0..self.jobs.len() {
            if self.jobs[i].request.name == name && self.jobs[i].state == SlurmState::Running {
                if let Some(run) = self.jobs[i].run {
                    self.kill(run);
                }
                self.end(i, SlurmState::Preempted, "None", (0, 0));
            }
        }
    }
}
