//! A task that does nothing, to measure the orchestration.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::task::NoopSpec;

use crate::context::Context;
use crate::error::TaskError;

/// Longest sleep between two checks of the stop flag.
const NAP: Duration = Duration::from_millis(20);
/// Environment variable with the name of a file. No-ops sleep as long as the file exists, so that
/// tests of events during a task do not depend on timing.
const HOLD: &str = "CARDIOTWIN_NOOP_HOLD";

/// Sleeps for the specified time, and while the file of `CARDIOTWIN_NOOP_HOLD` exists.
///
/// # Errors
/// [`TaskError::Cancelled`] when a stop is requested in the meantime.
pub fn run(spec: &NoopSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    let end = Instant::now() + Duration::from_millis(spec.sleep_ms);
    let hold = std::env::var_os(HOLD).map(PathBuf::from);
    loop {
        context.check_stop()?;
        let left = end.saturating_duration_since(Instant::now());
        let held = hold.as_ref().is_some_and(|file| file.exists());
        if left.is_zero() && !held {
            return Ok(TaskResult::Noop);
        }
        context.progress.report(
            "sleeping",
            spec.sleep_ms as f64 - left.as_millis() as f64,
            Some(spec.sleep_ms as f64),
            || format!("{} ms left", left.as_millis()),
        );
        std::thread::sleep(if held { NAP } else { left.min(NAP) });
    }
}
