//! Nothing: measures orchestration.

use std::time::{Duration, Instant};

use cardiotwin_schemas::outcome::TaskResult;
use cardiotwin_schemas::task::NoopSpec;

use crate::context::Context;
use crate::error::TaskError;

/// Sleeps as long as asked.
///
/// # Errors
/// [`TaskError::Cancelled`] when stopping was asked for meanwhile.
pub fn run(spec: &NoopSpec, context: &mut Context) -> Result<TaskResult, TaskError> {
    let end = Instant::now() + Duration::from_millis(spec.sleep_ms);
    loop {
        context.check_stop()?;
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(TaskResult::Noop);
        }
        context.progress.report(
            "sleeping",
            spec.sleep_ms as f64 - left.as_millis() as f64,
            Some(spec.sleep_ms as f64),
            || format!("{} ms left", left.as_millis()),
        );
        std::thread::sleep(left.min(Duration::from_millis(20)));
    }
}
