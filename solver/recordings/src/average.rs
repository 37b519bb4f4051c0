//! Mean of the accepted beats. Rises are aligned with rises and falls with falls, and diastole is
//! stretched to a common length, so that the mean is as steep as its beats.

use cardiotwin_vocabulary::preparation::AverageStep;

use crate::beats::Beat;
use crate::drift::Drift;
use crate::filter::{median, periodic_slope, periodic_smooth};
use crate::landmarks::{HALF_WIDTH_MS, Mean};
use crate::recording::{Recording, at};

/// Duration of relaxation after the fall \[ms\]. It is the same in short and long beats.
const RELAXATION_MS: f64 = 150.0;
/// Largest duration of relaxation, as a share of diastole.
const RELAXATION_SHARE: f64 = 0.4;
/// Step of the mean \[ms\], unless the recording has a longer one.
const STEP_MS: f64 = 1.0;
/// Number of passes in which beats are aligned with the mean.
const ROUNDS: usize = 2;
/// Half width of the smoothing before slopes of the mean are computed \[ms\].
const SMOOTH_MS: f64 = 3.0;

/// A mean trace, sample by sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeanTrace {
    /// Mean of each sample.
    pub mean: Vec<f64>,
    /// Standard deviation of each sample between beats.
    pub sd: Vec<f64>,
}

/// Mean of the accepted beats, on a uniform grid over one cycle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Average {
    /// Cycle length of the mean beat \[ms\].
    pub cycle_length_ms: f64,
    /// Distance between samples \[ms\]. The first sample is at the beginning of the beat, and the
    /// last one lies before its end.
    pub step_ms: f64,
    /// Number of averaged beats; 1 for a single beat.
    pub n_averaged: usize,
    /// Shortest and longest of the beats \[ms\].
    pub lengths_ms: [f64; 2],
    /// Time of the leading pressure's steepest rise \[ms\].
    pub rise_ms: f64,
    /// Time of the leading pressure's steepest fall \[ms\].
    pub fall_ms: f64,
    /// Standard deviations of rise and fall times between beats \[ms\].
    pub landmark_sd_ms: [f64; 2],
    /// Pressure of the left ventricle \[mmHg\].
    pub lv_pressure: Option<MeanTrace>,
    /// Pressure in the aorta \[mmHg\].
    pub aortic_pressure: Option<MeanTrace>,
    /// Flow in the aorta \[mL/s\].
    pub flow: Option<MeanTrace>,
    /// Volume of the left ventricle that was recorded with the pressure \[mL\].
    pub lv_volume: Option<MeanTrace>,
    /// Differences of each beat's leading pressure from the mean \[mmHg\].
    pub residuals_mmhg: Vec<Vec<f64>>,
}

/// Drifts that are removed before the averaging.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drifts {
    /// Drift of the ventricle's pressure.
    pub lv_pressure: Option<Drift>,
    /// Drift of the aorta's pressure.
    pub aortic_pressure: Option<Drift>,
}

/// Averages beats with the given `numbers`, from 1.
///
/// # Panics
/// If `beats` is empty.
#[must_use]
pub fn average(
    recording: &Recording,
    beats: &[Beat],
    numbers: &[usize],
    drifts: &Drifts,
    settings: &AverageStep,
) -> Average {
    let cycle_length_ms = settings
        .cycle_length_ms
        .unwrap_or_else(|| median(beats.iter().map(|beat| beat.length_ms)));
    let step_ms = STEP_MS.max(recording.step_ms);
    let n = ((cycle_length_ms / step_ms - 1e-6).floor() as usize + 1).max(8);
    let leading_drift = if recording.channels.lv_pressure_mmhg.is_some() {
        drifts.lv_pressure
    } else {
        drifts.aortic_pressure
    };
    let mut frame = Frame {
        recording,
        cycle_length_ms,
        step_ms,
        n,
        rise_ms: 0.0,
        fall_ms: 0.0,
    };
    let leading = recording.leading_pressure();
    let mut warps: Vec<Warp> = beats.iter().map(|beat| frame.plain(beat)).collect();
    let mut mean = frame.mean(leading, leading_drift, beats, &warps).mean;
    (frame.rise_ms, frame.fall_ms) = frame.landmarks(&mean);
    warps = beats
        .iter()
        .map(|beat| frame.warp(beat, frame.rise_ms, frame.fall_ms))
        .collect();
    let mut landmark_sd_ms = [0.0; 2];
    if settings.align && beats.len() > 1 {
        for _ in 0..ROUNDS {
            mean = frame.mean(leading, leading_drift, beats, &warps).mean;
            let laid_on = Mean {
                values: &mean,
                step_ms,
                half_width_ms: HALF_WIDTH_MS,
            };
            let here: Vec<(f64, f64)> = beats
                .iter()
                .map(|beat| {
                    let at = |t: f64| {
                        laid_on
                            .locate(recording, leading, beat.onset_ms, t)
                            .unwrap_or(t)
                    };
                    (at(frame.rise_ms), at(frame.fall_ms))
                })
                .collect();
            frame.rise_ms = median(here.iter().map(|x| x.0));
            frame.fall_ms = median(here.iter().map(|x| x.1));
            landmark_sd_ms = [sd(here.iter().map(|x| x.0)), sd(here.iter().map(|x| x.1))];
            warps = beats
                .iter()
                .zip(&here)
                .map(|(beat, (rise, fall))| frame.warp(beat, *rise, *fall))
                .collect();
        }
    }
    let of_all = frame.mean(leading, leading_drift, beats, &warps);
    let residuals: Vec<Vec<f64>> = beats
        .iter()
        .zip(&warps)
        .map(|(beat, warp)| {
            frame
                .beat(leading, leading_drift, beat, warp)
                .zip(&of_all.mean)
                .map(|(p, m)| p - m)
                .collect()
        })
        .collect();
    let one = (!settings.enabled).then(|| {
        let by_number = settings
            .beat
            .and_then(|number| numbers.iter().position(|n| *n == number as usize));
        let size = |i: usize| residuals[i].iter().map(|r| r * r).sum::<f64>();
        by_number.unwrap_or_else(|| {
            (0..beats.len())
                .min_by(|a, b| size(*a).total_cmp(&size(*b)))
                .unwrap_or(0)
        })
    });
    let of_channel = |values: &Option<Vec<f64>>, drift: Option<Drift>| -> Option<MeanTrace> {
        let values = values.as_ref()?;
        let mut trace = frame.mean(values, drift, beats, &warps);
        if let Some(i) = one {
            trace.mean = frame.beat(values, drift, &beats[i], &warps[i]).collect();
        }
        Some(trace)
    };
    let range = beats
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], b| {
            [l.min(b.length_ms), h.max(b.length_ms)]
        });
    Average {
        cycle_length_ms,
        step_ms,
        n_averaged: if one.is_some() { 1 } else { beats.len() },
        lengths_ms: range,
        rise_ms: frame.rise_ms,
        fall_ms: frame.fall_ms,
        landmark_sd_ms,
        lv_pressure: of_channel(&recording.channels.lv_pressure_mmhg, drifts.lv_pressure),
        aortic_pressure: of_channel(
            &recording.channels.aortic_pressure_mmhg,
            drifts.aortic_pressure,
        ),
        flow: of_channel(&recording.channels.flow_ml_per_s, None),
        lv_volume: of_channel(&recording.channels.lv_volume_ml, None),
        residuals_mmhg: residuals,
    }
}

impl Average {
    /// Mean of the leading pressure \[mmHg\].
    #[must_use]
    pub fn leading_pressure(&self) -> &[f64] {
        self.lv_pressure
            .as_ref()
            .or(self.aortic_pressure.as_ref())
            .map_or(&[], |trace| &trace.mean)
    }
}

/// Piecewise linear map from times of the mean to times of a beat, given by its corners. Both times
/// are in ms from the beginning.
type Warp = Vec<(f64, f64)>;

struct Frame<'a> {
    recording: &'a Recording,
    cycle_length_ms: f64,
    step_ms: f64,
    n: usize,
    rise_ms: f64,
    fall_ms: f64,
}

impl Frame<'_> {
    /// Alignment at the beginning without stretching. A shorter beat is held constant after its
    /// end.
    fn plain(&self, beat: &Beat) -> Warp {
        let common = beat.length_ms.min(self.cycle_length_ms);
        vec![
            (0.0, 0.0),
            (common, common),
            (self.cycle_length_ms + 1.0, common),
        ]
    }

    /// Alignment of rise and fall. Relaxation keeps its duration, and the rest of diastole is
    /// stretched.
    fn warp(&self, beat: &Beat, rise: f64, fall: f64) -> Warp {
        let (cycle, length) = (self.cycle_length_ms, beat.length_ms);
        let rest = (cycle - self.fall_ms).min(length - fall);
        let relaxation = RELAXATION_MS.min(RELAXATION_SHARE * rest);
        let sound = self.rise_ms > 0.0
            && self.fall_ms > self.rise_ms
            && rise > 0.0
            && fall > rise
            && relaxation > 0.0;
        if !sound {
            return vec![(0.0, 0.0), (cycle, length)];
        }
        vec![
            (0.0, 0.0),
            (self.rise_ms, rise),
            (self.fall_ms, fall),
            (self.fall_ms + relaxation, fall + relaxation),
            (cycle, length),
        ]
    }

    fn beat<'b>(
        &'b self,
        values: &'b [f64],
        drift: Option<Drift>,
        beat: &'b Beat,
        warp: &'b Warp,
    ) -> impl Iterator<Item = f64> + 'b {
        let mut corner = 0;
        (0..self.n).map(move |k| {
            let t = k as f64 * self.step_ms;
            while corner + 2 < warp.len() && warp[corner + 1].0 <= t {
                corner += 1;
            }
            let ((t0, b0), (t1, b1)) = (warp[corner], warp[corner + 1]);
            let since = beat.onset_ms + b0 + (b1 - b0) * (t - t0) / (t1 - t0);
            let drift = drift.map_or(0.0, |d| d.at(self.recording.elapsed_ms(since)));
            at(values, self.recording.position(since)) - drift
        })
    }

    fn mean(
        &self,
        values: &[f64],
        drift: Option<Drift>,
        beats: &[Beat],
        warps: &[Warp],
    ) -> MeanTrace {
        let (mut sum, mut squares, mut count) =
            (vec![0.0; self.n], vec![0.0; self.n], vec![0.0; self.n]);
        // Squares of differences from the first beat's values, because squares of pressures near
        // 100 would lose digits.
        let mut base: Vec<f64> = Vec::new();
        for (beat, warp) in beats.iter().zip(warps) {
            let here: Vec<f64> = self.beat(values, drift, beat, warp).collect();
            if base.is_empty() {
                base = here
                    .iter()
                    .map(|v| if v.is_finite() { *v } else { 0.0 })
                    .collect();
            }
            for k in 0..self.n {
                let d = here[k] - base[k];
                if d.is_finite() {
                    sum[k] += d;
                    squares[k] += d * d;
                    count[k] += 1.0;
                }
            }
        }
        let mean = (0..self.n)
            .map(|k| base[k] + sum[k] / f64::max(count[k], 1.0))
            .collect();
        let sd = (0..self.n)
            .map(|k| {
                let m = sum[k] / f64::max(count[k], 1.0);
                let variance = (squares[k] - count[k] * m * m) / f64::max(count[k] - 1.0, 1.0);
                variance.max(0.0).sqrt()
            })
            .collect();
        MeanTrace { mean, sd }
    }

    /// Times of the steepest rise, and of the steepest fall after the peak.
    fn landmarks(&self, mean: &[f64]) -> (f64, f64) {
        let half = (SMOOTH_MS / self.step_ms) as usize;
        let slope = periodic_slope(&periodic_smooth(mean, half), self.step_ms);
        // Shorter beats are held constant in the last samples, which are therefore excluded.
        let last = (0.85 * self.n as f64) as usize;
        let peak = (0..last)
            .max_by(|a, b| mean[*a].total_cmp(&mean[*b]))
            .unwrap_or(0);
        let rise = (1..peak.max(2))
            .max_by(|a, b| slope[*a].total_cmp(&slope[*b]))
            .unwrap_or(1);
        let fall = (peak + 1..last.max(peak + 2))
            .min_by(|a, b| slope[*a % self.n].total_cmp(&slope[*b % self.n]));
        (
            rise as f64 * self.step_ms,
            fall.unwrap_or(peak + 1) as f64 * self.step_ms,
        )
    }
}

fn sd(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Channels;

    fn bell(t: f64, rise: f64, fall: f64) -> f64 {
        8.0 + 100.0 / (1.0 + (-(t - rise) / 9.0).exp()) / (1.0 + ((t - fall) / 16.0).exp())
    }

    /// The rises and falls of beats are shifted by a few ms; the mean of the aligned beats is as
    /// steep as each of them.
    #[test]
    fn an_aligned_mean_is_as_steep_as_its_beats() {
        let beats: Vec<Beat> = (0..40)
            .map(|i| Beat {
                onset_ms: 800.0 * f64::from(i),
                length_ms: 800.0,
            })
            .collect();
        let wander = |i: usize| 9.0 * ((i * 7 % 13) as f64 / 6.0 - 1.0);
        let pressure: Vec<f64> = (0..33_000)
            .map(|s| {
                let i = s / 800;
                bell((s % 800) as f64, 70.0 + wander(i), 330.0 + wander(i + 3))
            })
            .collect();
        let recording = Recording {
            step_ms: 1.0,
            channels: Channels {
                lv_pressure_mmhg: Some(pressure),
                ..Channels::default()
            },
            ..Recording::default()
        };
        let numbers: Vec<usize> = (1..=40).collect();
        let of = |align| {
            let settings = AverageStep {
                align,
                ..AverageStep::default()
            };
            average(&recording, &beats, &numbers, &Drifts::default(), &settings)
        };
        let steepest = |a: &Average| {
            periodic_slope(a.leading_pressure(), 1.0)
                .into_iter()
                .fold(0.0, f64::max)
        };
        let each = (0..800)
            .map(|t| bell(f64::from(t) + 1.0, 70.0, 330.0) - bell(f64::from(t) - 1.0, 70.0, 330.0));
        let each = each.fold(0.0, f64::max) / 2.0;
        let (aligned, plain) = (of(true), of(false));
        assert!(
            steepest(&aligned) > 0.985 * each,
            "{} of {each}",
            steepest(&aligned)
        );
        assert!(
            steepest(&plain) < 0.95 * each,
            "{} of {each}",
            steepest(&plain)
        );
        assert!(
            (aligned.rise_ms - 70.0).abs() < 1.5 && (aligned.fall_ms - 330.0).abs() < 3.0,
            "{aligned:?}"
        );
        assert!(
            (aligned.landmark_sd_ms[0] - 5.8).abs() < 1.0,
            "{:?}",
            aligned.landmark_sd_ms
        );
        let one = AverageStep {
            enabled: false,
            beat: Some(5),
            ..AverageStep::default()
        };
        let one = average(&recording, &beats, &numbers, &Drifts::default(), &one);
        assert_eq!(one.n_averaged, 1);
    }

    #[test]
    fn beats_of_different_lengths_give_one_of_the_usual_length() {
        let mut onset = 0.0;
        let lengths = [760.0, 840.0, 800.0, 790.0, 810.0, 800.0];
        let mut pressure = Vec::new();
        let mut beats = Vec::new();
        for length in lengths {
            beats.push(Beat {
                onset_ms: onset,
                length_ms: length,
            });
            pressure.extend((0..length as usize).map(|t| bell(t as f64, 70.0, 330.0)));
            onset += length;
        }
        pressure.extend(std::iter::repeat_n(8.0, 900));
        let recording = Recording {
            step_ms: 1.0,
            channels: Channels {
                lv_pressure_mmhg: Some(pressure),
                ..Channels::default()
            },
            ..Recording::default()
        };
        let a = average(
            &recording,
            &beats,
            &[1, 2, 3, 4, 5, 6],
            &Drifts::default(),
            &AverageStep::default(),
        );
        assert_eq!(
            (a.cycle_length_ms, a.lengths_ms, a.leading_pressure().len()),
            (800.0, [760.0, 840.0], 800)
        );
        let worst = (0..800)
            .map(|t| (a.leading_pressure()[t] - bell(t as f64, 70.0, 330.0)).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.3, "{worst}");
    }
}
