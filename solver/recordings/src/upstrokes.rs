//! Rises of a pressure: one for each beat that ejects, or tries to.

use crate::filter::{slope, smooth, usual_peaks, vertex};
use crate::r_waves::regions;
use crate::recording::Recording;

/// Half width of the smoothing before the slope, ms.
const SMOOTH_MS: f64 = 4.0;
/// Slope over the usual steepest one that makes a rise, dimensionless.
const THRESHOLD: f64 = 0.4;
/// No two rises within this time, ms.
const REFRACTORY_MS: f64 = 200.0;
/// Stretch over which the usual slope is taken, ms: at least one beat.
const WINDOW_MS: f64 = 2000.0;

/// The pressure's slope, mmHg/ms.
pub(crate) fn slopes(recording: &Recording, pressure_mmhg: &[f64]) -> Vec<f64> {
    // Below one step of smoothing there is nothing to smooth with.
    let half = if recording.step_ms > SMOOTH_MS { 0 } else { recording.samples(SMOOTH_MS) };
    slope(&smooth(pressure_mmhg, half), recording.step_ms)
}

/// Slope over the usual steepest one that no heart makes, dimensionless: a flush, a whip, a plug.
const ARTEFACT: f64 = 2.2;
/// What lies so near to one is none either, ms.
const AROUND_MS: f64 = 15.0;

/// Times of the steepest rises since the recording's begin, ms.
pub(crate) fn find(recording: &Recording, slopes: &[f64]) -> Vec<f64> {
    let window = recording.samples(WINDOW_MS);
    let usual = usual_peaks(slopes, window);
    let usual_at = |i: usize| usual[(i / window).min(usual.len() - 1)];
    let mut sound = slopes.to_vec();
    let around = recording.samples(AROUND_MS);
    for i in 0..slopes.len() {
        if slopes[i].abs() > ARTEFACT * usual_at(i) {
            sound[i.saturating_sub(around)..(i + around + 1).min(slopes.len())].fill(0.0);
        }
    }
    let threshold = |i: usize| THRESHOLD * usual_at(i);
    regions(&sound, threshold, recording.samples(REFRACTORY_MS))
        .into_iter()
        .map(|i| {
            let at = |k: usize| slopes.get(k).copied().unwrap_or(slopes[i]);
            (i as f64 + vertex(at(i.wrapping_sub(1)), slopes[i], at(i + 1))) * recording.step_ms
        })
        .collect()
}
