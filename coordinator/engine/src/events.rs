//! Events that the engine sends to its observer. They are typed, so that a terminal, a log and a
//! test see the same.

use cardiotwin_schemas::failure::Failure;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::Step1Summary;
use cardiotwin_store::Waiting;
use cardiotwin_workflow::patient::Patient;

/// Sender of the events. The engine never waits for a receiver and continues without one.
pub type EventSender = tokio::sync::mpsc::UnboundedSender<EngineEvent>;

/// An event of the engine.
#[derive(Debug, Clone, PartialEq)]
pub enum EngineEvent {
    /// The loop has begun.
    Started {
        /// Number of patients of the cohort that are worked on.
        patients: usize,
        /// Number of patients that were over before.
        settled: usize,
        /// Number of attempts that outlived an earlier coordinator and were adopted.
        adopted: usize,
    },
    /// An attempt at a patient's task was handed to the executor.
    TaskStarted {
        /// Patient that waits for the task.
        patient: PatientId,
        /// Step of the chain, such as `step-1 iteration 3`.
        step: String,
        /// Generation of the attempt, from 1.
        generation: u32,
    },
    /// A running task reported progress.
    Progress {
        /// Patient that waits for the task.
        patient: PatientId,
        /// Step of the chain.
        step: String,
        /// Phase of the task.
        phase: String,
        /// Units of work done.
        done: f64,
        /// Units of work in all, where known.
        total: Option<f64>,
        /// Remark for a person.
        note: String,
    },
    /// A patient's task was published.
    TaskPublished {
        /// Patient that waited for the task.
        patient: PatientId,
        /// Step of the chain.
        step: String,
        /// Remark for a person, such as `cost 0.043`.
        note: String,
    },
    /// An attempt failed. The task is tried again if the class of the failure allows it.
    AttemptFailed {
        /// Patient that waits for the task.
        patient: PatientId,
        /// Step of the chain.
        step: String,
        /// Generation of the attempt, from 1.
        generation: u32,
        /// Class and message of the failure.
        failure: Failure,
        /// Whether another attempt follows without a request.
        retried: bool,
    },
    /// Step 1 ended for a patient.
    Step1Ended {
        /// Patient whose step 1 ended.
        patient: PatientId,
        /// Ending, best iteration and its parameters.
        summary: Step1Summary,
    },
    /// A patient's chain ended.
    PatientEnded {
        /// Patient whose chain ended.
        patient: PatientId,
        /// Ending of the chain.
        ending: PatientEnding,
        /// Number of patients that are over, this one included.
        over: usize,
        /// Number of patients that are worked on.
        of: usize,
    },
    /// Patients of the run are no longer in the cohort's folder.
    Vanished {
        /// Patients whose folders vanished since the last command.
        patients: Vec<PatientId>,
    },
    /// A request of another process was applied or refused.
    Request {
        /// Effects of the request, or the reason of the refusal.
        text: String,
    },
    /// Another program has locked the database, and the engine waits for it.
    DatabaseLocked {
        /// For whom, and since when.
        waiting: Waiting,
    },
    /// The engine was asked to stop.
    Stopping {
        /// Number of attempts that are not over.
        running: usize,
        /// Whether they may finish first.
        draining: bool,
    },
}

/// Ending of a patient's chain.
#[derive(Debug, Clone, PartialEq)]
pub enum PatientEnding {
    /// All steps are done.
    Done,
    /// A failure holds the chain.
    Failed(Failure),
    /// A person cancelled it.
    Cancelled,
}

/// Summary of what a run did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunSummary {
    /// Number of patients that were worked on.
    pub patients: usize,
    /// Number of patients whose steps are all done.
    pub done: usize,
    /// Number of patients held by a failure.
    pub failed: usize,
    /// Number of patients cancelled by a person.
    pub cancelled: usize,
    /// Number of patients that are not over.
    pub unfinished: usize,
    /// Number of these patients that wait for pilots of whom none ends without a person.
    pub held: usize,
    /// Number of attempts, or of elements of jobs, that this run submitted.
    pub submitted: u64,
    /// Number of tasks that this run published.
    pub published: u64,
    /// Whether the run was stopped before its end.
    pub stopped: bool,
    /// Duration of the run by the clock \[s\].
    pub wall_s: f64,
    /// Whether tasks are jobs of a cluster.
    pub cluster: bool,
    /// Number of elements of jobs on the cluster that are not over.
    pub jobs: usize,
}

impl RunSummary {
    /// Counts patients by their states.
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

    /// Whether the run continues on the cluster without this process.
    #[must_use]
    pub fn on_cluster(&self) -> bool {
        self.cluster && (self.jobs > 0 || self.unfinished > self.held)
    }

    /// Whether everything had been done before this run.
    #[must_use]
    pub fn nothing_to_do(&self) -> bool {
        self.submitted == 0 && self.published == 0 && self.unfinished == 0
    }
}
