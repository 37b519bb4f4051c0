//! Windows over which biomarkers of noisy traces are read, as long as the noise asks for.
//!
//! The largest of a thousand central differences of a noisy pressure is the noise's, not the heart's, and so is the fullest of
//! thirty noisy frames. Where a trace was measured with noise, it and every trace that is compared with it are read over a window:
//! rates of pressure are slopes of least-squares lines, the largest pressure and all of the volume are values of least-squares
//! parabolas (Savitzky and Golay 1964, Anal. Chem. 36:1627). The window takes as much off the simulated trace as off the
//! measured one.

use cardiotwin_units::Ms;
use cardiotwin_vocabulary::biomarkers::NoiseWindows;

use crate::Trace;
use crate::cycle::{Continuation, Cycle};

/// Standard deviation of a rate's noise that needs no longer window, over the largest rate.
pub const TOLERATED_RATE_NOISE: f64 = 0.03;
/// Standard deviation of a volume's noise that needs no longer window, over the stroke volume.
pub const TOLERATED_VOLUME_NOISE: f64 = 0.01;
/// Samples of pressure on each side of the longest window.
const MOST_SAMPLES: isize = 20;
/// Frames of volume on each side of the longest window.
const MOST_FRAMES: usize = 3;
/// Variance of a least-squares parabola's middle value by frames on each side, from 1 on; the noise's own is 1.
const LEFT_OF_VARIANCE: [f64; MOST_FRAMES] = [1.0, 17.0 / 35.0, 1.0 / 3.0];
/// |z| of a standard normal number stays below this with a probability of 1/4.
const LOWER_QUARTILE: f64 = 0.318_639;

/// The windows that measured traces ask for.
///
/// - `pressure`: at the common step of 1 ms
/// - `frames`: the volume as it was measured, not resampled
#[must_use]
pub fn of(
    pressure: Option<&Trace>,
    frames: Option<&Trace>,
    continuation: Continuation,
) -> NoiseWindows {
    NoiseWindows {
        pressure_ms: pressure.and_then(|pressure| pressure_window_ms(pressure, continuation)),
        volume_ms: frames.and_then(volume_window_ms),
    }
}

fn pressure_window_ms(pressure: &Trace, continuation: Continuation) -> Option<f64> {
    let cycle = Cycle::new(pressure.time_ms(), pressure.values(), continuation);
    let quiet = |reach: &isize| {
        noise_over_largest(&cycle, *reach).is_none_or(|noise| noise <= TOLERATED_RATE_NOISE)
    };
    let reach = (1..=MOST_SAMPLES).find(quiet).unwrap_or(MOST_SAMPLES);
    let step_ms = cycle.time(1) - cycle.time(0);
    (reach > 1).then_some(2.0 * reach as f64 * step_ms)
}

/// The noise is told by second differences of neighbouring frames; their lower quartile leaves out where the volume bends.
fn volume_window_ms(frames: &Trace) -> Option<f64> {
    let values = frames.values();
    let mut bends: Vec<f64> = values
        .windows(3)
        .map(|v| (v[0] - 2.0 * v[1] + v[2]).abs() / 6.0_f64.sqrt())
        .collect();
    bends.sort_by(f64::total_cmp);
    let noise = bends.get(bends.len() / 4)? / LOWER_QUARTILE;
    let (least, most) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), v| {
            (least.min(*v), most.max(*v))
        });
    let tolerated = TOLERATED_VOLUME_NOISE * (most - least);
    if noise <= tolerated {
        return None;
    }
    let quiet = |reach: &usize| LEFT_OF_VARIANCE[reach - 1].sqrt() * noise <= tolerated;
    let reach = (2..=MOST_FRAMES).find(quiet).unwrap_or(MOST_FRAMES);
    let time = frames.time_ms();
    Some(2.0 * reach as f64 * (frames.end_ms() - time[0]) / (time.len() - 1) as f64)
}

/// Values of least-squares parabolas over a window around each sample; at the ends of a single beat, over what there is of it.
///
/// - `trace`: at the common step of 1 ms
#[must_use]
pub fn smoothed(trace: &Trace, continuation: Continuation, window: Ms) -> Vec<f64> {
    let cycle = Cycle::new(trace.time_ms(), trace.values(), continuation);
    let reach = reach_of(window, &cycle);
    (0..cycle.len() as isize)
        .map(|i| cycle.parabola_at(i, reach))
        .collect()
}

/// Samples on each side of a window around a sample.
pub(crate) fn reach_of(window: Ms, cycle: &Cycle) -> isize {
    let step_ms = if cycle.len() > 1 {
        cycle.time(1) - cycle.time(0)
    } else {
        window.0
    };
    ((0.5 * window.0 / step_ms).round() as isize).max(1)
}

/// Standard deviation of the noise of slopes over windows, over the largest slope; none for a trace that is too short.
///
/// Three windows side by side: the second difference of their slopes is the noise's, since the beat itself hardly bends
/// there for most of the time. The lower quartile leaves out where it does.
fn noise_over_largest(cycle: &Cycle, reach: isize) -> Option<f64> {
    let apart = 2 * reach + 1;
    let slope = |i: isize| cycle.slope_over(i, reach);
    let seconds = (0..cycle.len() as isize).filter_map(|i| {
        Some((slope(i - apart)? - 2.0 * slope(i)? + slope(i + apart)?).abs() / 6.0_f64.sqrt())
    });
    let mut seconds: Vec<f64> = seconds.collect();
    seconds.sort_by(f64::total_cmp);
    let quartile = seconds.get(seconds.len() / 4)?;
    let largest = (0..cycle.len() as isize)
        .filter_map(slope)
        .map(f64::abs)
        .fold(0.0, f64::max);
    (largest > 0.0).then(|| quartile / LOWER_QUARTILE / largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BeatBiomarkers, Quantity};

    const CYCLE: Ms = Ms(800.0);

    fn beat(time_ms: f64) -> f64 {
        let wave = |at: f64, rise: f64| 1.0 / (1.0 + (-(time_ms - at) / rise).exp());
        8.0 + 110.0 * wave(60.0, 12.0) * (1.0 - wave(330.0, 20.0))
    }

    /// A uniform deviate of unit variance (SplitMix64).
    fn noise(k: usize) -> f64 {
        let mut z = (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        12.0_f64.sqrt() * (((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
    }

    fn trace(rms: f64) -> Trace {
        let values = (0..800).map(|k| beat(k as f64) + rms * noise(k)).collect();
        Trace::uniform(Quantity::Pressure, 1.0, values).expect("a trace")
    }

    #[test]
    fn a_smooth_trace_needs_no_window_and_a_noisy_one_a_longer_one() {
        let window = |rms: f64| {
            super::of(Some(&trace(rms)), None, Continuation::periodic(CYCLE)).pressure_ms
        };
        assert_eq!(window(0.0), None);
        let (little, much) = (window(0.3).expect("noise"), window(1.5).expect("noise"));
        assert!(little < much && much <= 40.0, "{little} and {much} ms");
    }

    #[test]
    fn rates_of_a_noisy_trace_are_those_of_the_beat_over_the_same_window() {
        let (smooth, noisy, periodic) = (trace(0.0), trace(1.5), Continuation::periodic(CYCLE));
        let windows = super::of(Some(&noisy), None, periodic);
        let of = |trace: &Trace, windows| {
            BeatBiomarkers::over(Some(trace), None, periodic, windows).expect("biomarkers")
        };
        let fastest = |set: BeatBiomarkers| set.values.dpdt_max_mmhg_per_ms.expect("a rise");
        let (known, differences, lines) = (
            fastest(of(&smooth, windows)),
            fastest(of(&noisy, NoiseWindows::default())),
            fastest(of(&noisy, windows)),
        );
        assert!(
            (lines / known - 1.0).abs() < 0.1,
            "{lines} for {known} mmHg/ms"
        );
        assert!(
            differences / known > 1.5,
            "{differences} for {known} mmHg/ms"
        );
    }

    #[test]
    fn a_line_has_its_slope_over_any_window() {
        let values: Vec<f64> = (0..100).map(|k| 3.0 + 0.25 * f64::from(k)).collect();
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let cycle = Cycle::new(&times, &values, Continuation::Single);
        for reach in [1, 2, 7, 20] {
            assert!((cycle.slope_over(50, reach).expect("a slope") - 0.25).abs() < 1e-12);
            assert!(
                cycle.slope_over(reach - 1, reach).is_none()
                    && cycle.slope_over(100 - reach, reach).is_none()
            );
        }
    }

    #[test]
    fn noisy_frames_tell_the_stroke_volume_that_smooth_ones_do() {
        let filled = |k: usize| 120.0 - 0.55 * (beat(30.0 * k as f64 + 20.0) - 8.0);
        let frames = |rms: f64, seed: usize| {
            let values = (0..27)
                .map(|k| filled(k) + rms * noise(1000 * seed + k))
                .collect();
            Trace::uniform(Quantity::Volume, 30.0, values).expect("frames")
        };
        let periodic = Continuation::periodic(Ms(810.0));
        let windows = |frames: &Trace| super::of(None, Some(frames), periodic);
        assert_eq!(windows(&frames(0.0, 0)).volume_ms, None);
        let of = |frames: &Trace, windows| {
            BeatBiomarkers::over(None, Some(frames), periodic, windows)
                .expect("biomarkers")
                .values
                .sv_ml
                .expect("a stroke")
        };
        // Errors of forty measurements, as they are and over the window.
        let [mut raw, mut over] = [0.0; 2];
        for noisy in (0..40).map(|seed| frames(2.5, seed)) {
            let window = windows(&noisy);
            raw +=
                of(&noisy, NoiseWindows::default()) - of(&frames(0.0, 0), NoiseWindows::default());
            over += of(&noisy, window) - of(&frames(0.0, 0), window);
        }
        assert!(
            raw / 40.0 > 4.0 && (over / 40.0).abs() < 2.0,
            "{} and {} mL",
            raw / 40.0,
            over / 40.0
        );
    }

    #[test]
    fn a_parabola_is_its_own_over_any_window_and_at_the_ends() {
        let values: Vec<f64> = (0..100)
            .map(|k| 3.0 - 0.25 * f64::from(k) + 0.01 * f64::from(k * k))
            .collect();
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let trace = Trace::new(Quantity::Volume, times, values.clone()).expect("a trace");
        for window in [4.0, 40.0, 150.0] {
            let over = smoothed(&trace, Continuation::Single, Ms(window));
            assert!(
                over.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-8),
                "{window} ms"
            );
        }
    }
}
