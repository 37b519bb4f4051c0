//! Ctrl-C and SIGTERM: the first finishes short tasks and stops cleanly; the second stops now. Both
//! kinds of stop can be resumed.

use std::io;

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// Urgency of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum StopLevel {
    /// No stop was requested.
    Run,
    /// Start nothing new and let short tasks finish.
    Soon,
    /// End the workers and leave.
    Now,
}

/// Handle by which a running engine is stopped; clones share the state.
#[derive(Debug, Clone)]
pub struct StopSignal {
    level: watch::Sender<StopLevel>,
}

impl Default for StopSignal {
    fn default() -> Self {
        Self {
            level: watch::Sender::new(StopLevel::Run),
        }
    }
}

impl StopSignal {
    /// A signal that only [`StopSignal::ask`] raises.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A signal that SIGINT and SIGTERM raise, each time by one level.
    ///
    /// # Errors
    /// [`io::Error`] if the handlers cannot be installed.
    pub fn from_signals() -> io::Result<Self> {
        let stop = Self::new();
        for kind in [SignalKind::interrupt(), SignalKind::terminate()] {
            let mut received = signal(kind)?;
            let stop = stop.clone();
            tokio::spawn(async move {
                while received.recv().await.is_some() {
                    stop.ask();
                }
            });
        }
        Ok(stop)
    }

    /// Raises the level by one: once is [`StopLevel::Soon`], twice [`StopLevel::Now`].
    pub fn ask(&self) {
        self.level.send_modify(|level| {
            *level = if *level == StopLevel::Run {
                StopLevel::Soon
            } else {
                StopLevel::Now
            };
        });
    }

    /// Urgency of the stops requested so far.
    #[must_use]
    pub fn level(&self) -> StopLevel {
        *self.level.borrow()
    }

    /// Resolves as soon as the level is above `seen`.
    pub async fn raised_above(&self, seen: StopLevel) {
        // The sender lives as long as `self`, so that waiting cannot fail.
        let _ = self.level.subscribe().wait_for(|level| *level > seen).await;
    }
}
