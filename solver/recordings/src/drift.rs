//! Drift of a catheter's zero, as a line through the diastolic pressures of the accepted beats.

use cardiotwin_vocabulary::preparation::{DriftStep, ZeroAt};

use crate::beats::Beat;
use crate::filter::{centre_and_spread, median};
use crate::recording::Recording;

/// Smallest drift over the whole recording that is removed \[mmHg\].
const LEAST_MMHG: f64 = 0.5;
/// Smallest drift that is removed, in standard errors of the drift.
const LEAST_ERRORS: f64 = 3.5;
/// Largest number of beats between which slopes are computed.
const MOST_BEATS: usize = 400;
/// Smallest number of beats from which a drift is estimated.
const FEWEST_BEATS: usize = 12;
/// Range of breathing periods \[ms\].
const BREATH_MS: (f64, f64) = (2000.0, 9000.0);
/// Longest recording from which breathing is removed \[ms\]. In longer ones, breaths cancel.
const BREATHS_MS: f64 = 180_000.0;
/// Smallest share of the sum of squares that a wave must explain to count as breathing.
const BREATH_SHARE: f64 = 0.3;
/// Share of a beat's samples that lie below its diastolic pressure.
const DIASTOLE: f64 = 0.2;

/// Drift of one pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Slope of the line through the diastolic pressures \[mmHg/min\].
    pub mmhg_per_min: f64,
    /// Standard error of the slope \[mmHg/min\].
    pub standard_error_mmhg_per_min: f64,
    /// Whether the drift was removed.
    pub removed: bool,
    /// Time after the recording's beginning at which the pressure stays unchanged \[ms\].
    pub reference_ms: f64,
}

/// Drift of the diastolic pressures of some beats: the median slope between all pairs of beats
/// (Theil 1950, Sen 1968), which is robust against outliers. `None` with too few beats.
#[must_use]
pub fn of(
    recording: &Recording,
    pressure_mmhg: &[f64],
    beats: &[Beat],
    settings: DriftStep,
) -> Option<Drift> {
    if beats.len() < FEWEST_BEATS {
        return None;
    }
    let every = beats.len().div_ceil(MOST_BEATS);
    let points: Vec<(f64, f64)> = beats
        .iter()
        .step_by(every)
        .filter_map(|beat| {
            let elapsed_ms = recording.elapsed_ms(beat.onset_ms);
            Some((elapsed_ms, diastolic(recording, pressure_mmhg, beat)?))
        })
        .collect();
    let points = if recording.duration_ms() < BREATHS_MS {
        without_breath(points)
    } else {
        points
    };
    let mut slopes = Vec::with_capacity(points.len() * points.len() / 2);
    for (i, a) in points.iter().enumerate() {
        slopes.extend(points[i + 1..].iter().map(|b| (b.1 - a.1) / (b.0 - a.0)));
    }
    let slope = median(slopes.into_iter());
    let level = median(points.iter().map(|p| p.1 - slope * p.0));
    let residuals: Vec<f64> = points.iter().map(|p| p.1 - level - slope * p.0).collect();
    let (_, sd) = centre_and_spread(&residuals);
    let n = points.len() as f64;
    let mean = points.iter().map(|p| p.0).sum::<f64>() / n;
    let width = points
        .iter()
        .map(|p| (p.0 - mean).powi(2))
        .sum::<f64>()
        .sqrt();
    // Neighbouring beats share a phase of breathing, so that only every second one counts as
    // independent.
    let error = sd / width * 2.0_f64.sqrt();
    let over_all = (slope * recording.duration_ms()).abs();
    let seen = over_all >= LEAST_MMHG && slope.abs() > LEAST_ERRORS * error;
    let reference_ms = match settings.zero_at {
        ZeroAt::Begin => 0.0,
        ZeroAt::Middle => 0.5 * recording.duration_ms(),
        ZeroAt::End => recording.duration_ms(),
    };
    Some(Drift {
        mmhg_per_min: slope * 60_000.0,
        standard_error_mmhg_per_min: error * 60_000.0,
        removed: settings.enabled && seen,
        reference_ms,
    })
}

/// Removes the breathing wave that explains most of the sum of squares, if it explains enough. In a
/// recording of a minute, breathing would change the slope of the line.
fn without_breath(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let n = points.len() as f64;
    let (begin, end) = (points[0].0, points[points.len() - 1].0);
    let middle = 0.5 * (begin + end);
    let width = (end - begin).max(1.0);
    // Frequency step that misses no wave within the recording.
    let step = 0.25 / width;
    let n_steps = ((1.0 / BREATH_MS.0 - 1.0 / BREATH_MS.1) / step) as usize + 1;
    let squares_of = |coefficients: &[f64; 4], w: f64| -> f64 {
        points
            .iter()
            .map(|(t, y)| (y - value(coefficients, w, (t - middle) / width, t - middle)).powi(2))
            .sum()
    };
    let line = fit(&points, None, middle, width);
    let before = line.map_or(f64::INFINITY, |c| squares_of(&c, 0.0));
    let best = (0..n_steps)
        .filter_map(|k| {
            let w = (1.0 / BREATH_MS.1 + k as f64 * step) * std::f64::consts::TAU;
            let coefficients = fit(&points, Some(w), middle, width)?;
            Some((squares_of(&coefficients, w), w, coefficients))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((squares, w, [_, _, c, s])) if n > 15.0 && squares < (1.0 - BREATH_SHARE) * before => {
            points
                .iter()
                .map(|(t, y)| {
                    (
                        *t,
                        y - c * (w * (t - middle)).cos() - s * (w * (t - middle)).sin(),
                    )
                })
                .collect()
        }
        _ => points,
    }
}

fn value([level, slope, c, s]: &[f64; 4], w: f64, x: f64, t: f64) -> f64 {
    level
        + slope * x
        + if w > 0.0 {
            c * (w * t).cos() + s * (w * t).sin()
        } else {
            0.0
        }
}

/// Least-squares fit of level, slope, and a wave's cosine and sine.
fn fit(points: &[(f64, f64)], wave: Option<f64>, middle: f64, width: f64) -> Option<[f64; 4]> {
    let n = if wave.is_some() { 4 } else { 2 };
    let mut a = vec![vec![0.0; n + 1]; n];
    for (t, y) in points {
        let phase = wave.unwrap_or(0.0) * (t - middle);
        let row = [1.0, (t - middle) / width, phase.cos(), phase.sin()];
        for i in 0..n {
            for j in 0..n {
                a[i][j] += row[i] * row[j];
            }
            a[i][n] += row[i] * y;
        }
    }
    let x = crate::filter::solve(a)?;
    let mut coefficients = [0.0; 4];
    coefficients[..n].copy_from_slice(&x);
    Some(coefficients)
}

impl Drift {
    /// Change of the pressure by the drift at a time on the file's clock after the recording's beginning
    /// ([`Recording::elapsed_ms`]) \[mmHg\]; zero if the drift was not removed.
    #[must_use]
    pub fn at(&self, elapsed_ms: f64) -> f64 {
        if self.removed {
            self.mmhg_per_min / 60_000.0 * (elapsed_ms - self.reference_ms)
        } else {
            0.0
        }
    }
}

fn diastolic(recording: &Recording, pressure: &[f64], beat: &Beat) -> Option<f64> {
    let first = recording.position(beat.onset_ms) as usize;
    let last = (recording.position(beat.onset_ms + beat.length_ms) as usize).min(pressure.len());
    let mut values: Vec<f64> = pressure
        .get(first..last)?
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .collect();
    if values.len() < 10 {
        return None;
    }
    let place = (DIASTOLE * values.len() as f64) as usize;
    Some(*values.select_nth_unstable_by(place, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Channels;

    fn made(slope_per_min: f64) -> (Recording, Vec<Beat>) {
        let n = 60_000;
        let pressure = (0..n)
            .map(|i| {
                let t = f64::from(i);
                let breath = 2.0 * (t / 4000.0 * std::f64::consts::TAU).sin();
                60.0 + 50.0 * (t / 800.0 * std::f64::consts::TAU).sin()
                    + breath
                    + slope_per_min * t / 60_000.0
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
        let beats = (0..74)
            .map(|i| Beat {
                onset_ms: 800.0 * f64::from(i),
                length_ms: 800.0,
            })
            .collect();
        (recording, beats)
    }

    #[test]
    fn a_drift_is_found_through_breathing_and_none_is_not_invented() {
        let (recording, beats) = made(6.0);
        let drift = of(
            &recording,
            recording.leading_pressure(),
            &beats,
            DriftStep::default(),
        )
        .unwrap();
        assert!(
            (drift.mmhg_per_min - 6.0).abs() < 0.6 && drift.removed,
            "{drift:?}"
        );
        assert_eq!(drift.at(0.0), 0.0);
        let (recording, beats) = made(0.0);
        let drift = of(
            &recording,
            recording.leading_pressure(),
            &beats,
            DriftStep::default(),
        )
        .unwrap();
        assert!(!drift.removed && drift.at(50_000.0) == 0.0, "{drift:?}");
    }
}
