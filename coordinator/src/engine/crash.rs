//! Crash points: after each commit, and before and after each action. Tests stop the process dead at the n-th one and
//! look whether a second run ends alike.

use super::EngineError;

/// Set to n, the process aborts at its n-th crash point. For tests; read once, when the engine begins.
pub const VARIABLE: &str = "CARDIOTWIN_CRASH_POINT";

/// Counts crash points.
#[derive(Debug, Default)]
pub struct CrashPoints {
    seen: u64,
    fatal: Option<u64>,
    /// Ends with an error instead of the process.
    #[cfg(test)]
    soft: bool,
}

impl CrashPoints {
    /// As the environment asks.
    pub fn from_environment() -> Self {
        Self {
            fatal: std::env::var(VARIABLE).ok().and_then(|n| n.parse().ok()),
            ..Self::default()
        }
    }

    /// Ends with an error at the n-th point, for tests that go on in the same process.
    #[cfg(test)]
    pub fn ending_at(n: u64) -> Self {
        Self {
            fatal: Some(n),
            soft: true,
            ..Self::default()
        }
    }

    /// A point where the process may die.
    pub fn pass(&mut self, place: &str) -> Result<(), EngineError> {
        self.seen += 1;
        if self.fatal == Some(self.seen) {
            #[cfg(test)]
            if self.soft {
                return Err(EngineError::Crashed {
                    place: place.to_owned(),
                });
            }
            eprintln!("crash point {}: {place}", self.seen);
            // No destructor, no flush: as near to kill -9 as a process can do to itself.
            std::process::abort();
        }
        Ok(())
    }
}
