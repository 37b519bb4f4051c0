//! Crash points: after each commit, and before and after each action. Tests stop the process dead at the n-th one and
//! look whether a second run ends alike.

/// Set to n, the process aborts at its n-th crash point. For tests; read once, when the engine begins.
pub const VARIABLE: &str = "CARDIOTWIN_CRASH_POINT";

/// Counts crash points.
#[derive(Debug, Default)]
pub struct CrashPoints {
    seen: u64,
    fatal: Option<u64>,
}

impl CrashPoints {
    /// As the environment asks.
    pub fn from_environment() -> Self {
        Self { seen: 0, fatal: std::env::var(VARIABLE).ok().and_then(|n| n.parse().ok()) }
    }

    /// A point where the process may die.
    pub fn pass(&mut self, place: &str) {
        self.seen += 1;
        if self.fatal == Some(self.seen) {
            eprintln!("crash point {}: {place}", self.seen);
            // No destructor, no flush: as near to kill -9 as a process can do to itself.
            std::process::abort();
        }
    }
}
