//! The coordinator's tick on a cluster: observe, decide, commit, act, and end. No process has to
//! stay alive between two ticks. A tick may be killed anywhere, and the next one continues.
//!
//! ```text
//!  observe: requests, then the results of effects, as plain data
//!  decide:  State::decide, a pure function of state and observation ([`decide`])
//!           ▲ answer              │ question
//!           └──────── look ◄──────┘ folders, squeue, sacct          ([`look`])
//!  commit:  events, states, names of new jobs and actions, in one transaction
//!  act:     State::effects: fences, scancel, sbatch                 ([`act`])
//! ```
//! A quiet tick is one turn. Requests, jobs that ended and submissions take further turns, because
//! their consequences are decided after they are committed ([`Phase`]).

mod act;
mod budget;
mod decide;
mod disk_need;
mod examine;
mod expect;
mod look;
mod order;
mod place;
mod preview;
mod profile;
mod resources;
#[cfg(test)]
mod tests;
mod usage;
mod waiting;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::access::Scheduler;
use cardiotwin_slurm::answers::Output;
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm::site::Site;
use cardiotwin_store::Writer;
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use super::books::{Books, TaskEntry};
use super::decider::Decider;
use super::files_seen::FilesSeen;
use super::program_identity::DECIDED_BY;
use super::surroundings::Surroundings;
use super::turn::{self, Engine};
use super::{
    EngineError, EventSender, RunSummary, StopLevel, StopSignal, requests, worker_identity,
};
use crate::dispatch;
pub use cardiotwin_store::cluster_jobs::{ClusterReport, REPORT};

use cardiotwin_workflow::cluster_job::Element;
use decide::{EffectResult, Observation, Phase, ProcessIdentity, Question, State};
pub use disk_need::DiskNeed;
pub use examine::{QueueReport, SiteReport, examine_site};
pub use preview::{PlannedRow, PlannedRun, preview};
pub use profile::load_site;
pub use resources::{NoQueue, without_queue};
pub use usage::{JobUsage, usage_of};

/// A run whose tasks are jobs of a cluster: the state of its decisions, and what looks and acts for
/// them.
pub struct Cluster<S> {
    state: State,
    writer: Writer,
    scheduler: S,
    /// Path of the worker's executable, as compute nodes see it.
    worker: PathBuf,
    /// Path of this program, which is also the driver inside the allocations.
    program: PathBuf,
    events: EventSender,
    surroundings: Surroundings,
    /// Results of the effects of the last turn.
    results: Vec<EffectResult>,
    /// Number of commands in this tick.
    commands: u32,
    /// The report as it was committed last, in JSON.
    committed_report: String,
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
        let committed_report = writer.meta().await?.remove(REPORT).unwrap_or_default();
        let mut report: ClusterReport = serde_json::from_str(&committed_report).unwrap_or_default();
        let (worker, program) = programs;
        if !program.as_os_str().is_empty() {
            report.site.clone_from(&site.name);
            report.charge_per_node_hour = site.charge_per_node_hour;
            report.charge_unit.clone_from(&site.charge_unit);
        }
        let process = ProcessIdentity {
            pid: std::process::id(),
            uid: dispatch::own_uid(),
        };
        Ok(Self {
            state: State::new((books, decider), site, settings, report, process),
            writer,
            scheduler,
            worker,
            program,
            events,
            surroundings,
            results: Vec::new(),
            commands: 0,
            committed_report,
        })
    }

    /// One tick.
    ///
    /// # Errors
    /// Any [`EngineError`]; what was committed before stays committed.
    pub async fn tick(&mut self) -> Result<(), EngineError> {
        self.state.begin_tick(self.surroundings.clock.now_ms());
        self.commands = 0;
        turn::run(self).await?;
        // What Slurm refused for good is told at once: the next tick may be hours away.
        if self.state.ended_elements().is_empty() {
            return Ok(());
        }
        self.state.begin_examination();
        turn::run(self).await
    }

    /// Registers which patient waits for which task and decides for every patient that is not
    /// over, as every coordinator does first.
    ///
    /// - `refused`: refusal of a worker other than the run's, raised if a computation is needed
    pub async fn begin(&mut self, refused: Option<EngineError>) -> Result<(), EngineError> {
        let State { books, decider, .. } = &mut self.state;
        for i in 0..books.patients().len() {
            books.await_present_task(i);
        }
        let settled = decider.over();
        let program = self.writer.meta().await?.remove(DECIDED_BY);
        decider.decide_all(books, program.as_ref(), is_settled)?;
        loop {
            let asked = decider.questions();
            if asked.is_empty() {
                break;
            }
            books.recall(&mut self.writer, &asked.tasks).await?;
            decider.answer(books, FilesSeen::look(asked.files))?;
        }
        worker_identity::need(refused, books)?;
        let started = super::EngineEvent::Started {
            patients: decider.of(),
            settled,
            adopted: 0,
        };
        decider.tell_first(started);
        Ok(())
    }

    /// Ticks until every patient is over or `stop` is raised. The pause between two ticks doubles
    /// while nothing changes.
    ///
    /// # Errors
    /// As [`Cluster::tick`].
    pub async fn watch(&mut self, stop: &StopSignal) -> Result<(), EngineError> {
        let shortest = Duration::from_secs(self.state.site.poll.shortest_s);
        let longest = Duration::from_secs(self.state.site.poll.longest_s);
        let mut pause = shortest;
        loop {
            let before = self.progress();
            self.tick().await?;
            self.writer.publish_snapshot().await?;
            if self.is_finished() || stop.level() > StopLevel::Run {
                return Ok(());
            }
            pause = if before != self.progress() {
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

    /// Numbers of published tasks, submitted elements and patients that are over.
    fn progress(&self) -> (u64, u64, usize) {
        let state = &self.state;
        (
            state.decider.published(),
            state.submitted,
            state.decider.over(),
        )
    }

    /// Ticks until every job that was asked to end has ended, and no element outlives its driver.
    /// Returns whether nothing is left; `false` after a stop.
    ///
    /// # Errors
    /// As [`Cluster::tick`].
    pub async fn end_jobs(&mut self, stop: &StopSignal) -> Result<bool, EngineError> {
        self.state.ends_all = true;
        loop {
            self.tick().await?;
            let rows = self.state.books.jobs().rows().values();
            let ending = rows
                .flat_map(|row| &row.state.elements)
                .any(|e| *e == Element::Stopping);
            let is_over =
                !ending && self.state.books.outbox().is_empty() && !self.state.has_lingering();
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
        let patients = self.state.books.patients().iter().enumerate();
        patients.filter(|(_, p)| p.selected).all(|(i, p)| {
            p.row.state.is_final() || self.state.books.waits_in_vain(i).unwrap_or(false)
        }) && self.state.books.jobs().rows().is_empty()
            && self.state.books.outbox().is_empty()
            && !self.state.has_lingering()
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
            submitted: self.state.submitted,
            published: self.state.decider.published(),
            stopped,
            cluster: true,
            wall_s: began.elapsed().as_secs_f64(),
            held: self.state.books.held(),
            jobs: self
                .state
                .books
                .jobs()
                .rows()
                .values()
                .map(|row| row.spec.elements.len())
                .sum::<usize>()
                + self.state.report.lingering.len(),
            ..RunSummary::default()
        };
        summary.count(self.state.books.selected_states());
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
    type Seen = Observation;
    type Question = Question;

    async fn observe(&mut self) -> Result<Observation, EngineError> {
        if self.state.phase == Phase::Requests {
            let pending = requests::pending(self.state.books.run_dir())?;
            return Ok(Observation::Requests(pending));
        }
        Ok(Observation::Results(std::mem::take(&mut self.results)))
    }

    fn decide(&mut self, seen: Observation) -> Result<Option<Question>, EngineError> {
        self.state.decide(seen)
    }

    async fn look(&mut self, question: Question) -> Result<Observation, EngineError> {
        self.answer(question).await
    }

    async fn commit(&mut self) -> Result<(), EngineError> {
        self.state.report.commands = self.commands;
        let mut batch = self.state.books.flush();
        let report = serde_json::to_string(&self.state.report).expect("a report is JSON");
        // A turn that changed nothing costs no write on a file system that many share.
        if !batch.is_empty() || report != self.committed_report {
            batch.put_meta(REPORT, &report);
            self.pass("before a commit")?;
            self.writer.commit(&mut batch).await?;
            self.pass("after a commit")?;
            self.committed_report = report;
        }
        for event in self.state.decider.take_events() {
            // There may be no receiver.
            let _ = self.events.send(event);
        }
        Ok(())
    }

    async fn act(&mut self) -> Result<(), EngineError> {
        for effect in self.state.effects() {
            let result = self.execute(effect).await?;
            self.results.extend(result);
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.state.phase == Phase::Over
    }
}
