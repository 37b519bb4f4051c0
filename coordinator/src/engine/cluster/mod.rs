//! The coordinator's tick with a cluster: observe, decide, commit, act, and end. Nothing has to stay alive between two
//! ticks; a tick may be killed anywhere and the next one goes on.
//!
//! ```text
//!  observe: attempts and jobs by what they left ([`follow`], [`observe`]); one squeue, at most one sacct; jobs that ended
//!           are revoked, once their end is committed, so that what they left stands still
//!  decide:  chains as ever (`Decider`), what ended jobs mean for their patients ([`settle`]), new jobs ([`place`])
//!  commit:  events, states, names of new jobs, actions, in one transaction
//!  act:     fences, scancel, sbatch ([`submit`])
//! ```

mod breaker;
mod disk_need;
mod examine;
mod expect;
mod follow;
#[cfg(feature = "dev")]
mod measure;
mod mesh_size;
mod observe;
mod place;
mod preview;
mod profile;
mod settle;
mod submit;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_slurm::answers::queue::QueueRow;
use cardiotwin_slurm::answers::{Output, Table};
use cardiotwin_slurm::commands::Command;
use cardiotwin_slurm::site::Site;
use cardiotwin_workflow::patient::Patient;

use super::program_identity::DECIDED_BY;
use super::surroundings::Surroundings;
use super::transitions::Decider;
use super::world::World;
use super::{EngineError, EventSender, RunSummary, StopLevel, StopSignal, requests};
use crate::dispatch::slurm::Scheduler;
use crate::store::Writer;
pub use crate::store::cluster_jobs::{ClusterReport, REPORT};

use cardiotwin_workflow::cluster_job::Element;
pub use disk_need::DiskNeed;
pub use examine::{QueueReport, SiteReport, examine_site};
use expect::Expectations;
#[cfg(feature = "dev")]
pub use measure::{ClusterBenchOptions, ClusterBenchResult, TickCost, measure_cluster};
pub use preview::{PlannedRow, PlannedRun, preview};
pub use profile::load_site;

/// A run whose tasks are jobs of a cluster.
pub struct Cluster<S> {
    world: World,
    decider: Decider,
    writer: Writer,
    scheduler: S,
    site: Site,
    settings: ExecutorSettings,
    /// The worker's executable, as compute nodes see it.
    worker: PathBuf,
    /// This program's, which is the driver inside the allocations.
    program: PathBuf,
    events: EventSender,
    surroundings: Surroundings,
    /// What the queue said in this tick.
    queue: Option<Table<QueueRow>>,
    /// Whether the site said that it has no accounting.
    no_accounting: bool,
    report: ClusterReport,
    submitted: u64,
    /// Names made by this process.
    names: u32,
}

impl<S: Scheduler> Cluster<S> {
    /// A run that was opened, on a cluster; `programs` are worker and driver as compute nodes see them.
    ///
    /// # Errors
    /// The store's.
    pub async fn new(
        (mut writer, mut world, decider): (Writer, World, Decider),
        scheduler: S,
        site: Site,
        settings: ExecutorSettings,
        programs: (PathBuf, PathBuf),
        events: EventSender,
        surroundings: Surroundings,
    ) -> Result<Self, EngineError> {
        world.allocation = writer
            .cluster_allocation(&crate::store::lock::host_name(), world.now_ms)
            .await?;
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
            world,
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
        })
    }

    /// One tick.
    ///
    /// # Errors
    /// [`EngineError`]; what was committed stays.
    pub async fn tick(&mut self) -> Result<(), EngineError> {
        self.world.now_ms = self.surroundings.clock.now_ms();
        self.report.commands = 0;
        self.take_requests().await?;
        for i in 0..self.world.patients.len() {
            self.follow(i)?;
        }
        self.observe().await?;
        self.revoke_ended().await?;
        self.settle_all()?;
        self.cancel_unwanted()?;
        self.place().await?;
        self.commit().await?;
        self.act().await?;
        self.commit().await
    }

    /// What every coordinator does first: who waits for what, and a decision for every patient that is not over.
    pub async fn begin(&mut self) -> Result<(), EngineError> {
        for i in 0..self.world.patients.len() {
            self.world.await_present_task(i);
        }
        let settled = self.decider.over;
        let program = self.writer.meta().await?.remove(DECIDED_BY);
        self.decider
            .decide_all(&mut self.world, program.as_ref(), Patient::is_final)?;
        self.world.need_a_worker()?;
        let started = super::EngineEvent::Started {
            patients: self.decider.of,
            settled,
            adopted: 0,
        };
        self.decider.events.insert(0, started);
        Ok(())
    }

    /// Ticks until every patient is over, or `stop` is raised.
    ///
    /// # Errors
    /// As [`Cluster::tick`].
    pub async fn watch(&mut self, stop: &StopSignal) -> Result<(), EngineError> {
        let shortest = Duration::from_secs(self.site.poll.shortest_s);
        let longest = Duration::from_secs(self.site.poll.longest_s);
        let mut pause = shortest;
        loop {
            let before = (self.decider.published, self.submitted, self.decider.over);
            self.tick().await?;
            self.writer.publish_snapshot().await?;
            if self.is_over() || stop.level() > StopLevel::Run {
                return Ok(());
            }
            let changed = before != (self.decider.published, self.submitted, self.decider.over);
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

    /// Ticks until no job is asked to end any more.
    ///
    /// # Errors
    /// As [`Cluster::tick`].
    pub async fn end_jobs(&mut self, stop: &StopSignal) -> Result<(), EngineError> {
        loop {
            self.tick().await?;
            let rows = self.world.jobs.rows.values();
            let ending = rows
                .flat_map(|row| &row.state.elements)
                .any(|e| *e == Element::Stopping);
            if (!ending && self.world.outbox.is_empty()) || stop.level() > StopLevel::Run {
                return Ok(());
            }
            tokio::select! {
                () = stop.raised_above(StopLevel::Run) => {}
                () = tokio::time::sleep(Duration::from_secs(1)) => {}
            }
        }
    }

    /// Whether nothing is left to do: every selected patient is over, and no job lives.
    pub fn is_over(&self) -> bool {
        self.world
            .patients
            .iter()
            .filter(|p| p.selected)
            .all(|p| p.row.state.is_final())
            && self.world.jobs.rows.is_empty()
            && self.world.outbox.is_empty()
    }

    /// Commits everything that was decided, then tells it.
    pub(super) async fn commit(&mut self) -> Result<(), EngineError> {
        let mut batch = self.world.flush();
        let report = serde_json::to_string(&self.report).expect("a report is JSON");
        batch.put_meta(REPORT, &report);
        self.pass("before a commit")?;
        self.writer.commit(&mut batch).await?;
        self.pass("after a commit")?;
        for event in self.decider.events.drain(..) {
            // Nobody may be listening.
            let _ = self.events.send(event);
        }
        Ok(())
    }

    /// A crash point.
    pub(super) fn pass(&self, place: &str) -> Result<(), EngineError> {
        self.surroundings.crash.pass(place)
    }

    /// Runs a command of the scheduler's.
    pub(super) async fn run_command(&mut self, command: &Command) -> Result<Output, EngineError> {
        self.pass("before a command")?;
        let output = self.scheduler.ask(command).await;
        self.pass("after a command")?;
        Ok(output)
    }

    async fn take_requests(&mut self) -> Result<(), EngineError> {
        let (told, paths) = requests::take(&mut self.world, &mut self.decider)?;
        if paths.is_empty() {
            return Ok(());
        }
        self.decider.events.extend(told);
        self.commit().await?;
        requests::remove(&paths)?;
        self.pass("after requests were removed")
    }

    /// Closes the database.
    ///
    /// # Errors
    /// The store's.
    pub async fn close(self) -> Result<(), EngineError> {
        Ok(self.writer.close_file().await?)
    }

    /// What became of the patients.
    #[must_use]
    pub fn summary(&self, began: Instant, stopped: bool) -> RunSummary {
        let mut summary = RunSummary {
            submitted: self.submitted,
            published: self.decider.published,
            stopped,
            cluster: true,
            wall_s: began.elapsed().as_secs_f64(),
            jobs: self
                .world
                .jobs
                .rows
                .values()
                .map(|row| row.spec.elements.len())
                .sum(),
            ..RunSummary::default()
        };
        summary.count(self.world.selected_states());
        summary
    }
}
