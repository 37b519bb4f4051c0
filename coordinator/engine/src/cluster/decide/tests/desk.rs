//! A state with invented answers to its questions.

use std::collections::{BTreeMap, HashMap};

use cardiotwin_schemas::allocation::{AttemptAllocation, DriverEnd, DriverEnding};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::TaskOutcome;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::provenance::Provenance;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::answers::accounting::AccountingRow;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::answers::{Exit, NoAnswer, Output, Table};
use cardiotwin_slurm::job::{JobId, Jobs};
use cardiotwin_slurm::site::Site;
use cardiotwin_slurm::state::SlurmState;
use cardiotwin_store::Loaded;
use cardiotwin_workflow::patient::Patient;

use super::super::{
    AttemptRemains, AttemptSeen, DriverReport, DriverReports, Effect, EffectResult, ElementId,
    Observation, Phase, ProcessIdentity, Question, Remains, SiteSeen, State, SubmissionResult,
    Traces,
};
use crate::books::Books;
use crate::decider::Decider;
use crate::dispatch::AttemptFindings;
use crate::tests::scripted::Script;

pub const UID: u32 = 1001;
/// A site that allows no arrays, so that each patient is a job of its own.
const SITE: &str = "name = 'desk'\ndescription = ''\nscheduler = 'slurm'\n\
    arrays = { allowed = false, max_size = 1 }\n\
    node = { cores = 4, memory_mib = 8000, unit = 'core' }\n\
    [[queue]]\nname = 'q'\nqos = 'normal'\nuses = ['chunks', 'simulations']\nwalltime = '01:00:00'\n";

pub struct Desk {
    pub state: State,
    pub queue: Result<Vec<QueueRow>, NoAnswer>,
    pub accounting: Result<Vec<AccountingRow>, NoAnswer>,
    pub sbatch: Output,
    pub log_tail: String,
    /// What is seen of attempts after they were revoked, the first first.
    pub after_revocation: Vec<AttemptSeen>,
    /// Job that began each attempt.
    begun: HashMap<AttemptId, String>,
    revoked: Vec<AttemptId>,
    reports: BTreeMap<ElementId, DriverReport>,
    now_ms: i64,
}

impl Desk {
    /// Patients of half an hour each, who wait for their first jobs.
    pub fn new(n_patients: usize) -> Self {
        let loaded = Loaded {
            meta: HashMap::new(),
            patients: Vec::new(),
            tasks: Vec::new(),
            attempts: Vec::new(),
            steps: HashMap::new(),
            outbox: Vec::new(),
            jobs: Vec::new(),
            allotments: HashMap::new(),
        };
        let mut books = Books::new("/nowhere/run".as_ref(), loaded, 0).unwrap();
        let mut decider = Decider::new(2);
        let plans: Vec<ResolvedPatient> = (1..=n_patients)
            .map(|n| ResolvedPatient::noop(&format!("P{n:02}"), 600_000))
            .collect();
        decider.take_up(&mut books, &plans, &[], &[]).unwrap();
        books.select(|_| true);
        books.jobs_mut().place_patients();
        for i in 0..n_patients {
            books.await_present_task(i);
            decider.decide(&mut books, i).unwrap();
        }
        assert!(decider.questions().is_empty());
        let settings = ExecutorSettings {
            site_retries: 2,
            ..ExecutorSettings::default()
        };
        let site = Site::read("desk", SITE).unwrap();
        let process = ProcessIdentity { pid: 7, uid: UID };
        Self {
            state: State::new(
                (books, decider),
                site,
                settings,
                Default::default(),
                process,
            ),
            queue: Ok(Vec::new()),
            accounting: Ok(Vec::new()),
            sbatch: Output {
                exit: Exit::Code(0),
                stdout: "16\n".to_owned(),
                stderr: String::new(),
            },
            log_tail: String::new(),
            after_revocation: Vec::new(),
            begun: HashMap::new(),
            revoked: Vec::new(),
            reports: BTreeMap::new(),
            now_ms: 1_700_000_000_000,
        }
    }

    pub fn pass(&mut self, seconds: i64) {
        self.now_ms += seconds * 1000;
    }

    /// One tick. Returns the effects of each of its turns.
    pub fn tick(&mut self) -> Vec<Vec<Effect>> {
        self.state.begin_tick(self.now_ms);
        let mut turns = self.turns(Observation::Requests(Vec::new()));
        if !self.state.ended_elements().is_empty() {
            self.state.begin_examination();
            turns.extend(self.turns(Observation::Results(Vec::new())));
        }
        turns
    }

    /// Executes the present effects and takes the turns that follow.
    pub fn finish(&mut self) -> Vec<Vec<Effect>> {
        let effects = self.state.effects();
        let results = effects.iter().filter_map(|effect| self.execute(effect));
        let results = Observation::Results(results.collect());
        let mut turns = vec![effects];
        turns.extend(self.turns(results));
        turns
    }

    fn turns(&mut self, mut seen: Observation) -> Vec<Vec<Effect>> {
        let mut turns = Vec::new();
        loop {
            while let Some(question) = self.state.decide(seen).unwrap() {
                seen = self.answer(question);
            }
            self.state.books.flush();
            if self.state.phase == Phase::Over {
                return turns;
            }
            let effects = self.state.effects();
            let results = effects.iter().filter_map(|effect| self.execute(effect));
            seen = Observation::Results(results.collect());
            turns.push(effects);
        }
    }

    fn answer(&mut self, question: Question) -> Observation {
        match question {
            Question::Chain(asked) => panic!("a no-op asks for no file: {asked:?}"),
            Question::Attempt { attempt, is_begun } => {
                Observation::Attempt(self.look_at(&attempt, is_begun))
            }
            Question::DriverReports { elements, .. } => {
                let report = |id: &ElementId| self.reports.get(id).cloned().unwrap_or_default();
                let elements = elements.into_iter().map(|(files, _)| {
                    let report = report(&files.id);
                    (files.id, report)
                });
                Observation::DriverReports(DriverReports {
                    elements: elements.collect(),
                    submitting: Vec::new(),
                })
            }
            Question::Queue => Observation::Queue(self.queue.clone().map(table)),
            Question::Accounting { .. } => {
                Observation::Accounting(self.accounting.clone().map(table))
            }
            Question::Traces(elements) => {
                let traces = Traces {
                    started: vec![true],
                    ends: vec![None],
                    asked_to_end: false,
                    log_tail: self.log_tail.clone(),
                };
                let traces = elements.into_iter().map(|files| (files.id, traces.clone()));
                Observation::Traces(traces.collect())
            }
            Question::Remains { attempts, .. } => Observation::Remains(Remains {
                attempts: attempts
                    .into_iter()
                    .map(|attempt| {
                        let remains = AttemptRemains {
                            job: self.begun.get(&attempt).cloned(),
                            is_revoked: self.revoked.contains(&attempt),
                            has_checkpoint: false,
                        };
                        (attempt, remains)
                    })
                    .collect(),
                driver_ends: BTreeMap::new(),
            }),
            Question::Site { .. } => Observation::Site(SiteSeen::default()),
        }
    }

    fn look_at(&mut self, attempt: &AttemptId, is_begun: bool) -> AttemptSeen {
        if is_begun && self.revoked.contains(attempt) && !self.after_revocation.is_empty() {
            return self.after_revocation.remove(0);
        }
        match self.begun.get(attempt) {
            Some(job) if !is_begun => AttemptSeen::Begun(Some(AttemptAllocation {
                job: job.clone(),
                element: 0,
                id: None,
            })),
            _ => AttemptSeen::Nothing,
        }
    }

    fn execute(&mut self, effect: &Effect) -> Option<EffectResult> {
        Some(match effect.clone() {
            Effect::RemoveRequests(_) | Effect::Fence(_) | Effect::CancelLingering(_) => {
                return None;
            }
            Effect::Revoke { attempt, .. } => {
                self.revoked.push(attempt);
                return None;
            }
            Effect::FenceByAction { action, .. }
            | Effect::WriteOverlay { action, .. }
            | Effect::Nothing { action } => EffectResult::Done(action),
            Effect::Stop { action, attempt } => EffectResult::Stopped {
                action,
                attempt,
                published: None,
            },
            Effect::Submit { action, job } => EffectResult::Submitted {
                action,
                job,
                answer: SubmissionResult::Answered(self.sbatch.clone()),
            },
            Effect::Cancel { actions, .. } => EffectResult::Cancelled {
                actions,
                accepted: true,
            },
        })
    }

    /// Submits, and lets each job begin its patient's attempt. Returns the name of the first
    /// patient's job.
    pub fn run_first_job(&mut self) -> String {
        self.tick();
        for i in 0..self.state.books.patients().len() {
            let job = job_name(self, i);
            let Patient::Working { task, .. } = &self.state.books.patient(i).row.state else {
                panic!("it waits for a task")
            };
            let attempt = AttemptId {
                task: task.clone(),
                generation: 1,
            };
            self.begun.insert(attempt, job);
        }
        let names = (0..self.state.books.patients().len()).map(|i| job_name(self, i));
        let running = names.map(|name| queued(&name, &SlurmState::Running, "None"));
        self.queue = Ok(running.collect());
        self.pass(10);
        assert_eq!(self.tick().concat(), []);
        job_name(self, 0)
    }

    /// The driver of a job reports that it ended in order.
    pub fn report_end(&mut self, job: &str) {
        let end = DriverEnd {
            at: String::new(),
            because: DriverEnding::Finished,
            left: BTreeMap::new(),
            defects: Default::default(),
            wall_s: 5.0,
        };
        let report = DriverReport {
            ends: Some(vec![end]),
            ..DriverReport::default()
        };
        self.reports.insert((job.to_owned(), 0), report);
    }

    /// Evidence that an attempt succeeded.
    pub fn success(&self, attempt: &AttemptId) -> AttemptFindings {
        let spec = &self.state.books.tasks()[&attempt.task].spec;
        let outcome = TaskOutcome {
            schema_version: formats::OUTCOME.version,
            attempt: attempt.clone(),
            ending: Script::default().ending(&serde_json::from_str(spec).unwrap()),
            artefacts: Vec::new(),
            provenance: Provenance::default(),
            sha256: None,
        };
        AttemptFindings::Outcome {
            text: serde_json::to_string(&outcome).unwrap(),
            outcome: Box::new(outcome),
        }
    }
}

/// Job in which a patient is placed.
pub fn job_name(desk: &Desk, i: usize) -> String {
    let id = desk.state.books.patient(i).row.id;
    desk.state.books.jobs().placed()[&id].0.clone()
}

/// A row of squeue.
pub fn queued(name: &str, state: &SlurmState, reason: &str) -> QueueRow {
    QueueRow {
        id: JobId::single(16),
        raw: 16,
        name: name.to_owned(),
        state: state.clone(),
        reason: reason.to_owned(),
        partition: "main".to_owned(),
        qos: "normal".to_owned(),
        account: String::new(),
        n_nodes: Some(1),
        n_cores: Some(1),
        nodes: "n4".to_owned(),
        submitted: Some(1),
        start: Some(2),
        end: Some(12),
        limit: None,
    }
}

/// A row of sacct.
pub fn accounted(
    name: &str,
    state: &SlurmState,
    reason: &str,
    cancelled_by: Option<u32>,
) -> AccountingRow {
    AccountingRow {
        jobs: Jobs::One(JobId::single(16)),
        raw: Some(16),
        name: name.to_owned(),
        state: state.clone(),
        cancelled_by,
        exit: None,
        reason: reason.to_owned(),
        submitted: Some(1),
        start: Some(2),
        end: Some(12),
        elapsed_s: Some(10),
        n_nodes: Some(1),
        n_cores: Some(1),
        nodes: "n4".to_owned(),
        partition: "main".to_owned(),
        qos: "normal".to_owned(),
    }
}

/// A command that does not answer.
pub fn silence(command: &'static str) -> NoAnswer {
    NoAnswer::Failed {
        command,
        exit: Exit::TimedOut,
        said: String::new(),
    }
}

fn table<Row>(rows: Vec<Row>) -> Table<Row> {
    Table {
        rows,
        unreadable: Vec::new(),
    }
}
