//! The loop of a run on this machine: observe, decide, commit, act.
//!
//! ```text
//!        ┌──────────────► act: outbox ──► executor, files
//!        │                       │
//!     commit ◄── decide ◄── observe: news, requests, signals
//! ```
//! Actions come only from committed batches, and their effects are observed, not assumed. The
//! process may therefore be killed anywhere. A resumed run begins by examining every attempt that
//! is not over.

use std::collections::HashMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::{AttemptId, ExternalId, PatientId};
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_workflow::attempt::{Attempt, AttemptEvent};
use cardiotwin_workflow::patient::Patient;
use cardiotwin_workflow::task::Task;

use super::cores;
use super::program_identity::DECIDED_BY;
use super::surroundings::Surroundings;
use super::transitions::{Circumstance, Decider};
use super::watch::Tail;
use super::world::{AttemptEntry, World};
use super::{EngineError, EngineEvent, EventSender, RunSummary, StopLevel, StopSignal, requests};
use crate::dispatch::{Evidence, Executor, Found, News};
use crate::store::Writer;
use crate::store::outbox::Action;

/// Interval at which progress, requests and hung workers are checked.
const TICK: Duration = Duration::from_millis(200);
/// Free space below this counts as a full disk when workers fail.
const LEAST_FREE_BYTES: u64 = 2 << 20;
/// Largest number of attempts begun in one commit, so that the first ones need not wait for the
/// commit of thousands.
const LARGEST_GROUP: usize = 2048;

/// A running run.
pub struct LocalLoop<E> {
    pub(super) world: World,
    pub(super) decider: Decider,
    pub(super) writer: Writer,
    pub(super) executor: E,
    pub(super) settings: ExecutorSettings,
    pub(super) events: EventSender,
    pub(super) stop: StopSignal,
    pub(super) surroundings: Surroundings,
    pub(super) tails: HashMap<AttemptId, Tail>,
    pub(super) hung: HashMap<AttemptId, String>,
    pub(super) submitted: u64,
    /// Stop level on which the loop has acted.
    pub(super) seen_stop: StopLevel,
    /// Stop level that was read last.
    pub(super) heard_stop: StopLevel,
    pub(super) drain_until: Option<Instant>,
    pub(super) leave_until: Option<Instant>,
}

impl<E: Executor> LocalLoop<E> {
    /// A run that is about to begin.
    pub fn new(
        (writer, world, decider): (Writer, World, Decider),
        executor: E,
        settings: ExecutorSettings,
        surroundings: Surroundings,
        events: EventSender,
        stop: StopSignal,
    ) -> Self {
        Self {
            world,
            decider,
            writer,
            executor,
            settings,
            events,
            stop,
            surroundings,
            tails: HashMap::new(),
            hung: HashMap::new(),
            submitted: 0,
            seen_stop: StopLevel::Run,
            heard_stop: StopLevel::Run,
            drain_until: None,
            leave_until: None,
        }
    }

    /// Runs until every patient is over or the run is stopped.
    pub async fn run(mut self) -> Result<RunSummary, EngineError> {
        let began = Instant::now();
        self.resume().await?;
        loop {
            self.act().await?;
            if self.idle() {
                // Commit the effects of the last actions.
                self.commit().await?;
                if self.world.outbox.is_empty() {
                    break;
                }
                continue;
            }
            self.observe().await?;
            self.begin_ready()?;
            self.commit().await?;
        }
        let summary = self.summary(began.elapsed().as_secs_f64());
        self.writer
            .close(self.executor.kind(), self.surroundings.clock.now_ms())
            .await?;
        Ok(summary)
    }

    /// Examines the attempts of an earlier coordinator, decides for every patient, and begins tasks
    /// that are ready.
    async fn resume(&mut self) -> Result<(), EngineError> {
        // Waiters are registered first, because the end of an attempt that is found now concerns
        // them.
        for i in 0..self.world.patients.len() {
            self.world.await_present_task(i);
        }
        self.take_requests().await?;
        let adopted = self.adopt_all()?;
        let program = self.writer.meta().await?.remove(DECIDED_BY);
        let is_settled = |patient: &Patient| matches!(patient, Patient::Done);
        self.decider
            .decide_all(&mut self.world, program.as_ref(), is_settled)?;
        self.world.need_a_worker()?;
        self.cancel_unwanted()?;
        let settled = self.decider.over;
        let started = EngineEvent::Started {
            patients: self.decider.of,
            settled,
            adopted,
        };
        self.decider.events.insert(0, started);
        self.take_stop()?;
        self.begin_ready()?;
        self.commit().await
    }

    fn adopt_all(&mut self) -> Result<usize, EngineError> {
        let mut adopted = 0;
        let attempts: Vec<AttemptId> = self.world.attempts.keys().cloned().collect();
        for attempt in attempts {
            adopted += usize::from(self.adopt(&attempt)?);
        }
        Ok(adopted)
    }

    /// Examines an attempt that is not over. Returns whether its worker lives.
    pub(super) fn adopt(&mut self, attempt: &AttemptId) -> Result<bool, EngineError> {
        let directory = self.world.directory(attempt);
        match self.executor.adopt(attempt, &directory)? {
            Found::Alive(claim) => {
                let id = ExternalId(claim.pid.to_string());
                self.world.claimed(attempt, claim);
                self.world
                    .attempt_event(attempt, AttemptEvent::Seen { id })?;
                self.tails.insert(attempt.clone(), Tail::of(&directory));
                return Ok(true);
            }
            Found::Over { evidence, claim } => {
                if let Some(claim) = claim {
                    self.world.claimed(attempt, claim);
                }
                self.decider.attempt_ended(
                    &mut self.world,
                    attempt,
                    evidence,
                    Circumstance::Excused,
                )?;
            }
            Found::Elsewhere(claim) => {
                self.world.claimed(attempt, claim);
                let since_ms = self.world.now_ms;
                self.world
                    .attempt_event(attempt, AttemptEvent::Vanished { since_ms })?;
            }
            Found::BeingClaimed => {
                let since_ms = self.world.now_ms;
                self.world
                    .attempt_event(attempt, AttemptEvent::Vanished { since_ms })?;
            }
            // The attempt was decided on, perhaps even spawned, but not claimed. Submitting it
            // again is harmless, since only one process can claim it.
            Found::Unclaimed => {
                let pending = |action: &Action| matches!(action, Action::Submit { attempt: a } if a == attempt);
                let state = &self.world.attempts[attempt].state;
                if matches!(state, Attempt::Cancelling) {
                    self.forget(attempt)?;
                } else if !self.world.outbox.iter().any(|(_, action)| pending(action)) {
                    self.world.put_action(Action::Submit {
                        attempt: attempt.clone(),
                    });
                }
            }
        }
        Ok(false)
    }

    /// Cancels attempts whose tasks have no waiters any more because inputs changed while no
    /// coordinator ran.
    fn cancel_unwanted(&mut self) -> Result<(), EngineError> {
        let unwanted: Vec<AttemptId> = self
            .world
            .attempts
            .iter()
            .filter(|(_, attempt)| {
                !attempt.state.is_final() && !matches!(attempt.state, Attempt::Cancelling)
            })
            .filter(|(id, _)| {
                self.world
                    .tasks
                    .get(&id.task)
                    .is_none_or(|task| task.waiters.is_empty())
            })
            .map(|(id, _)| id.clone())
            .collect();
        unwanted
            .iter()
            .try_for_each(|id| self.world.attempt_event(id, AttemptEvent::Cancel))
    }

    /// Begins ready tasks as far as the executor has room.
    fn begin_ready(&mut self) -> Result<(), EngineError> {
        if self.seen_stop > StopLevel::Run {
            return Ok(());
        }
        // Attempts that are decided on but not yet submitted take room, too.
        let waiting = |a: &&AttemptEntry| matches!(a.state, Attempt::Planned | Attempt::Submitting);
        let mut free = self
            .executor
            .free()
            .saturating_sub(self.world.attempts.values().filter(waiting).count());
        free = free.min(LARGEST_GROUP);
        let active = self
            .world
            .attempts
            .iter()
            .filter(|(_, attempt)| !attempt.state.is_final());
        let (mut others, mut alone) = (0, false);
        for (id, _) in active {
            others += 1;
            alone |= self
                .world
                .tasks
                .get(&id.task)
                .is_some_and(|task| cores::takes_all(&self.settings, task));
        }
        while free > 0 && !alone {
            let Some((position, key)) = self.world.ready.pop_first() else {
                break;
            };
            let task = &self.world.tasks[&key];
            if !matches!(task.state, Task::Open { .. }) || task.waiters.is_empty() {
                continue;
            }
            alone = cores::takes_all(&self.settings, task);
            if alone && others > 0 {
                // No other task begins until all cores are free for this one.
                self.world.ready.insert((position, key));
                break;
            }
            others += 1;
            let waiters = task.waiters.clone();
            let attempt = self.world.begin(&key)?;
            free -= 1;
            for i in waiters {
                let row = &self.world.patients[i].row;
                self.decider.events.push(EngineEvent::TaskStarted {
                    patient: PatientId(row.patient.clone()),
                    step: row
                        .state
                        .step()
                        .map_or_else(String::new, |step| step.to_string()),
                    generation: attempt.generation,
                });
            }
        }
        Ok(())
    }

    /// Commits everything that was decided, then sends the events.
    async fn commit(&mut self) -> Result<(), EngineError> {
        let mut batch = self.world.flush();
        if !batch.is_empty() {
            self.surroundings.crash.pass("before a commit")?;
            self.writer.commit(&mut batch).await?;
            self.surroundings.crash.pass("after a commit")?;
        }
        for event in self.decider.events.drain(..) {
            // There may be no receiver.
            let _ = self.events.send(event);
        }
        Ok(())
    }

    /// Waits for news, a stop or the next tick, and takes it up.
    async fn observe(&mut self) -> Result<(), EngineError> {
        let deadline = [self.drain_until, self.leave_until]
            .into_iter()
            .flatten()
            .min();
        let tick = deadline.map_or(TICK, |at| {
            at.saturating_duration_since(Instant::now()).min(TICK)
        });
        let news = tokio::select! {
            biased;
            news = self.executor.news() => news,
            () = self.stop.raised_above(self.heard_stop) => Vec::new(),
            () = tokio::time::sleep(tick) => Vec::new(),
        };
        self.world.now_ms = self.surroundings.clock.now_ms();
        let quiet = news.is_empty();
        for item in news {
            self.take_news(item)?;
        }
        self.take_stop()?;
        if quiet {
            self.look_around().await?;
        }
        Ok(())
    }

    fn take_news(&mut self, news: News) -> Result<(), EngineError> {
        match news {
            News::Alive { attempt, claim } => {
                let id = ExternalId(claim.pid.to_string());
                self.world.claimed(&attempt, claim);
                self.world
                    .attempt_event(&attempt, AttemptEvent::Seen { id })
            }
            News::Vanished { attempt } => {
                let since_ms = self.world.now_ms;
                self.world
                    .attempt_event(&attempt, AttemptEvent::Vanished { since_ms })
            }
            News::Ended {
                attempt,
                mut evidence,
                claim,
            } => {
                self.tails.remove(&attempt);
                if let (Some(why), Evidence::Nothing { reason, .. }) =
                    (self.hung.remove(&attempt), &mut evidence)
                {
                    *reason = why;
                }
                if let Some(claim) = claim {
                    self.world.claimed(&attempt, claim);
                }
                if self.seen_stop < StopLevel::Now {
                    self.check_space(&evidence)?;
                }
                let circumstance = if self.leave_until.is_some() {
                    Circumstance::Excused
                } else {
                    Circumstance::Watched
                };
                self.decider
                    .attempt_ended(&mut self.world, &attempt, evidence, circumstance)
            }
        }
    }

    /// Ends the run if the disk is full. A full disk fails every attempt, and would otherwise use
    /// up their retries.
    fn check_space(&self, evidence: &Evidence) -> Result<(), EngineError> {
        let site = match evidence {
            Evidence::Nothing { class, .. } => *class == FailureClass::Site,
            Evidence::Outcome { outcome, .. } => matches!(&outcome.ending,
                cardiotwin_schemas::outcome::Ending::Failed { failure } if failure.class == FailureClass::Site),
        };
        if !site {
            return Ok(());
        }
        let path: PathBuf = self.world.run_dir.clone();
        let Ok(space) = rustix::fs::statvfs(&path) else {
            return Ok(());
        };
        let free = space.f_bavail * space.f_frsize;
        if free < LEAST_FREE_BYTES {
            Err(EngineError::NoSpace {
                path,
                free_mb: free >> 20,
            })
        } else {
            Ok(())
        }
    }

    /// Checks everything that sends no news: requests, progress, hung workers, attempts out of
    /// sight.
    async fn look_around(&mut self) -> Result<(), EngineError> {
        self.take_requests().await?;
        let mut hung = Vec::new();
        for (attempt, tail) in &mut self.tails {
            if let Some(progress) = tail.next()
                && let Some(&i) = self
                    .world
                    .tasks
                    .get(&attempt.task)
                    .and_then(|task| task.waiters.first())
            {
                let row = &self.world.patients[i].row;
                self.decider.events.push(EngineEvent::Progress {
                    patient: PatientId(row.patient.clone()),
                    step: row
                        .state
                        .step()
                        .map_or_else(String::new, |step| step.to_string()),
                    phase: progress.phase,
                    done: progress.done,
                    total: progress.total,
                    note: progress.note,
                });
            }
            let timeout = self.settings.hang_timeout_s;
            if timeout > 0.0
                && tail.grew.elapsed().as_secs_f64() > timeout
                && !self.hung.contains_key(attempt)
            {
                hung.push(attempt.clone());
            }
        }
        for attempt in hung {
            let reason = format!(
                "no progress for {} s: the worker was taken for hung and killed",
                self.settings.hang_timeout_s
            );
            self.executor
                .stop(&attempt, &self.world.directory(&attempt), true)?;
            self.hung.insert(attempt, reason);
        }
        let unseen = self
            .world
            .attempts
            .iter()
            .filter(|(_, a)| matches!(a.state, Attempt::Unknown { .. }));
        for attempt in unseen.map(|(id, _)| id.clone()).collect::<Vec<_>>() {
            self.adopt(&attempt)?;
        }
        Ok(())
    }

    /// Applies the changes that other processes requested.
    async fn take_requests(&mut self) -> Result<(), EngineError> {
        let (told, paths) = requests::take(&mut self.world, &mut self.decider)?;
        if paths.is_empty() {
            return Ok(());
        }
        self.decider.events.extend(told);
        self.commit().await?;
        requests::remove(&paths)?;
        self.surroundings.crash.pass("after requests were removed")
    }

    /// Whether nothing runs and nothing can be begun.
    fn idle(&self) -> bool {
        let stopping = self.seen_stop > StopLevel::Run;
        let left = stopping
            && self.leave_until.is_some_and(|at| Instant::now() >= at)
            && self.seen_stop == StopLevel::Now;
        let running = self.world.attempts.values().any(|a| {
            // The attempt was not submitted when the stop came, so it waits for the next run.
            !(stopping && matches!(a.state, Attempt::Planned | Attempt::Submitting))
        });
        left || (!running && (stopping || self.world.ready.is_empty()))
    }

    fn summary(&self, wall_s: f64) -> RunSummary {
        let mut summary = RunSummary {
            submitted: self.submitted,
            published: self.decider.published,
            stopped: self.seen_stop > StopLevel::Run,
            wall_s,
            ..RunSummary::default()
        };
        summary.count(self.world.selected_states());
        summary
    }
}
