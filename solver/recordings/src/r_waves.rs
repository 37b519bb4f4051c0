//! Detection of R waves in an electrocardiogram: first from the slope's energy relative to the
//! typical one, then from the peak itself.

use crate::filter::{median, moving_average, usual_peaks, vertex};
use crate::landmarks::{HALF_WIDTH_MS, refine};
use crate::recording::Recording;

/// Half widths of the two moving averages whose difference passes the QRS complex \[ms\].
const BAND_MS: (f64, f64) = (4.0, 60.0);
/// Half width over which the slope's energy is summed, approximately a QRS complex \[ms\].
const GATHER_MS: f64 = 40.0;
/// Energy relative to the typical one above which there is a QRS complex, dimensionless. A T wave
/// reaches a hundredth, a wide ectopic complex a quarter.
const THRESHOLD: f64 = 0.08;
/// Smallest time between two complexes \[ms\].
const REFRACTORY_MS: f64 = 180.0;
/// Distance from the energy's maximum within which the peak is searched \[ms\].
const REACH_MS: f64 = 70.0;
/// Interval over which the typical energy is computed, at least one beat \[ms\].
const WINDOW_MS: f64 = 2000.0;

/// Half width of the median that takes out pacing spikes \[ms\]. A spike lasts up to 2 ms, and the
/// filters of an amplifier widen it; a human QRS complex lasts 60 ms or more.
const SPIKE_MS: f64 = 8.0;

/// The electrocardiogram without pacing spikes: a running median.
pub(crate) fn without_spikes(recording: &Recording, ecg_mv: &[f64]) -> Vec<f64> {
    let half = recording.samples(SPIKE_MS);
    (0..ecg_mv.len())
        .map(|i| {
            if ecg_mv[i].is_finite() {
                let near = &ecg_mv[i.saturating_sub(half)..(i + half + 1).min(ecg_mv.len())];
                median(near.iter().copied())
            } else {
                f64::NAN
            }
        })
        .collect()
}

/// Times of R waves after the recording's beginning \[ms\].
pub(crate) fn find(recording: &Recording, ecg_mv: &[f64]) -> Vec<f64> {
    let samples = |ms| recording.samples(ms);
    let (fine, coarse) = (
        moving_average(ecg_mv, samples(BAND_MS.0)),
        moving_average(ecg_mv, samples(BAND_MS.1)),
    );
    let band: Vec<f64> = fine
        .iter()
        .zip(&coarse)
        .zip(ecg_mv)
        .map(|((f, c), e)| if e.is_finite() { f - c } else { f64::NAN })
        .collect();
    let lag = samples(4.0);
    let mut energy = vec![0.0; band.len()];
    for i in lag..band.len().saturating_sub(lag) {
        let difference = band[i + lag] - band[i - lag];
        energy[i] = if difference.is_finite() {
            difference * difference
        } else {
            0.0
        };
    }
    let energy = moving_average(&energy, samples(GATHER_MS));
    let window = samples(WINDOW_MS);
    let usual = usual_peaks(&energy, ecg_mv, window);
    let complexes = regions(
        &energy,
        |i| THRESHOLD * usual[(i / window).min(usual.len() - 1)],
        samples(REFRACTORY_MS),
    );
    // The deflection has the same sign in each beat: positive, or negative for some leads.
    let reach = samples(REACH_MS);
    let around = |peak: usize| peak.saturating_sub(reach)..(peak + reach + 1).min(band.len());
    let largest = |sign: f64, peak: usize| {
        around(peak)
            .map(|i| sign * band[i])
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let height = |sign: f64| median(complexes.iter().map(|peak| largest(sign, *peak)));
    let sign = if height(1.0) >= height(-1.0) {
        1.0
    } else {
        -1.0
    };
    let peaks: Vec<f64> = complexes
        .iter()
        .filter_map(|peak| {
            let i = around(*peak)
                .filter(|i| band[*i].is_finite())
                .max_by(|a, b| (sign * band[*a]).total_cmp(&(sign * band[*b])))?;
            let neighbour = |k: usize| {
                band.get(k)
                    .copied()
                    .filter(|v| v.is_finite())
                    .unwrap_or(band[i])
            };
            let offset = vertex(neighbour(i.wrapping_sub(1)), band[i], neighbour(i + 1));
            Some((i as f64 + offset) * recording.step_ms)
        })
        .collect();
    // Noise shifts the top of a peak, but hardly affects the fit of the whole complex.
    refine(recording, &band, &peaks, HALF_WIDTH_MS)
}

/// Positions of the maximum of each stretch above the threshold; of two within `apart` samples, the
/// larger one.
pub(crate) fn regions(
    values: &[f64],
    threshold: impl Fn(usize) -> f64,
    apart: usize,
) -> Vec<usize> {
    let mut found: Vec<usize> = Vec::new();
    let mut best: Option<usize> = None;
    let mut close = |best: &mut Option<usize>| {
        let Some(peak) = best.take() else { return };
        match found.last().copied() {
            Some(last) if peak - last < apart => {
                if values[peak] > values[last] {
                    found.pop();
                    found.push(peak);
                }
            }
            _ => found.push(peak),
        }
    };
    for (i, value) in values.iter().enumerate() {
        let above = *value > threshold(i) && *value > 0.0;
        if above && best.is_none_or(|b| *value > values[b]) {
            best = Some(i);
        } else if !above {
            close(&mut best);
        }
    }
    close(&mut best);
    found
}
