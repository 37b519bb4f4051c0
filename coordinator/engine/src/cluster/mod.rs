//! The coordinator's tick on a cluster: observe, decide, commit, act, and end. No process has to
//! stay alive between two ticks. A tick may be killed anywhere, and the next one continues.
//!
//! ```text
//!  observe: attempts and jobs by the files they left ([`follow`], [`observe`]); one squeue, at
//!           most one sacct
//!  decide:  chains as everywhere (`Decider`), consequences of ended jobs ([`settle`]), new jobs
//!           ([`place`])
//!  commit:  events, states, names of new jobs and actions, in one transaction
//!  act:     fences, scancel, sbatch ([`submit`])
//! ```
//! A quiet tick is one turn. Requests, jobs that ended and attempts that were stopped take a turn of
//! their own ([`Stage`]), because their consequences are decided after they are committed.

mod breaker;
mod disk_need;
mod examine;
mod expect;
mod follow;
mod linger;
mod observe;
mod place;
mod preview;
mod profile;
mod settle;
mod share;
mod standing;
mod submit;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::answers::{Output, Table};
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm::job::JobId;
use cardiotwin_slurm::site::Site;
use cardiotwin_store::Writer;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use super::books::{Books, TaskEntry};
use super::decider::Decider;
use super::files_seen::{Asked, FilesSeen};
use super::program_identity::DECIDED_BY;
use super::requests::Pending;
use super::surroundings::Surroundings;
use super::turn::{self, Engine};
use super::{
    EngineError, EventSender, RunSummary, StopLevel, StopSignal, requests, worker_identity,
};
use crate::dispatch::Evidence;
pub use cardiotwin_store::cluster_jobs::{ClusterReport, REPORT};

use crate::mesh_size::MeshSizes;
use cardiotwin_workflow::cluster_job::Element;
pub use disk_need::DiskNeed;
pub use examine::{QueueReport, SiteReport, examine_site};
use expect::Expectations;
pub use preview::{PlannedRow, PlannedRun, preview};
pub use profile::load_site;
pub use share::{NoQueue, without_queue};
use standing::Settlement;

/// Stages of a tick. A stage that finds nothing is skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Changes that other processes requested are applied.
    Requests,
    /// Attempts and jobs are examined; the ends of jobs are committed, then these jobs are revoked.
    Jobs,
    /// The patients of ended jobs are dealt with, and waiting patients are placed in jobs.
    Patients,
    /// The ends of attempts that were stopped are taken up.
    Effects,
    /// The tick is over.
    Over,
}

/// Number of the action that stopped an attempt, the attempt, and the evidence that was published
/// before.
type Stopped = (i64, AttemptId, Option<Evidence>);

/// Observation of a stage.
pub enum Seen {
    Requests(Vec<Pending>),
    /// Names and elements of jobs that ended.
    Ended(Vec<(String, usize)>),
    Settlements(Vec<Settlement>),
    Stopped(Vec<Stopped>),
    /// Files about which decisions asked.
    Files(FilesSeen),
}

impl From<FilesSeen> for Seen {
    fn from(seen: FilesSeen) -> Self {
        Self::Files(seen)
    }
}

/// A run whose tasks are jobs of a cluster.
pub struct Cluster<S> {
    books: Books,
    decider: Decider,
    writer: Writer,
    scheduler: S,
    site: Site,
    settings: ExecutorSettings,
    /// Path of the worker's executable, as compute nodes see it.
    worker: PathBuf,
    /// Path of this program, which is also the driver inside the allocations.
    program: PathBuf,
    events: EventSender,
    surroundings: Surroundings,
    /// Answer of squeue in this tick; `None` if it was not asked or did not answer.
    queue: Option<Table<QueueRow>>,
    /// Whether the site reported that it has no accounting.
    no_accounting: bool,
    report: ClusterReport,
    submitted: u64,
    /// Number of job names made by this process.
    names: u32,
    mesh_sizes: MeshSizes,
    stage: Stage,
    /// Files of requests that were applied, to be removed after the commit.
    applied_requests: Vec<PathBuf>,
    /// Names and elements of jobs to revoke after the commit.
    to_revoke: Vec<(String, usize)>,
    /// Elements that outlived their drivers, to be cancelled after the commit.
    lingering: Vec<JobId>,
    /// Whether such elements are cancelled at once, without a grace time.
    ends_all: bool,
    /// Attempts that were stopped in this tick.
    stopped: Vec<Stopped>,
}

impl<S: Scheduler> Cluster<S> {
    /// Wraps an opened run. `programs` are the paths of worker and driver as compute nodes see
    /// them.
    ///
    /// # Errors
    /// [`EngineError::Store`] if the store cannot be read or written.
    pub async fn new(
        (mut writer, mut books, decider): (Writer, Books, Decider),
        scheduler: S,
        site: Site,
        settings: ExecutorSettings,
        programs: (PathBuf, PathBuf),
        events: EventSender,
        surroundings: Surroundings,
    ) -> Result<Self, EngineError> {
        let host = cardiotwin_store::lock::host_name();
        let allocation = writer.cluster_allocation(&host, books.now_ms()).await?;
        books.set_allocation(allocation);
        let kinds: BTreeSet<&String> = books.tasks().values().map(|task| &task.kind).collect();
        let kinds: Vec<String> = kinds.into_iter().cloned().collect();
        let first = writer.first_outcomes(&kinds, expect::ENOUGH as u32).await?;
        books.note_wall_times(first);
        books.jobs_mut().place_patients();
        let before = writer
            .meta()
            .await?
            .remove(REPORT)
            .and_then(|text| serde_json::from_str(&text).ok());
        let mut report: ClusterReport = before.unwrap_or_default();
        if !programs.1.as_os_str().is_empty() {
            report.site.clone_from(&site.name);
            report.charge_per_node_hour = site.charge_per_node_hour;
            report.charge_unit.clone_from(&site.charge_unit);
        }
        let (worker, program) = programs;
        let (queue, no_accounting, submitted, names) = (None, false, 0, 0);
        Ok(Self {
            books,
            decider,
            writer,
            scheduler,
            site,
            settings,
            worker,
            program,
            events,
            surroundings,
            queue,
            no_accounting,
            report,
            submitted,
            names,
            mesh_sizes: MeshSizes::default(),
            stage: Stage::Requests,
            applied_requests: Vec::new(),
            to_revoke: Vec::new(),
            lingering: Vec::new(),
            ends_all: false,
            stopped: Vec::new(),
        })
    }

    /// One tick.
    ///
    /// # Errors
    /// Any [`EngineError`]; what was committed before stays committed.
    pub async fn tick(&mut self) -> Result<(), EngineError> {
        self.books.set_now_ms(self.surroundings.clock.now_ms());
        self.report.commands = 0;
        self.stage = Stage::Requests;
        turn::run(self).await?;
        // What Slurm refused for good is told at once: the next tick may be hours away.
        if self.ended_elements().is_empty() {
            return Ok(());
        }
        self.stage = Stage::Jobs;
        turn::run(self).await
    }

    /// Registers which patient waits for which task and decides for every patient that is not
    /// over, as every coordinator does first.
    ///
    /// - `refused`: refusal of a worker other than the run's, raised if a computation is needed
    pub async fn begin(&mut self, refused: Option<EngineError>) -> Result<(), EngineError> {
        for i in 0..self.books.patients().len() {
            self.books.await_present_task(i);
        }
        let settled = self.decider.over();
        let program = self.writer.meta().await?.remove(DECIDED_BY);
        self.decider
            .decide_all(&mut self.books, program.as_ref(), is_settled)?;
        self.complete_decisions().await?;
        worker_identity::need(refused, &self.books)?;
        let started = super::EngineEvent::Started {
            patients: self.decider.of(),
            settled,
            adopted: 0,
        };
        self.decider.tell_first(started);
        Ok(())
    }

    /// Answers the questions of decisions until they are complete.
    async fn complete_decisions(&mut self) -> Result<(), EngineError> {
        loop {
            let asked = self.decider.questions();
            if asked.is_empty() {
                return Ok(());
            }
            self.books.recall(&mut self.writer, &asked.tasks).await?;
            let seen = FilesSeen::look(asked.files);
            self.decider.answer(&mut self.books, seen)?;
        }
    }

    /// Ticks until every patient is over or `stop` is raised. The pause between two ticks doubles
    /// while nothing changes.
    ///
    /// # Errors
    /// As [`Cluster::tick`].
    pub async fn watch(&mut self, stop: &StopSignal) -> Result<(), EngineError> {
        let shortest = Duration::from_secs(self.site.poll.shortest_s);
        let longest = Duration::from_secs(self.site.poll.longest_s);
        let mut pause = shortest;
        loop {
            let before = (
                self.decider.published(),
                self.submitted,
                self.decider.over(),
            );
            self.tick().await?;
            self.writer.publish_snapshot().await?;
            if self.is_finished() || stop.level() > StopLevel::Run {
                return Ok(());
            }
            let changed = before
                != (
                    self.decider.published(),
                    self.submitted,
                    self.decider.over(),
                );
            pause = if changed {
                shortest
            } else {
                (pause * 2).min(longest)
            };
            tokio::select! {
                () = stop.raised_above(StopLevel::Run) => {}
                () = tokio::time::sleep(pause) => {}
            }
        }
    }

    /// Ticks until every job that was asked to end has ended, and no element outlives its driver.
    /// Returns whether nothing is left; `false` after a stop.
    ///
    /// # Errors
    /// As [`Cluster::tick`].
    pub async fn end_jobs(&mut self, stop: &StopSignal) -> Result<bool, EngineError> {
        self.ends_all = true;
        loop {
            self.tick().await?;
            let rows = self.books.jobs().rows().values();
            let ending = rows
                .flat_map(|row| &row.state.elements)
                .any(|e| *e == Element::Stopping);
            let is_over = !ending && self.books.outbox().is_empty() && !self.has_lingering();
            if is_over || stop.level() > StopLevel::Run {
                return Ok(is_over);
            }
            tokio::select! {
                () = stop.raised_above(StopLevel::Run) => {}
                () = tokio::time::sleep(Duration::from_secs(1)) => {}
            }
        }
    }

    /// Whether nothing is left to do: every selected patient is over, and no job is live.
    fn is_finished(&self) -> bool {
        let patients = self.books.patients().iter().enumerate();
        patients
            .filter(|(_, p)| p.selected)
            .all(|(i, p)| p.row.state.is_final() || self.books.waits_in_vain(i).unwrap_or(false))
            && self.books.jobs().rows().is_empty()
            && self.books.outbox().is_empty()
            && !self.has_lingering()
    }

    /// Passes a crash point.
    pub(super) fn pass(&self, place: &str) -> Result<(), EngineError> {
        self.surroundings.crash.pass(place)
    }

    /// Runs a command of the scheduler, between two crash points.
    pub(super) async fn run_command(&mut self, command: &Command) -> Result<Output, EngineError> {
        self.pass("before a command")?;
        let output = self.scheduler.ask(command).await;
        self.pass("after a command")?;
        Ok(output)
    }

    fn take_requests(&mut self, pending: Vec<Pending>) -> Result<(), EngineError> {
        let (told, applied) = requests::apply(&mut self.books, &mut self.decider, pending)?;
        told.into_iter().for_each(|event| self.decider.tell(event));
        self.applied_requests = applied;
        Ok(())
    }

    fn remove_applied_requests(&mut self) -> Result<(), EngineError> {
        requests::remove(&std::mem::take(&mut self.applied_requests))?;
        self.pass("after requests were removed")
    }

    /// Takes up the end of an attempt that was stopped.
    fn take_stopped(&mut self, (action, attempt, published): Stopped) -> Result<(), EngineError> {
        self.books.action_done(action);
        if !self.books.attempts().contains_key(&attempt) {
            return Ok(());
        }
        match published {
            Some(evidence) => self.take_up(&attempt, evidence),
            None => self.interrupt(&attempt, "ended by the coordinator"),
        }
    }

    /// Closes the database.
    ///
    /// # Errors
    /// [`EngineError::Store`] if the database cannot be closed.
    pub async fn close(self) -> Result<(), EngineError> {
        Ok(self.writer.close_file().await?)
    }

    /// Counts the patients by their states, for the end of the process.
    #[must_use]
    pub fn summary(&self, began: Instant, stopped: bool) -> RunSummary {
        let mut summary = RunSummary {
            submitted: self.submitted,
            published: self.decider.published(),
            stopped,
            cluster: true,
            wall_s: began.elapsed().as_secs_f64(),
            held: self.books.held(),
            jobs: self
                .books
                .jobs()
                .rows()
                .values()
                .map(|row| row.spec.elements.len())
                .sum::<usize>()
                + self.report.lingering.len(),
            ..RunSummary::default()
        };
        summary.count(self.books.selected_states());
        summary
    }
}

/// Whether a patient needs no new decision by the program that decided last: it is over, or its task
/// is under way and has read its inputs.
fn is_settled(books: &Books, i: usize) -> bool {
    let under_way = |task: &TaskEntry| matches!(task.state, Task::Attempting { .. });
    match &books.patient(i).row.state {
        Patient::Working { task, .. } => books.task(task).is_some_and(under_way),
        state => state.is_final(),
    }
}

impl<S: Scheduler> Engine for Cluster<S> {
    type Seen = Seen;

    async fn observe(&mut self) -> Result<Seen, EngineError> {
        if self.stage == Stage::Requests {
            let pending = requests::pending(self.books.run_dir())?;
            if !pending.is_empty() {
                return Ok(Seen::Requests(pending));
            }
            self.stage = Stage::Jobs;
        }
        if self.stage == Stage::Jobs {
            for i in 0..self.books.patients().len() {
                self.follow(i).await?;
            }
            self.look_at_jobs().await?;
            let ended = self.ended_elements();
            if !ended.is_empty() {
                return Ok(Seen::Ended(ended));
            }
            self.stage = Stage::Patients;
        }
        if self.stage == Stage::Patients {
            let settlements = self.settlements().await?;
            self.ask_for_limits(!settlements.is_empty()).await?;
            self.learn_mesh_sizes(!settlements.is_empty())?;
            return Ok(Seen::Settlements(settlements));
        }
        Ok(Seen::Stopped(std::mem::take(&mut self.stopped)))
    }

    fn decide(&mut self, seen: Seen) -> Result<Asked, EngineError> {
        match seen {
            Seen::Requests(pending) => self.take_requests(pending)?,
            Seen::Ended(ended) => self.to_revoke = ended,
            Seen::Settlements(settlements) => self.settle_all(settlements)?,
            Seen::Stopped(stopped) => stopped
                .into_iter()
                .try_for_each(|stopped| self.take_stopped(stopped))?,
            Seen::Files(seen) => self.decider.answer(&mut self.books, seen)?,
        }
        let asked = self.decider.questions();
        if asked.is_empty() && self.stage == Stage::Patients {
            self.cancel_unwanted()?;
            self.place()?;
        }
        Ok(asked)
    }

    async fn look(&mut self, asked: Asked) -> Result<Seen, EngineError> {
        self.books.recall(&mut self.writer, &asked.tasks).await?;
        Ok(FilesSeen::look(asked.files).into())
    }

    async fn commit(&mut self) -> Result<(), EngineError> {
        let mut batch = self.books.flush();
        let report = serde_json::to_string(&self.report).expect("a report is JSON");
        batch.put_meta(REPORT, &report);
        self.pass("before a commit")?;
        self.writer.commit(&mut batch).await?;
        self.pass("after a commit")?;
        for event in self.decider.take_events() {
            // There may be no receiver.
            let _ = self.events.send(event);
        }
        Ok(())
    }

    async fn act(&mut self) -> Result<(), EngineError> {
        self.stage = match self.stage {
            Stage::Requests => {
                self.remove_applied_requests()?;
                Stage::Jobs
            }
            Stage::Jobs => {
                self.revoke_ended().await?;
                Stage::Patients
            }
            Stage::Patients => {
                self.work_off_outbox().await?;
                self.cancel_lingering().await?;
                if self.stopped.is_empty() {
                    Stage::Over
                } else {
                    Stage::Effects
                }
            }
            Stage::Effects | Stage::Over => Stage::Over,
        };
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.stage == Stage::Over
    }
}
