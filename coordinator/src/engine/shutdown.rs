//! Shutdown on request: after the first request short tasks may finish; after the second, or when
//! they take too long, workers are ended.

use std::time::{Duration, Instant};

use cardiotwin_schemas::ids::AttemptId;

use super::local_loop::LocalLoop;
use super::{EngineError, EngineEvent, StopLevel};
use crate::dispatch::Executor;

/// Time that short tasks have to finish after the first Ctrl-C.
const DRAIN: Duration = Duration::from_secs(5);
/// Time that workers have to leave when they are ended.
const LEAVE: Duration = Duration::from_secs(2);

impl<E: Executor> LocalLoop<E> {
    /// Reacts to stop requests and to the ends of these times.
    pub(super) fn take_stop(&mut self) -> Result<(), EngineError> {
        let level = self.stop.level();
        self.heard_stop = level;
        let running = self.world.attempts.len();
        if level > self.seen_stop && self.seen_stop == StopLevel::Run {
            self.seen_stop = StopLevel::Soon;
            self.drain_until = Some(Instant::now() + DRAIN);
            self.decider.events.push(EngineEvent::Stopping {
                running,
                draining: level == StopLevel::Soon,
            });
        }
        let drained = self.drain_until.is_some_and(|at| Instant::now() >= at);
        if self.leave_until.is_none()
            && self.seen_stop == StopLevel::Soon
            && (level == StopLevel::Now || drained)
        {
            self.decider.events.push(EngineEvent::Stopping {
                running,
                draining: false,
            });
            self.end_all(false)?;
            self.leave_until = Some(Instant::now() + LEAVE);
        }
        if self.leave_until.is_some_and(|at| Instant::now() >= at)
            && self.seen_stop == StopLevel::Soon
        {
            self.end_all(true)?;
            self.seen_stop = StopLevel::Now;
            self.leave_until = Some(Instant::now() + LEAVE);
        }
        Ok(())
    }

    fn end_all(&mut self, by_force: bool) -> Result<(), EngineError> {
        let attempts: Vec<AttemptId> = self.world.attempts.keys().cloned().collect();
        for attempt in attempts {
            let directory = self.world.directory(&attempt);
            self.executor.stop(&attempt, &directory, by_force)?;
        }
        Ok(())
    }
}
