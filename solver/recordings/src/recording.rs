//! Continuous recordings, with all channels on one clock and one step.

use crate::filter::median;

/// Distance between samples, in typical steps, above which there is a gap. Below it, a lost sample
/// is interpolated.
const GAP_STEPS: f64 = 3.5;
/// Deviation of times from the grid, as a share of the step, above which values are interpolated.
const ON_GRID: f64 = 0.02;
/// Smallest number of samples.
const FEWEST: usize = 100;
/// Accepted steps of a heart's recording \[ms\].
const STEPS_MS: std::ops::RangeInclusive<f64> = 0.05..=20.0;
/// Largest number of samples on a grid. Gaps are filled with missing samples, and a time that is
/// wrong by hours must not exhaust the memory.
const MOST: usize = 200_000_000;
/// Number of samples on a grid up to which a recording may consist of gaps almost entirely.
const WITH_PAUSES: f64 = 4e6;
/// Longest gap that the grid contains in full \[ms\]. It is longer than any beat, so that no beat spans
/// it, and of a longer pause the rest needs no samples.
const LONGEST_GAP_MS: f64 = 10_000.0;
/// Largest distance from a sample, in steps, at which its value is taken.
const AT_SAMPLE: f64 = 0.02;

/// Reasons why samples do not form a recording.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RecordingError {
    /// There are too few samples.
    #[error("{n_samples} samples, but a recording needs at least {FEWEST}")]
    TooFew {
        /// Number of samples that were given.
        n_samples: usize,
    },
    /// The typical distance between samples is outside the accepted range.
    #[error("a sample every {step_ms} ms, but the step must be 0.05 to 20 ms")]
    Step {
        /// Typical distance between samples \[ms\].
        step_ms: f64,
    },
    /// The samples fill only a small part of the time span.
    #[error(
        "times from {first_ms} to {last_ms} ms, but only {n_samples} samples every {step_ms} ms"
    )]
    Span {
        /// Time of the first sample \[ms\].
        first_ms: f64,
        /// Time of the last sample \[ms\].
        last_ms: f64,
        /// Number of samples that were given.
        n_samples: usize,
        /// Typical distance between samples \[ms\].
        step_ms: f64,
    },
    /// There is no channel with a pressure.
    #[error("neither a ventricular nor an aortic pressure")]
    NoPressure,
}

/// Channels of a recording, each with a value for every sample time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channels {
    /// Pressure of the left ventricle \[mmHg\]; `None` if it was not recorded.
    pub lv_pressure_mmhg: Option<Vec<f64>>,
    /// Pressure in the aorta \[mmHg\]; `None` if it was not recorded.
    pub aortic_pressure_mmhg: Option<Vec<f64>>,
    /// Flow in the ascending aorta \[mL/s\], positive out of the heart; `None` if it was not
    /// recorded.
    pub flow_ml_per_s: Option<Vec<f64>>,
    /// Voltage of the electrocardiogram \[mV\]; `None` if it was not recorded.
    pub ecg_mv: Option<Vec<f64>>,
    /// Volume of the left ventricle on the pressure's clock \[mL\], as from a conductance catheter;
    /// `None` if it was not recorded.
    pub lv_volume_ml: Option<Vec<f64>>,
}

/// Part of a long gap that the grid leaves out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pause {
    /// Position of the first sample behind the gap on the grid, after the first sample \[ms\].
    pub until_ms: f64,
    /// Length of the whole gap \[ms\].
    pub gap_ms: f64,
    /// Time that the grid leaves out \[ms\].
    pub left_out_ms: f64,
}

/// Channels on a common grid; a missing sample is NaN.
///
/// Positions and times "after the first sample" are those of the grid. The clock of the file runs on in
/// pauses, of which the grid leaves a part out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Time of the first sample \[ms\].
    pub begin_ms: f64,
    /// Distance between samples \[ms\].
    pub step_ms: f64,
    /// Channels on the grid.
    pub channels: Channels,
    /// Pauses of which the grid leaves out a part, in temporal order.
    pub pauses: Vec<Pause>,
}

impl Recording {
    /// Resamples channels to a grid with their typical step. Samples on the grid stay unchanged,
    /// and others are interpolated linearly. If more than three in a row are lost, they are
    /// missing.
    /// - `time_ms`: times of the samples \[ms\], increasing
    ///
    /// # Errors
    /// [`RecordingError`] for too few samples, a step out of range, or no pressure.
    pub fn new(time_ms: &[f64], channels: Channels) -> Result<Self, RecordingError> {
        let n = time_ms.len();
        if n < FEWEST {
            return Err(RecordingError::TooFew { n_samples: n });
        }
        if channels.lv_pressure_mmhg.is_none() && channels.aortic_pressure_mmhg.is_none() {
            return Err(RecordingError::NoPressure);
        }
        let (first_ms, last_ms) = (time_ms[0], time_ms[n - 1]);
        let usual = median(time_ms.windows(2).take(100_000).map(|w| w[1] - w[0]));
        if !STEPS_MS.contains(&usual) {
            return Err(RecordingError::Step { step_ms: usual });
        }
        // Without gaps, the whole length determines the step more accurately than a single
        // difference of rounded times.
        let mean = (last_ms - first_ms) / (n - 1) as f64;
        let without_gaps = time_ms.windows(2).all(|w| w[1] - w[0] < 1.8 * usual);
        let step_ms = if without_gaps || (mean / usual - 1.0).abs() < 1e-3 {
            mean
        } else {
            usual
        };
        let (time_ms, pauses) = without_pauses(time_ms, step_ms);
        let time_ms = time_ms.as_slice();
        let n_grid = ((time_ms[n - 1] - first_ms) / step_ms).round() + 1.0;
        if n_grid > MOST as f64 || n_grid > (50.0 * n as f64).max(WITH_PAUSES) {
            return Err(RecordingError::Span {
                first_ms,
                last_ms,
                n_samples: n,
                step_ms,
            });
        }
        let on_grid =
            |i: usize| (time_ms[i] - first_ms - i as f64 * step_ms).abs() <= ON_GRID * step_ms;
        let grid = Grid {
            time_ms,
            step_ms,
            n: n_grid as usize,
        };
        let as_it_is = n_grid as usize == n && (0..n).all(on_grid);
        let place =
            |values: Option<Vec<f64>>| values.map(|v| if as_it_is { v } else { grid.place(&v) });
        Ok(Self {
            begin_ms: first_ms,
            step_ms,
            channels: Channels {
                lv_pressure_mmhg: place(channels.lv_pressure_mmhg),
                aortic_pressure_mmhg: place(channels.aortic_pressure_mmhg),
                flow_ml_per_s: place(channels.flow_ml_per_s),
                ecg_mv: place(channels.ecg_mv),
                lv_volume_ml: place(channels.lv_volume_ml),
            },
            pauses,
        })
    }

    /// Pressure by which beats are selected and aligned: the ventricle's or, without it, the
    /// aorta's.
    #[must_use]
    pub fn leading_pressure(&self) -> &[f64] {
        let channels = &self.channels;
        channels
            .lv_pressure_mmhg
            .as_deref()
            .or(channels.aortic_pressure_mmhg.as_deref())
            .unwrap_or_default()
    }

    /// Number of samples on the grid.
    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.leading_pressure().len()
    }

    /// Length of the grid \[ms\], without what is left out of pauses.
    #[must_use]
    pub fn length_ms(&self) -> f64 {
        self.n_samples().saturating_sub(1) as f64 * self.step_ms
    }

    /// Time from the first to the last sample on the file's clock \[ms\].
    #[must_use]
    pub fn duration_ms(&self) -> f64 {
        self.elapsed_ms(self.length_ms())
    }

    /// Time on the file's clock since the first sample, of a time on the grid \[ms\].
    #[must_use]
    pub fn elapsed_ms(&self, since_begin_ms: f64) -> f64 {
        // A beat that begins with the first sample behind a pause is behind it.
        let before = |pause: &&Pause| pause.until_ms <= since_begin_ms + 0.5 * self.step_ms;
        let left_out: f64 = self
            .pauses
            .iter()
            .take_while(before)
            .map(|pause| pause.left_out_ms)
            .sum();
        since_begin_ms + left_out
    }

    /// Time on the grid after the first sample, of a time on the file's clock \[ms\]. Times within what
    /// is left out of a pause are its end.
    #[must_use]
    pub fn since_begin_ms(&self, clock_ms: f64) -> f64 {
        let mut since = clock_ms - self.begin_ms;
        for pause in &self.pauses {
            if since < pause.until_ms {
                break;
            }
            since = (since - pause.left_out_ms).max(pause.until_ms);
        }
        since
    }

    /// Number of samples in a time \[ms\], at least one.
    pub(crate) fn samples(&self, ms: f64) -> usize {
        ((ms / self.step_ms).round() as usize).max(1)
    }

    /// Position of a time since the first sample, in samples.
    pub(crate) fn position(&self, since_begin_ms: f64) -> f64 {
        since_begin_ms / self.step_ms
    }
}

/// Times in which gaps are no longer than [`LONGEST_GAP_MS`], and what was left out of them. The samples
/// behind a pause lie on the grid of those before it, because their distance is a number of steps.
fn without_pauses(time_ms: &[f64], step_ms: f64) -> (Vec<f64>, Vec<Pause>) {
    let mut pauses = Vec::new();
    let mut left_out_ms = 0.0;
    let mut out = Vec::with_capacity(time_ms.len());
    let mut before = time_ms[0];
    for time in time_ms {
        let gap_ms = time - before;
        if gap_ms > LONGEST_GAP_MS + step_ms {
            let since: f64 = before - left_out_ms - time_ms[0];
            // The next place on the grid from which the gap is at least the longest one.
            let until_ms = ((since + LONGEST_GAP_MS) / step_ms).ceil() * step_ms;
            let of_this = time - left_out_ms - time_ms[0] - until_ms;
            left_out_ms += of_this;
            pauses.push(Pause {
                until_ms,
                gap_ms,
                left_out_ms: of_this,
            });
        }
        out.push(time - left_out_ms);
        before = *time;
    }
    (out, pauses)
}

struct Grid<'a> {
    time_ms: &'a [f64],
    step_ms: f64,
    n: usize,
}

impl Grid<'_> {
    fn place(&self, values: &[f64]) -> Vec<f64> {
        let first = self.time_ms[0];
        let mut j = 0;
        (0..self.n)
            .map(|i| {
                let t = first + i as f64 * self.step_ms;
                while j + 2 < self.time_ms.len() && self.time_ms[j + 1] <= t {
                    j += 1;
                }
                let (t0, t1) = (self.time_ms[j], self.time_ms[j + 1]);
                let share = (t - t0) / (t1 - t0);
                // A sample's value is that of its own time, not of a share of the gap behind it.
                let near = AT_SAMPLE * self.step_ms;
                if t - t0 < near {
                    values[j]
                } else if t1 - t < near {
                    values[j + 1]
                } else if t1 - t0 > GAP_STEPS * self.step_ms {
                    f64::NAN
                } else {
                    values[j] + share * (values[j + 1] - values[j])
                }
            })
            .collect()
    }
}

/// Value of a channel at a position in samples, with cubic interpolation (Catmull and Rom); NaN
/// next to a missing sample.
pub fn at(values: &[f64], position: f64) -> f64 {
    let n = values.len();
    if n < 2 || position < 0.0 || position > (n - 1) as f64 {
        return f64::NAN;
    }
    let i = (position as usize).min(n - 2);
    let x = position - i as f64;
    if x < 1e-9 {
        return values[i];
    }
    let (p1, p2) = (values[i], values[i + 1]);
    let p0 = if i > 0 { values[i - 1] } else { 2.0 * p1 - p2 };
    let p3 = if i + 2 < n {
        values[i + 2]
    } else {
        2.0 * p2 - p1
    };
    let cubic = p1
        + 0.5
            * x
            * (p2 - p0
                + x * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + x * (3.0 * (p1 - p2) + p3 - p0)));
    if cubic.is_finite() {
        cubic
    } else {
        p1 + x * (p2 - p1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(time_ms: &[f64], value: impl Fn(f64) -> f64) -> Result<Recording, RecordingError> {
        let channels = Channels {
            lv_pressure_mmhg: Some(time_ms.iter().map(|t| value(*t)).collect()),
            ..Channels::default()
        };
        Recording::new(time_ms, channels)
    }

    #[test]
    fn samples_on_a_grid_stay_bit_for_bit() {
        let time: Vec<f64> = (0..500).map(|i| 1000.0 + f64::from(i)).collect();
        let r = made(&time, |t| (t / 37.0).sin()).unwrap();
        assert_eq!((r.step_ms, r.begin_ms, r.n_samples()), (1.0, 1000.0, 500));
        assert_eq!(r.leading_pressure()[123], (1123.0_f64 / 37.0).sin());
    }

    #[test]
    fn a_long_gap_is_missing_and_a_lost_sample_is_bridged() {
        let mut time: Vec<f64> = (0..600)
            .map(f64::from)
            .filter(|t| !(200.0..240.0).contains(t))
            .collect();
        time.retain(|t| *t != 300.0);
        let r = made(&time, |t| t).unwrap();
        let p = r.leading_pressure();
        assert_eq!(p.len(), 600);
        assert!(p[199] == 199.0 && p[200].is_nan() && p[239].is_nan() && p[240] == 240.0);
        assert!((p[300] - 300.0).abs() < 1e-9);
    }

    #[test]
    fn a_pause_of_any_length_costs_the_grid_ten_seconds_and_the_clock_runs_on() {
        for pause_ms in [11_000.0, 3.6e6, 86_400_000.3, 6e8] {
            let time: Vec<f64> = (0..800)
                .map(|i| 250.0 + 4.0 * f64::from(i) + if i < 300 { 0.0 } else { pause_ms })
                .collect();
            let r = made(&time, |t| t).unwrap();
            let p = r.leading_pressure();
            assert!(p.len() < 800 + 2510, "{} samples", p.len());
            // Every sample is there with its own value, and the gap has none.
            let found: Vec<f64> = p.iter().copied().filter(|v| v.is_finite()).collect();
            assert_eq!(found, time);
            // Both clocks agree with each other and with the file.
            for (i, v) in p.iter().enumerate().filter(|(_, v)| v.is_finite()) {
                let since = i as f64 * r.step_ms;
                assert!((r.begin_ms + r.elapsed_ms(since) - v).abs() < 1e-6, "{i}");
                assert!((r.since_begin_ms(*v) - since).abs() < 1e-6, "{i}");
            }
            assert!((r.duration_ms() - (799.0 * 4.0 + pause_ms)).abs() < 1e-6);
            assert_eq!(r.pauses.len(), 1);
            assert!((r.pauses[0].gap_ms - pause_ms - 4.0).abs() < 1e-6);
            // A time within the pause is its end.
            let within = r.since_begin_ms(250.0 + 0.9 * pause_ms);
            assert!(within <= r.pauses[0].until_ms, "{within}");
        }
    }

    #[test]
    fn a_gap_has_no_sample_of_either_side() {
        let time: Vec<f64> = (0..2000)
            .map(|i| 4.0 * f64::from(i) + if i < 1000 { 0.0 } else { 9000.0 })
            .collect();
        let r = made(&time, |t| t).unwrap();
        let p = r.leading_pressure();
        assert_eq!(p.iter().filter(|v| v.is_finite()).count(), 2000);
        assert!(p[1000..1000 + 2250].iter().all(|v| v.is_nan()));
    }

    #[test]
    fn rounded_stamps_are_interpolated() {
        let time: Vec<f64> = (0..300).map(|i| (f64::from(i) * 4.9).round()).collect();
        let r = made(&time, |t| 2.0 * t).unwrap();
        assert!((r.step_ms - 4.9).abs() < 0.01, "{}", r.step_ms);
        let p = r.leading_pressure();
        assert!((100..200).all(|i| (p[i] - 2.0 * i as f64 * r.step_ms).abs() < 0.2));
    }

    #[test]
    fn what_is_no_recording_is_refused() {
        let seconds: Vec<f64> = (0..500).map(|i| f64::from(i) * 1e-3).collect();
        assert!(matches!(
            made(&seconds, |t| t),
            Err(RecordingError::Step { .. })
        ));
        // More than half of the samples are lost, far apart from each other.
        let far: Vec<f64> = (0..40_000)
            .map(|i| f64::from(i) * 0.05 + 8000.0 * f64::from(i * 2 / 5))
            .collect();
        assert!(matches!(
            made(&far, |t| t),
            Err(RecordingError::Span { .. })
        ));
        let time: Vec<f64> = (0..500).map(f64::from).collect();
        assert_eq!(
            Recording::new(&time, Channels::default()),
            Err(RecordingError::NoPressure)
        );
    }

    #[test]
    fn a_cubic_goes_through_its_samples_and_bends_between() {
        let v: Vec<f64> = (0..50).map(|i| (f64::from(i) / 8.0).sin()).collect();
        assert_eq!(at(&v, 7.0), v[7]);
        assert!((at(&v, 20.5) - (20.5_f64 / 8.0).sin()).abs() < 1e-4);
        assert!(at(&v, 49.5).is_nan());
    }
}
