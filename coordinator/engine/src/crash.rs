//! Crash points: before and after each commit, each action and each command of the scheduler. Tests
//! stop the process dead at the n-th one and check that a second run ends alike.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::EngineError;

/// Environment variable for tests: set to n, the process aborts at its n-th crash point. It is read
/// once, when the engine begins.
pub const VARIABLE: &str = "CARDIOTWIN_CRASH_POINT";

/// Counter of crash points. Clones share it, so that a test can count over several coordinators.
#[derive(Debug, Clone, Default)]
pub struct CrashPoints {
    passed: Arc<AtomicU64>,
    fatal: Option<u64>,
    /// Whether the fatal point returns an error instead of aborting the process.
    #[cfg(test)]
    soft: bool,
}

impl CrashPoints {
    /// Reads the fatal point from the environment.
    pub fn from_environment() -> Self {
        Self {
            fatal: std::env::var(VARIABLE).ok().and_then(|n| n.parse().ok()),
            ..Self::default()
        }
    }

    /// Returns an error at the n-th point, for tests that continue in the same process.
    #[cfg(test)]
    pub fn ending_at(n: u64) -> Self {
        Self {
            fatal: Some(n),
            soft: true,
            ..Self::default()
        }
    }

    /// Whether the fatal point was reached.
    #[cfg(test)]
    pub fn is_over(&self) -> bool {
        self.fatal
            .is_some_and(|fatal| self.passed.load(Ordering::Relaxed) >= fatal)
    }

    /// Passes a point at which the process may die.
    pub fn pass(&self, place: &str) -> Result<(), EngineError> {
        let n = self.passed.fetch_add(1, Ordering::Relaxed) + 1;
        if self.fatal == Some(n) {
            #[cfg(test)]
            if self.soft {
                return Err(EngineError::Crashed {
                    place: place.to_owned(),
                });
            }
            eprintln!("crash point {n}: {place}");
            // No destructor, no flush: as near to kill -9 as a process can do to itself.
            std::process::abort();
        }
        Ok(())
    }
}
