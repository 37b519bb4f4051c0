//! What the engine tells whoever watches: typed, so that a terminal, a log and a test see the same.

use cardiotwin_schemas::failure::Failure;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::Step1Summary;
use cardiotwin_workflow::patient::Patient;

/// Where events go; the engine never waits for a reader, and goes on when there is none.
pub type EventSender = tokio::sync::mpsc::UnboundedSender<EngineEvent>;

/// Something worth telling.
#[derive(Debug, Clone, PartialEq)]
pub enum EngineEvent {
    /// The loop begins.
    Started {
        /// Patients of the cohort.
        patients: usize,
        /// Those that are over already and stay as they are.
        settled: usize,
        /// Attempts that outlived an earlier coordinator and were adopted.
        adopted: usize,
    },
    /// An attempt at a patient's task was handed to the executor.
    TaskStarted {
        /// Who.
        patient: PatientId,
        /// Where: `step-1 iteration 3`.
        step: String,
        /// Which try.
        generation: u32,
    },
    /// How far a running task is.
    Progress {
        /// Who.
        patient: PatientId,
        /// Where.
        step: String,
        /// What is being done.
        phase: String,
        /// Units of work done.
        done: f64,
        /// Units of work in all, where known.
        total: Option<f64>,
        /// For a person.
        note: String,
    },
    /// A patient's task was published.
    TaskPublished {
        /// Who.
        patient: PatientId,
        /// Where.
        step: String,
        /// For a person: `cost 0.043`.
        note: String,
    },
    /// An attempt failed; the task is tried again where the failure's class allows it.
    AttemptFailed {
        /// Who.
        patient: PatientId,
        /// Where.
        step: String,
        /// Which try.
        generation: u32,
        /// Why.
        failure: Failure,
        /// Whether another try follows by itself.
        retried: bool,
    },
    /// Step 1 ended for a patient.
    Step1Ended {
        /// Who.
        patient: PatientId,
        /// How.
        summary: Step1Summary,
    },
    /// A patient's chain ended.
    PatientEnded {
        /// Who.
        patient: PatientId,
        /// How.
        ending: PatientEnding,
        /// Patients over, this one included.
        over: usize,
        /// Patients worked on.
        of: usize,
    },
    /// A request of another process was taken up.
    Request {
        /// What followed.
        text: String,
    },
    /// A stop was asked for.
    Stopping {
        /// Tasks still running.
        running: usize,
        /// Whether they are given time to finish.
        draining: bool,
    },
}

/// How a patient's chain ended.
#[derive(Debug, Clone, PartialEq)]
pub enum PatientEnding {
    /// All steps done.
    Done,
    /// Held by a failure.
    Failed(Failure),
    /// A person ended it.
    Cancelled,
}

/// What a run did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunSummary {
    /// Patients worked on.
    pub patients: usize,
    /// Of these, all steps done.
    pub done: usize,
    /// Held by a failure.
    pub failed: usize,
    /// Ended by a person.
    pub cancelled: usize,
    /// Not over: the run was stopped.
    pub unfinished: usize,
    /// Attempts handed to the executor by this run.
    pub submitted: u64,
    /// Tasks published by this run.
    pub published: u64,
    /// Whether the run was stopped before its end.
    pub stopped: bool,
    /// Wall time.
    pub wall_s: f64,
    /// Whether tasks are jobs of a cluster.
    pub cluster: bool,
    /// Jobs on a cluster that are not over.
    pub jobs: usize,
}

impl RunSummary {
    /// Counts patients by what became of them.
    pub(super) fn count<'a>(&mut self, patients: impl Iterator<Item = &'a Patient>) {
        for state in patients {
            self.patients += 1;
            match state {
                Patient::Done => self.done += 1,
                Patient::Failed { .. } => self.failed += 1,
                Patient::Cancelled { .. } => self.cancelled += 1,
                _ => self.unfinished += 1,
            }
        }
    }

    /// Whether the run goes on without this process.
    #[must_use]
    pub fn on_cluster(&self) -> bool {
        self.cluster && (self.jobs > 0 || self.unfinished > 0)
    }

    /// Whether everything had been done before.
    #[must_use]
    pub fn nothing_to_do(&self) -> bool {
        self.submitted == 0 && self.published == 0 && self.unfinished == 0
    }
}
