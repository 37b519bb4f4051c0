//! Rates of a noisy pressure: slopes of straight lines over a window as long as the noise asks for.
//!
//! The largest of a thousand central differences of a noisy trace is the noise's, not the heart's. Where a trace was
//! measured with noise, its rates, and those of every trace that is compared with it, are slopes of least-squares lines over a
//! window (Savitzky and Golay 1964, Anal. Chem. 36:1627, of first order): what the window takes off a steep upstroke it takes
//! off both.

use cardiotwin_units::Ms;

use crate::Trace;
use crate::cycle::{Continuation, Cycle};

/// Standard deviation of a rate's noise that needs no longer window, over the largest rate.
pub const TOLERATED_NOISE: f64 = 0.03;
/// Samples on each side of the longest window.
const LONGEST: isize = 20;
/// |z| of a standard normal number stays below this with a probability of 1/4.
const LOWER_QUARTILE: f64 = 0.318_639;

/// The window over which rates of a measured pressure are to be taken; none where central differences do.
///
/// - `pressure`: at the common step of 1 ms
#[must_use]
pub fn rate_window(pressure: &Trace, continuation: Continuation) -> Option<Ms> {
    let cycle = Cycle::new(pressure.time_ms(), pressure.values(), continuation);
    let quiet = |reach: &isize| noise_over_largest(&cycle, *reach).is_none_or(|noise| noise <= TOLERATED_NOISE);
    let reach = (1..=LONGEST).find(quiet).unwrap_or(LONGEST);
    let step_ms = cycle.time(1) - cycle.time(0);
    (reach > 1).then(|| Ms(2.0 * reach as f64 * step_ms))
}

/// Samples on each side of a window around a sample.
pub(crate) fn reach_of(window: Ms, cycle: &Cycle) -> isize {
    let step_ms = if cycle.len() > 1 { cycle.time(1) - cycle.time(0) } else { window.0 };
    ((0.5 * window.0 / step_ms).round() as isize).max(1)
}

/// Standard deviation of the noise of slopes over windows, over the largest slope; none for a trace that is too short.
///
/// Three windows side by side: the second difference of their slopes is the noise's, since the beat itself hardly bends
/// there for most of the time. The lower quartile leaves out where it does.
fn noise_over_largest(cycle: &Cycle, reach: isize) -> Option<f64> {
    let apart = 2 * reach + 1;
    let slope = |i: isize| cycle.slope_over(i, reach);
    let seconds = (0..cycle.len() as isize)
        .filter_map(|i| Some((slope(i - apart)? - 2.0 * slope(i)? + slope(i + apart)?).abs() / 6.0_f64.sqrt()));
    let mut seconds: Vec<f64> = seconds.collect();
    seconds.sort_by(f64::total_cmp);
    let quartile = seconds.get(seconds.len() / 4)?;
    let largest = (0..cycle.len() as isize).filter_map(slope).map(f64::abs).fold(0.0, f64::max);
    (largest > 0.0).then(|| quartile / LOWER_QUARTILE / largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BiomarkerSet, Quantity};

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
        let window = |rms: f64| rate_window(&trace(rms), Continuation::periodic(CYCLE)).map(|w| w.0);
        assert_eq!(window(0.0), None);
        let (little, much) = (window(0.3).expect("noise"), window(1.5).expect("noise"));
        assert!(little < much && much <= 40.0, "{little} and {much} ms");
    }

    #[test]
    fn rates_of_a_noisy_trace_are_those_of_the_beat_over_the_same_window() {
        let (smooth, noisy, periodic) = (trace(0.0), trace(1.5), Continuation::periodic(CYCLE));
        let window = rate_window(&noisy, periodic);
        let of = |trace: &Trace, window| {
            BiomarkerSet::of(Some(trace), None, periodic).expect("biomarkers").with_rates(trace, periodic, window)
        };
        let fastest = |set: BiomarkerSet| set.dpdt_max_mmhg_per_ms.expect("a rise");
        let (known, differences, lines) =
            (fastest(of(&smooth, window)), fastest(of(&noisy, None)), fastest(of(&noisy, window)));
        assert!((lines / known - 1.0).abs() < 0.1, "{lines} for {known} mmHg/ms");
        assert!(differences / known > 1.5, "{differences} for {known} mmHg/ms");
    }

    #[test]
    fn a_line_has_its_slope_over_any_window() {
        let values: Vec<f64> = (0..100).map(|k| 3.0 + 0.25 * f64::from(k)).collect();
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let cycle = Cycle::new(&times, &values, Continuation::Single);
        for reach in [1, 2, 7, 20] {
            assert!((cycle.slope_over(50, reach).expect("a slope") - 0.25).abs() < 1e-12);
            assert!(cycle.slope_over(reach - 1, reach).is_none() && cycle.slope_over(100 - reach, reach).is_none());
        }
    }
}
