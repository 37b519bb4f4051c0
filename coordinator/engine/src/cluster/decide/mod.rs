//! The state that decisions of a tick read and change, and the order in which they are made.
//!
//! ```text
//!  observation ──► decide ──┬──► a question: look, and decide again with the answer
//!                           └──► commit ──► effects ──► their results are the next observation
//! ```
//! Nothing here reads a file or a clock, or runs a command. [`State::decide`] therefore gives the same
//! result for the same state and observation.

mod breaker;
mod effects;
mod follow;
mod inquiry;
mod jobs;
mod linger;
mod observation;
mod outbox;
mod placement;
mod settle;
#[cfg(test)]
mod tests;

use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;

use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::answers::Table;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::job::JobId;
use cardiotwin_slurm::site::Site;
use cardiotwin_store::cluster_jobs::ClusterReport;
use cardiotwin_workflow::task::Task;

use super::waiting::{present_task, waiting, wants_place};
use crate::EngineError;
use crate::books::Books;
use crate::decider::Decider;
use crate::dispatch::AttemptFindings;
use crate::mesh_size::MeshSizes;
use crate::requests::{self, Pending};
pub use effects::{Effect, EffectResult, ElementId, SubmissionResult};
use inquiry::Inquiry;
pub use observation::{
    AttemptRemains, AttemptSeen, DriverReport, DriverReports, ElementFiles, Observation, Question,
    Remains, SiteSeen, Traces,
};

/// What the decisions of a tick have reached, in this order. A quiet tick passes over the phases
/// that have effects of their own, except the last one.
#[derive(Debug, PartialEq, Eq)]
pub enum Phase {
    /// Requests of other processes are taken up.
    Requests,
    /// Effect: the files of applied requests are removed.
    RequestRemoval(Vec<PathBuf>),
    /// The chains of all patients are followed through the directories of their attempts.
    Chains,
    /// The words of drivers are taken up.
    DriverReports,
    /// The queue is asked, if a job is live or a patient wants a place.
    Queue,
    /// Accounting is asked about elements whose fate the queue does not show.
    Accounting,
    /// The traces of elements are read that have ended by Slurm's account.
    Traces,
    /// The states of elements follow.
    JobStates,
    /// Effect: elements that ended are fenced, so that they begin nothing more.
    Fences(Vec<ElementId>),
    /// The chains of the patients of fenced elements are followed to their last attempts.
    LastAttempts(Vec<ElementId>),
    /// Attempts that the fenced elements left unfinished are chosen.
    Unfinished(Vec<ElementId>),
    /// Effect: these attempts are revoked, so that they publish nothing more.
    Revocations(Vec<ElementId>, Vec<(String, AttemptId)>),
    /// The chains of the same patients are followed to what was published before.
    LastOutcomes(Vec<ElementId>),
    /// Consequences for these patients are decided.
    Settlement(Vec<ElementId>),
    /// The site's limits and the sizes of meshes are learned, if patients are to be placed.
    Site {
        /// Whether jobs ended, whose patients may want another one.
        has_ends: bool,
    },
    /// Unwanted jobs are cancelled, and waiting patients are placed in jobs.
    Placement,
    /// Effect: actions of committed batches are executed, up to the next submission.
    Outbox,
    /// The tick is over.
    Over,
}

/// An attempt that was stopped.
#[derive(Debug)]
pub struct StoppedAttempt {
    /// Number of the action that stopped it.
    pub action: i64,
    pub attempt: AttemptId,
    /// Evidence that it published before.
    pub published: Option<AttemptFindings>,
}

/// Identity of this process, for names of jobs and for judging who cancelled a job.
#[derive(Debug, Clone, Copy)]
pub struct ProcessIdentity {
    pub pid: u32,
    pub uid: u32,
}

/// State of a run whose tasks are jobs of a cluster.
pub struct State {
    pub books: Books,
    pub decider: Decider,
    pub site: Site,
    pub settings: ExecutorSettings,
    pub report: ClusterReport,
    pub process: ProcessIdentity,
    pub phase: Phase,
    /// Answer of squeue in this tick; `None` if it was not asked or did not answer.
    pub queue: Option<Table<QueueRow>>,
    /// Whether the site reported that it has no accounting.
    pub no_accounting: bool,
    pub mesh_sizes: MeshSizes,
    /// Number of elements submitted by this process.
    pub submitted: u64,
    /// Number of job names made by this process.
    pub names: u32,
    /// Whether elements that outlive their drivers are cancelled at once, without a grace time.
    pub ends_all: bool,
    /// Elements that outlived their drivers, to be cancelled after the commit.
    pub lingering: Vec<JobId>,
    /// Whether the queue is full or Slurm does not answer, so that further jobs wait for the next
    /// tick.
    pub takes_no_jobs: bool,
    /// Attempts that were stopped in this tick.
    pub stopped: Vec<StoppedAttempt>,
    /// Patients whose chains are still to be followed in this phase.
    pub to_follow: VecDeque<usize>,
    /// Answers about jobs in this tick.
    pub inquiry: Inquiry,
    /// What was left of the jobs that ended.
    pub remains: Remains,
}

/// State of the decisions after one step.
enum Progress {
    /// The decisions need an answer.
    Needs(Question),
    /// The next phase has begun.
    Continues,
    /// The decisions are complete: commit, and execute the effects.
    Complete,
}

impl State {
    pub fn new(
        (books, decider): (Books, Decider),
        site: Site,
        settings: ExecutorSettings,
        report: ClusterReport,
        process: ProcessIdentity,
    ) -> Self {
        Self {
            books,
            decider,
            site,
            settings,
            report,
            process,
            phase: Phase::Over,
            queue: None,
            no_accounting: false,
            mesh_sizes: MeshSizes::default(),
            submitted: 0,
            names: 0,
            ends_all: false,
            lingering: Vec::new(),
            takes_no_jobs: false,
            stopped: Vec::new(),
            to_follow: VecDeque::new(),
            inquiry: Inquiry::default(),
            remains: Remains::default(),
        }
    }

    /// Begins a tick.
    pub fn begin_tick(&mut self, now_ms: i64) {
        self.books.set_now_ms(now_ms);
        self.phase = Phase::Requests;
    }

    /// Begins to examine attempts and jobs.
    pub fn begin_examination(&mut self) {
        self.phase = Phase::Chains;
        self.to_follow = (0..self.books.patients().len()).collect();
    }

    /// Decides what follows from an observation. Returns what has to be observed before the
    /// decisions are complete; `None` if they are.
    pub fn decide(&mut self, seen: Observation) -> Result<Option<Question>, EngineError> {
        self.take(seen)?;
        loop {
            let asked = self.decider.questions();
            if !asked.is_empty() {
                return Ok(Some(Question::Chain(asked)));
            }
            match self.proceed()? {
                Progress::Needs(question) => return Ok(Some(question)),
                Progress::Continues => {}
                Progress::Complete => return Ok(None),
            }
        }
    }

    /// Effects that follow from what was committed.
    pub fn effects(&self) -> Vec<Effect> {
        match &self.phase {
            Phase::RequestRemoval(paths) => vec![Effect::RemoveRequests(paths.clone())],
            Phase::Fences(ended) => ended.iter().cloned().map(Effect::Fence).collect(),
            Phase::Revocations(_, attempts) => {
                let revoke = |(job, attempt): &(String, AttemptId)| Effect::Revoke {
                    attempt: attempt.clone(),
                    reason: format!("job {job} ended"),
                };
                attempts.iter().map(revoke).collect()
            }
            Phase::Outbox => self.outbox_effects(),
            _ => Vec::new(),
        }
    }

    fn take(&mut self, seen: Observation) -> Result<(), EngineError> {
        match seen {
            Observation::Requests(pending) => self.take_requests(pending)?,
            Observation::Chain(files) => self.decider.answer(&mut self.books, files)?,
            Observation::Attempt(found) => self.take_attempt(found)?,
            Observation::DriverReports(reports) => self.take_driver_reports(reports)?,
            Observation::Queue(answer) => self.take_queue(answer),
            Observation::Accounting(answer) => self.take_accounting(answer),
            Observation::Traces(traces) => self.inquiry.traces = traces,
            Observation::Remains(remains) => self.remains = remains,
            Observation::Site(seen) => {
                if let Some((config, qos)) = seen.limits {
                    self.site.discover(config.as_ref(), &qos);
                }
                self.mesh_sizes.extend(seen.mesh_nodes);
            }
            Observation::Results(results) => self.take_results(results)?,
        }
        Ok(())
    }

    fn take_requests(&mut self, pending: Vec<Pending>) -> Result<(), EngineError> {
        if pending.is_empty() {
            self.begin_examination();
            return Ok(());
        }
        let (events, applied) = requests::apply(&mut self.books, &mut self.decider, pending)?;
        events
            .into_iter()
            .for_each(|event| self.decider.tell(event));
        self.phase = Phase::RequestRemoval(applied);
        Ok(())
    }

    /// Takes up the results of effects, which ends the phase that had them.
    fn take_results(&mut self, results: Vec<EffectResult>) -> Result<(), EngineError> {
        let was_submitting = results.iter().any(EffectResult::is_submission);
        for result in results {
            self.take_result(result)?;
        }
        match std::mem::replace(&mut self.phase, Phase::Over) {
            Phase::RequestRemoval(_) => self.begin_examination(),
            Phase::Fences(ended) => {
                self.follow_patients_of(&ended);
                self.phase = Phase::LastAttempts(ended);
            }
            Phase::Revocations(ended, _) => {
                self.follow_patients_of(&ended);
                self.phase = Phase::LastOutcomes(ended);
            }
            // Each submission is committed before the next one.
            Phase::Outbox if was_submitting => self.phase = Phase::Outbox,
            Phase::Outbox => {
                self.lingering.clear();
                self.take_stopped()?;
            }
            other => self.phase = other,
        }
        Ok(())
    }

    /// One step from phase to phase.
    fn proceed(&mut self) -> Result<Progress, EngineError> {
        if let Some(question) = self.next_attempt() {
            return Ok(Progress::Needs(question));
        }
        match std::mem::replace(&mut self.phase, Phase::Over) {
            Phase::Chains => self.phase = Phase::DriverReports,
            Phase::DriverReports => {
                self.queue = None;
                self.inquiry = Inquiry::default();
                self.phase = Phase::Queue;
                return Ok(Progress::Needs(self.driver_report_question()));
            }
            Phase::Queue if self.wants_queue() => {
                self.phase = Phase::Accounting;
                return Ok(Progress::Needs(Question::Queue));
            }
            Phase::Queue => self.phase = self.after_jobs(),
            Phase::Accounting => {
                self.phase = Phase::Traces;
                return Ok(asks(self.accounting_question()));
            }
            Phase::Traces => {
                self.phase = Phase::JobStates;
                return Ok(asks(self.trace_question()));
            }
            Phase::JobStates => {
                self.take_job_states()?;
                self.phase = self.after_jobs();
            }
            Phase::LastAttempts(ended) => {
                let question = Question::Remains {
                    attempts: self.attempts_of(&ended),
                    elements: Vec::new(),
                };
                self.phase = Phase::Unfinished(ended);
                return Ok(Progress::Needs(question));
            }
            Phase::Unfinished(ended) => {
                let unfinished = self.unfinished(&ended);
                self.phase = Phase::Revocations(ended, unfinished);
            }
            Phase::LastOutcomes(ended) => {
                let question = Question::Remains {
                    attempts: self.attempts_of(&ended),
                    elements: self.files_of(ended.iter().cloned()),
                };
                self.phase = Phase::Settlement(ended);
                return Ok(Progress::Needs(question));
            }
            Phase::Settlement(ended) => {
                self.settle_all(&ended)?;
                self.phase = Phase::Site { has_ends: true };
            }
            Phase::Site { has_ends } => {
                self.phase = Phase::Placement;
                return Ok(asks(self.site_question(has_ends)?));
            }
            Phase::Placement => {
                self.cancel_unwanted()?;
                self.place()?;
                self.takes_no_jobs = self.leaves_slurm_alone();
                self.phase = Phase::Outbox;
            }
            waits_for_results => {
                self.phase = waits_for_results;
                return Ok(Progress::Complete);
            }
        }
        Ok(match self.phase {
            Phase::Fences(_) | Phase::Revocations(..) | Phase::Outbox => Progress::Complete,
            _ => Progress::Continues,
        })
    }

    /// Phase after the jobs were examined.
    fn after_jobs(&self) -> Phase {
        let ended = self.ended_elements();
        if ended.is_empty() {
            Phase::Site { has_ends: false }
        } else {
            Phase::Fences(ended)
        }
    }

    fn follow_patients_of(&mut self, ended: &[ElementId]) {
        self.to_follow = ended.iter().flat_map(|id| self.patients_of(id)).collect();
    }

    /// Present attempts of the patients of elements.
    fn attempts_of(&self, ended: &[ElementId]) -> Vec<AttemptId> {
        let patients = ended.iter().flat_map(|id| self.patients_of(id));
        patients.filter_map(|i| self.present_attempt(i)).collect()
    }

    /// The attempt at a patient's present task.
    fn present_attempt(&self, i: usize) -> Option<AttemptId> {
        let task = present_task(&self.books, i)?;
        match self.books.task(&task)?.state {
            Task::Attempting { generation, .. } => Some(AttemptId { task, generation }),
            _ => None,
        }
    }

    /// Asks for the site's limits where patients are about to be placed in jobs, and for the sizes
    /// of the meshes of those who may be.
    fn site_question(&self, has_ends: bool) -> Result<Option<Question>, EngineError> {
        let mut meshes = BTreeSet::new();
        for (i, patient) in self.books.patients().iter().enumerate() {
            let may_want = has_ends && patient.selected && !patient.row.state.is_final();
            if may_want || wants_place(&self.books, i) {
                let unknown = self.mesh_sizes.unknown(self.books.plan(i)?);
                meshes.extend(unknown);
            }
        }
        let wants_limits = has_ends || !waiting(&self.books).is_empty();
        let meshes: Vec<PathBuf> = meshes.into_iter().collect();
        let is_needed = wants_limits || !meshes.is_empty();
        Ok(is_needed.then_some(Question::Site {
            wants_limits,
            meshes,
        }))
    }
}

fn asks(question: Option<Question>) -> Progress {
    question.map_or(Progress::Continues, Progress::Needs)
}
