//! A run on this machine, which takes turns until every patient is over. A resumed run begins by
//! examining every attempt that is not over.

mod act;
mod decide;
mod observe;
mod shutdown;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::progress::Progress;
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_store::Writer;
use cardiotwin_workflow::attempt::Attempt;

use super::books::Books;
use super::decider::Decider;
use super::files_seen::{Asked, FilesSeen};
use super::requests::Pending;
use super::surroundings::Surroundings;
use super::turn::{self, Engine};
use super::watch::Watch;
use super::{EngineError, EventSender, RunSummary, StopLevel, StopSignal};
use crate::dispatch::{Executor, Found, News};

/// A run on this machine.
pub struct LocalLoop<E> {
    books: Books,
    decider: Decider,
    writer: Writer,
    executor: E,
    settings: ExecutorSettings,
    events: EventSender,
    stop: StopSignal,
    surroundings: Surroundings,
    /// Refusal of a worker other than the run's. It is raised if a computation is needed.
    refused_worker: Option<EngineError>,
    /// Whether the first decisions are still to be completed.
    is_beginning: bool,
    /// Number of attempts that outlived an earlier coordinator.
    adopted: usize,
    /// Number of attempts that the executor would take, when it was last observed.
    room: usize,
    watch: Watch,
    /// Ends of attempts that could not be submitted: news of the next turn.
    failed_submissions: Vec<News>,
    /// Attempts that were stopped and have no process whose end would be reported: to be examined
    /// in the next turn.
    stopped_unwatched: Vec<AttemptId>,
    /// Attempts to end after the commit, each with whether by force.
    to_end: Vec<(AttemptId, bool)>,
    /// Files of requests that were applied, to be removed after the commit.
    applied_requests: Vec<PathBuf>,
    submitted: u64,
    /// Stop level on which the loop has acted.
    seen_stop: StopLevel,
    /// Stop level that was read last.
    heard_stop: StopLevel,
    /// Time of the last observation.
    at: Instant,
    drain_until: Option<Instant>,
    leave_until: Option<Instant>,
}

/// Observation of this machine.
pub enum Seen {
    News(Box<Observation>),
    /// Files about which decisions asked.
    Files(FilesSeen),
}

/// What was seen of workers, requests and signals.
pub struct Observation {
    at: Instant,
    stop: StopLevel,
    /// Number of attempts that the executor would take.
    room: usize,
    /// Present in the first turn.
    beginning: Option<Beginning>,
    news: Vec<News>,
    requests: Vec<Pending>,
    progress: Vec<(AttemptId, Progress)>,
    hung: Vec<(AttemptId, String)>,
    /// Attempts that were out of sight.
    found: Vec<(AttemptId, Found)>,
    /// Attempts that were stopped and had no watched process.
    stopped: Vec<(AttemptId, Found)>,
}

/// What the first observation of a run finds.
struct Beginning {
    /// Hash of the coordinator's executable that decided last.
    decided_by: Option<String>,
}

impl<E: Executor> LocalLoop<E> {
    /// A run that is about to begin.
    pub fn new(
        (writer, books, decider): (Writer, Books, Decider),
        refused_worker: Option<EngineError>,
        executor: E,
        settings: ExecutorSettings,
        surroundings: Surroundings,
        events: EventSender,
        stop: StopSignal,
    ) -> Self {
        Self {
            books,
            decider,
            writer,
            executor,
            settings,
            events,
            stop,
            surroundings,
            refused_worker,
            is_beginning: true,
            adopted: 0,
            room: 0,
            watch: Watch::default(),
            failed_submissions: Vec::new(),
            stopped_unwatched: Vec::new(),
            to_end: Vec::new(),
            applied_requests: Vec::new(),
            submitted: 0,
            seen_stop: StopLevel::Run,
            heard_stop: StopLevel::Run,
            at: Instant::now(),
            drain_until: None,
            leave_until: None,
        }
    }

    /// Runs to the end, or until it is stopped.
    pub async fn run(mut self) -> Result<RunSummary, EngineError> {
        let began = Instant::now();
        turn::run(&mut self).await?;
        let summary = self.summary(began.elapsed());
        self.writer
            .close(self.executor.kind(), self.surroundings.clock.now_ms())
            .await?;
        Ok(summary)
    }

    fn summary(&self, wall: Duration) -> RunSummary {
        let mut summary = RunSummary {
            submitted: self.submitted,
            published: self.decider.published(),
            stopped: self.seen_stop > StopLevel::Run,
            wall_s: wall.as_secs_f64(),
            held: self.books.held(),
            ..RunSummary::default()
        };
        summary.count(self.books.selected_states());
        summary
    }

    /// Whether the effects of the last actions are still to be observed.
    fn has_effects(&self) -> bool {
        !self.failed_submissions.is_empty() || !self.stopped_unwatched.is_empty()
    }
}

impl<E: Executor> Engine for LocalLoop<E> {
    type Seen = Seen;
    type Question = Asked;

    async fn observe(&mut self) -> Result<Seen, EngineError> {
        let sight = if self.is_beginning {
            self.look_back().await?
        } else {
            self.wait().await?
        };
        Ok(Seen::News(Box::new(sight)))
    }

    fn decide(&mut self, seen: Seen) -> Result<Option<Asked>, EngineError> {
        match seen {
            Seen::News(sight) => self.take_up(*sight)?,
            Seen::Files(seen) => self.decider.answer(&mut self.books, seen)?,
        }
        let asked = self.decider.questions();
        if !asked.is_empty() {
            return Ok(Some(asked));
        }
        self.conclude()?;
        Ok(None)
    }

    async fn look(&mut self, asked: Asked) -> Result<Seen, EngineError> {
        self.books.recall(&mut self.writer, &asked.tasks).await?;
        Ok(Seen::Files(FilesSeen::look(asked.files)))
    }

    async fn commit(&mut self) -> Result<(), EngineError> {
        let mut batch = self.books.flush();
        if !batch.is_empty() {
            self.surroundings.crash.pass("before a commit")?;
            self.writer.commit(&mut batch).await?;
            self.surroundings.crash.pass("after a commit")?;
        }
        for event in self.decider.take_events() {
            // There may be no receiver.
            let _ = self.events.send(event);
        }
        Ok(())
    }

    async fn act(&mut self) -> Result<(), EngineError> {
        self.end_workers()?;
        self.remove_applied_requests()?;
        if self.seen_stop < StopLevel::Now {
            self.work_off_outbox().await?;
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        let stopping = self.seen_stop > StopLevel::Run;
        let has_left = self.seen_stop == StopLevel::Now;
        if has_left && self.leave_until.is_some_and(|until| self.at >= until) {
            return true;
        }
        let runs = self.books.attempts().values().any(|a| {
            // The attempt was not submitted when the stop came, so it waits for the next run.
            !(stopping && matches!(a.state, Attempt::Planned | Attempt::Submitting))
        });
        let can_begin = !stopping && !self.books.ready().is_empty();
        // A run that has left executes no further actions; the next run does.
        let can_act = !has_left && (!self.books.outbox().is_empty() || self.has_effects());
        !runs && !can_begin && !can_act
    }
}
