//! Observations of a run on this machine: news of workers, requests, progress, attempts out of
//! sight, signals.

use std::time::{Duration, Instant};

use cardiotwin_schemas::failure::FailureClass;
use cardiotwin_schemas::ids::AttemptId;
use cardiotwin_schemas::outcome::Ending;
use cardiotwin_workflow::attempt::Attempt;

use super::{Beginning, LocalLoop, Observation};
use crate::dispatch::{AttemptFindings, Executor, Found, News};
use crate::program_identity::DECIDED_BY;
use crate::{EngineError, StopLevel, requests};

/// Interval at which progress, requests and hung workers are checked.
const TICK: Duration = Duration::from_millis(200);
/// Free space below this counts as a full disk when workers fail.
const LEAST_FREE_BYTES: u64 = 2 << 20;

impl<E: Executor> LocalLoop<E> {
    /// Examines the attempts of an earlier coordinator.
    pub(super) async fn look_back(&mut self) -> Result<Observation, EngineError> {
        let decided_by = self.writer.meta().await?.remove(DECIDED_BY);
        let attempts = self.books.attempts().keys().cloned().collect();
        let found = self.examine(attempts)?;
        let requests = requests::pending(self.books.run_dir())?;
        Ok(Observation {
            beginning: Some(Beginning { decided_by }),
            found,
            requests,
            ..self.seen()
        })
    }

    /// Waits for news, a stop or the next tick.
    pub(super) async fn wait(&mut self) -> Result<Observation, EngineError> {
        let patience = self.patience();
        let news = tokio::select! {
            biased;
            news = self.executor.news() => news,
            () = self.stop.raised_above(self.heard_stop) => Vec::new(),
            () = tokio::time::sleep(patience) => Vec::new(),
        };
        self.books.set_now_ms(self.surroundings.clock.now_ms());
        if self.seen_stop < StopLevel::Now {
            news.iter().try_for_each(|news| self.check_space(news))?;
        }
        let is_quiet = news.is_empty();
        let stopped = std::mem::take(&mut self.stopped_unwatched);
        let mut seen = Observation {
            stopped: self.examine(stopped)?,
            ..self.seen()
        };
        seen.news = std::mem::take(&mut self.failed_submissions);
        seen.news.extend(news);
        if is_quiet {
            self.look_around(&mut seen)?;
        }
        Ok(seen)
    }

    /// How long to wait for news.
    fn patience(&self) -> Duration {
        let can_act = self.seen_stop < StopLevel::Now && !self.books.outbox().is_empty();
        if self.has_effects() || can_act {
            return Duration::ZERO;
        }
        let deadlines = [self.drain_until, self.leave_until];
        let deadline = deadlines.into_iter().flatten().min();
        deadline.map_or(TICK, |at| {
            at.saturating_duration_since(Instant::now()).min(TICK)
        })
    }

    /// Signals, clock and executor at this moment, and nothing else.
    fn seen(&self) -> Observation {
        Observation {
            at: Instant::now(),
            stop: self.stop.level(),
            room: self.executor.free(),
            beginning: None,
            news: Vec::new(),
            requests: Vec::new(),
            progress: Vec::new(),
            hung: Vec::new(),
            found: Vec::new(),
            stopped: Vec::new(),
        }
    }

    /// Checks everything that sends no news: requests, progress, hung workers, attempts out of
    /// sight.
    fn look_around(&mut self, seen: &mut Observation) -> Result<(), EngineError> {
        seen.requests = requests::pending(self.books.run_dir())?;
        let timeout_s = self.settings.hang_timeout_s;
        let look = self.watch.look(|_| timeout_s, seen.at);
        (seen.progress, seen.hung) = (look.progress, look.hung);
        let attempts = self.books.attempts().iter();
        let unseen = attempts.filter(|(_, a)| matches!(a.state, Attempt::Unknown { .. }));
        let unseen = unseen.map(|(id, _)| id.clone()).collect();
        seen.found = self.examine(unseen)?;
        Ok(())
    }

    /// Looks for attempts that are not over.
    fn examine(
        &mut self,
        attempts: Vec<AttemptId>,
    ) -> Result<Vec<(AttemptId, Found)>, EngineError> {
        let mut all = Vec::with_capacity(attempts.len());
        for attempt in attempts {
            if self.books.attempts().contains_key(&attempt) {
                let directory = self.books.directory(&attempt);
                let found = self.executor.adopt(&attempt, &directory)?;
                all.push((attempt, found));
            }
        }
        Ok(all)
    }

    /// Ends the run if the disk is full. A full disk fails every attempt, and would otherwise use
    /// up their retries.
    fn check_space(&self, news: &News) -> Result<(), EngineError> {
        let News::Ended { evidence, .. } = news else {
            return Ok(());
        };
        let is_of_site = match evidence {
            AttemptFindings::Nothing { class, .. } => *class == FailureClass::Site,
            AttemptFindings::Outcome { outcome, .. } => matches!(&outcome.ending,
                Ending::Failed { failure } if failure.class == FailureClass::Site),
        };
        if !is_of_site {
            return Ok(());
        }
        let path = self.books.run_dir().to_owned();
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
}
