//! Detection of pressure rises, one for each beat that ejects or tries to eject.

use crate::filter::{slope, smooth, usual_peaks, vertex};
use crate::r_waves::regions;
use crate::recording::Recording;

/// Half width of the smoothing before slopes are computed \[ms\].
const SMOOTH_MS: f64 = 4.0;
/// Slope relative to the typical steepest one above which there is a rise, dimensionless.
const THRESHOLD: f64 = 0.4;
/// Smallest time between two rises \[ms\].
const REFRACTORY_MS: f64 = 200.0;
/// Interval over which the typical slope is computed, at least one beat \[ms\].
const WINDOW_MS: f64 = 2000.0;

/// Slope of the pressure \[mmHg/ms\].
pub(crate) fn slopes(recording: &Recording, pressure_mmhg: &[f64]) -> Vec<f64> {
    // If the step is longer than the smoothing, nothing is smoothed.
    let half = if recording.step_ms > SMOOTH_MS {
        0
    } else {
        recording.samples(SMOOTH_MS)
    };
    slope(&smooth(pressure_mmhg, half), recording.step_ms)
}

/// Slope relative to the typical steepest one above which it is an artefact (flush, whip, plug),
/// dimensionless.
const ARTEFACT: f64 = 2.2;
/// Time around an artefact within which slopes are ignored \[ms\].
const AROUND_MS: f64 = 15.0;

/// Time on either side of a rise within which its height is measured \[ms\].
const HEIGHT_MS: f64 = 130.0;
/// Height relative to the typical one above which a rise belongs to a beat, dimensionless. After
/// its notch the aortic pressure rises again, as steeply but not as high.
const HEIGHT: f64 = 0.4;
/// Quantile of the heights that is the typical height: up to half of the rises may follow a notch.
const USUAL: f64 = 0.75;

/// Times of the steepest rises after the recording's beginning \[ms\].
pub(crate) fn find(recording: &Recording, pressure_mmhg: &[f64], slopes: &[f64]) -> Vec<f64> {
    let window = recording.samples(WINDOW_MS);
    let usual = usual_peaks(slopes, pressure_mmhg, window);
    let usual_at = |i: usize| usual[(i / window).min(usual.len() - 1)];
    let mut sound = slopes.to_vec();
    let around = recording.samples(AROUND_MS);
    for i in 0..slopes.len() {
        if slopes[i].abs() > ARTEFACT * usual_at(i) {
            sound[i.saturating_sub(around)..(i + around + 1).min(slopes.len())].fill(0.0);
        }
    }
    let threshold = |i: usize| THRESHOLD * usual_at(i);
    let found = regions(&sound, threshold, recording.samples(REFRACTORY_MS));
    let reach = recording.samples(HEIGHT_MS);
    let height = |i: &usize| {
        let finite = |range: &[f64]| {
            range
                .iter()
                .copied()
                .filter(|p| p.is_finite())
                .collect::<Vec<_>>()
        };
        let before = finite(&pressure_mmhg[i.saturating_sub(reach)..=*i])
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let after = finite(&pressure_mmhg[*i..(i + reach + 1).min(pressure_mmhg.len())]);
        after.into_iter().fold(f64::NEG_INFINITY, f64::max) - before
    };
    let heights: Vec<f64> = found.iter().map(height).collect();
    let mut sorted = heights.clone();
    sorted.sort_by(f64::total_cmp);
    let usual_height = sorted
        .get((USUAL * sorted.len() as f64) as usize)
        .copied()
        .unwrap_or(0.0);
    std::iter::zip(found, heights)
        .filter(|(_, height)| *height >= HEIGHT * usual_height)
        .map(|(i, _)| i)
        .map(|i| {
            let at = |k: usize| slopes.get(k).copied().unwrap_or(slopes[i]);
            (i as f64 + vertex(at(i.wrapping_sub(1)), slopes[i], at(i + 1))) * recording.step_ms
        })
        .collect()
}
