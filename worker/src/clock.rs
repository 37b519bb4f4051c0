//! Wall clock of the worker. No other module reads it.

use std::time::{SystemTime, UNIX_EPOCH};

use cardiotwin_schemas::time::utc_text;

/// Current UTC time as text.
#[must_use]
pub fn now() -> String {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    utc_text(i64::try_from(since.as_millis()).unwrap_or(i64::MAX))
}
