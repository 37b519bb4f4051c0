//! The only module that reads the wall clock. Times as text are UTC, RFC 3339, with milliseconds.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

pub use cardiotwin_schemas::time::utc_text;

/// The clock of an engine: the wall clock, or one that a test sets.
#[derive(Debug, Clone, Default)]
pub enum Clock {
    /// The clock of the operating system.
    #[default]
    Wall,
    /// A clock that stands still until it is moved. Its clones move together.
    Manual(Arc<AtomicI64>),
}

impl Clock {
    /// A manual clock that shows `ms` since 1970-01-01T00:00:00Z.
    #[must_use]
    pub fn manual(ms: i64) -> Self {
        Self::Manual(Arc::new(AtomicI64::new(ms)))
    }

    /// Moves a manual clock forward. Does nothing to the wall clock.
    pub fn advance_ms(&self, by_ms: i64) {
        if let Self::Manual(ms) = self {
            ms.fetch_add(by_ms, Ordering::Relaxed);
        }
    }

    /// Present time of this clock, milliseconds since 1970-01-01T00:00:00Z.
    #[must_use]
    pub fn now_ms(&self) -> i64 {
        match self {
            Self::Wall => now_ms(),
            Self::Manual(ms) => ms.load(Ordering::Relaxed),
        }
    }
}

/// Present time of the operating system, milliseconds since 1970-01-01T00:00:00Z.
#[must_use]
pub fn now_ms() -> i64 {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// The current time as text, for example `2026-07-30T12:34:56.789Z`.
#[must_use]
pub fn now_utc() -> String {
    utc_text(now_ms())
}
