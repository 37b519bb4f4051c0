//! The one place that reads the wall clock. Times as text are UTC, RFC 3339, with milliseconds.

use std::time::{SystemTime, UNIX_EPOCH};

pub use cardiotwin_schemas::time::utc_text;

/// Milliseconds since 1970-01-01T00:00:00Z.
#[must_use]
pub fn now_ms() -> i64 {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// The present as text, for example `2026-07-30T12:34:56.789Z`.
#[must_use]
pub fn now_utc() -> String {
    utc_text(now_ms())
}
