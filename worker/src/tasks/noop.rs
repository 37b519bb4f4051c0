//! Nothing: measures orchestration.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::task::NoopSpec;

use crate::context::Context;
use crate::error::TaskError;

/// Looks up at least so often.
const NAP: Duration = Duration::from_millis(20);
/// Names a file that keeps every no-op asleep while it is there: tests of what happens meanwhile then depend on nobody's
/// speed.
const HOLD: &str = "CARDIOTWIN_NOOP_HOLD";

/// Sleeps as long as asked, and as long as it is held.
///
/// # Errors
/// [`TaskError::Cancelled`] when stopping was asked for meanwhile.
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
