//! Shutdown on request: after the first request short tasks may finish; after the second, or when
//! they take too long, workers are ended.

use std::time::Duration;

use super::LocalLoop;
use crate::dispatch::Executor;
use crate::{EngineEvent, StopLevel};

/// Time that short tasks have to finish after the first Ctrl-C.
const DRAIN: Duration = Duration::from_secs(5);
/// Time that workers have to leave when they are ended.
const LEAVE: Duration = Duration::from_secs(2);

impl<E: Executor> LocalLoop<E> {
    /// Reacts to stop requests and to the ends of these times.
    pub(super) fn take_stop(&mut self, level: StopLevel) {
        let at = self.at;
        self.heard_stop = level;
        let running = self.books.attempts().len();
        if level > self.seen_stop && self.seen_stop == StopLevel::Run {
            self.seen_stop = StopLevel::Soon;
            self.drain_until = Some(at + DRAIN);
            self.decider.tell(EngineEvent::Stopping {
                running,
                draining: level == StopLevel::Soon,
            });
        }
        let is_drained = self.drain_until.is_some_and(|until| at >= until);
        if self.leave_until.is_none()
            && self.seen_stop == StopLevel::Soon
            && (level == StopLevel::Now || is_drained)
        {
            self.decider.tell(EngineEvent::Stopping {
                running,
                draining: false,
            });
            self.end_all(false);
            self.leave_until = Some(at + LEAVE);
        }
        if self.leave_until.is_some_and(|until| at >= until) && self.seen_stop == StopLevel::Soon {
            self.end_all(true);
            self.seen_stop = StopLevel::Now;
            self.leave_until = Some(at + LEAVE);
        }
    }

    fn end_all(&mut self, by_force: bool) {
        let attempts = self.books.attempts().keys();
        self.to_end
            .extend(attempts.map(|attempt| (attempt.clone(), by_force)));
    }
}
