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
    let half = if recording.step_ms > SMOOTH_MS {
        0
    } else {
        recording.samples(SMOOTH_MS)
    };
    slope(&smooth(pressure_mmhg, half), recording.step_ms)
}

/// Slope over the usual steepest one that no heart makes, dimensionless: a flush, a whip, a plug.
const ARTEFACT: f64 = 2.2;
/// What lies so near to one is none either, ms.
const AROUND_MS: f64 = 15.0;

/// A rise is followed over so much time to both sides, ms.
const HEIGHT_MS: f64 = 130.0;
/// Height of a rise over the usual one that makes a beat, dimensionless: the aorta rises again after its notch, as steeply but
/// not as high.
const HEIGHT: f64 = 0.4;
/// Share of the rises that may be lower than the usual one: half of them may follow a notch.
const USUAL: f64 = 0.75;

/// Times of the steepest rises since the recording's begin, ms.
pub(crate) fn find(recording: &Recording, pressure_mmhg: &[f64], slopes: &[f64]) -> Vec<f64> {
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
