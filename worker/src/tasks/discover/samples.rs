//! Samples of a measured trace that a search uses.

use cardiotwin_signals::trace::{Quantity, Trace};

use crate::error::TaskError;

/// Reduces a trace that was interpolated between frames to as many samples as there were frames,
/// because it holds no more information.
pub(super) fn frames(volume: Trace, n_frames: Option<u32>) -> Result<Trace, TaskError> {
    let n = volume.n_samples();
    let Some(n_frames) = n_frames
        .map(|frames| frames as usize)
        .filter(|frames| *frames < n && *frames > 0)
    else {
        return Ok(volume);
    };
    let keep = |values: &[f64]| (0..n_frames).map(|k| values[k * n / n_frames]).collect();
    Trace::new(
        Quantity::Volume,
        keep(volume.time_ms()),
        keep(volume.values()),
    )
    .map_err(|error| TaskError::Measured {
        role: "volume".to_owned(),
        message: error.to_string(),
    })
}
