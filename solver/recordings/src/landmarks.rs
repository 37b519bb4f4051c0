//! Times of pressure rise and fall in each beat: the shifts for which the rise and fall of the mean
//! fit best.

use crate::filter::{median, vertex};
use crate::recording::{Recording, at};

/// Half width of the interval that is compared \[ms\].
pub(crate) const HALF_WIDTH_MS: f64 = 40.0;
/// Largest shift in the search \[ms\].
const REACH_MS: f64 = 40.0;

/// Share of the interval that must have samples. At the recording's begin and end, a part of a rise
/// still shows where it is.
const WHOLE: f64 = 0.5;
/// Largest number of beats from which the typical course around a landmark is computed.
const MOST_BEATS: usize = 301;

/// Moves times to the best fit of the typical course around them. Times without a best fit stay
/// unchanged.
pub(crate) fn refine(
    recording: &Recording,
    values: &[f64],
    times_ms: &[f64],
    half_width_ms: f64,
) -> Vec<f64> {
    let (usual, before_ms) = usual_course(recording, values, times_ms, half_width_ms + REACH_MS);
    let mean = Mean {
        values: &usual,
        step_ms: recording.step_ms,
        half_width_ms,
    };
    let place = |t: f64| mean.locate(recording, values, t - before_ms, before_ms);
    let moved: Vec<f64> = times_ms
        .iter()
        .map(|t| place(*t).map_or(*t, |at| t - before_ms + at))
        .collect();
    // If two times move to the same place or past each other, at least one of them is wrong.
    if moved.windows(2).all(|w| w[1] - w[0] > HALF_WIDTH_MS) {
        moved
    } else {
        times_ms.to_vec()
    }
}

/// Median course within `reach_ms` of some times, and the time of its centre after its first sample
/// \[ms\].
pub(crate) fn usual_course(
    recording: &Recording,
    values: &[f64],
    times_ms: &[f64],
    reach_ms: f64,
) -> (Vec<f64>, f64) {
    let step = recording.step_ms;
    let reach = (reach_ms / step).round().max(8.0) as usize;
    let every = times_ms.len().div_ceil(MOST_BEATS).max(1);
    let usual = (0..=2 * reach)
        .map(|k| {
            let offset = k as f64 - reach as f64;
            median(
                times_ms
                    .iter()
                    .step_by(every)
                    .map(|t| at(values, t / step + offset)),
            )
        })
        .collect();
    (usual, reach as f64 * step)
}

/// A mean course with which beats are aligned.
pub(crate) struct Mean<'a> {
    /// Values over one cycle, or around a landmark.
    pub(crate) values: &'a [f64],
    pub(crate) step_ms: f64,
    /// Half width of the interval that is compared \[ms\].
    pub(crate) half_width_ms: f64,
}

impl Mean<'_> {
    /// Time of the mean's landmark in a beat, from the beginning of the beat \[ms\]; `None` if no
    /// shift within reach is a best fit.
    pub(crate) fn locate(
        &self,
        recording: &Recording,
        pressure: &[f64],
        onset_ms: f64,
        landmark_ms: f64,
    ) -> Option<f64> {
        let (mean, step_ms) = (self.values, self.step_ms);
        let half = (self.half_width_ms / step_ms).round().max(4.0) as isize;
        let reach = (REACH_MS / step_ms).round().max(2.0) as isize;
        let middle = (landmark_ms / step_ms).round() as isize;
        let n = mean.len() as isize;
        let template: Vec<f64> = (middle - half..=middle + half)
            .map(|k| mean[k.rem_euclid(n) as usize])
            .collect();
        let width = template.len();
        let first = middle - half - reach;
        let beat: Vec<f64> = (0..width as isize + 2 * reach)
            .map(|k| {
                at(
                    pressure,
                    recording.position(onset_ms + (first + k) as f64 * step_ms),
                )
            })
            .collect();
        // The level is free, because only the position of the rise matters, not its height.
        let fewest = (WHOLE * width as f64) as usize;
        let misfit: Vec<f64> = beat
            .windows(width)
            .map(|here| {
                let (mut sum, mut squares, mut n) = (0.0, 0.0, 0_usize);
                for (a, b) in here.iter().zip(&template) {
                    let d = a - b;
                    if d.is_finite() {
                        sum += d;
                        squares += d * d;
                        n += 1;
                    }
                }
                if n < fewest {
                    return f64::NAN;
                }
                (squares - sum * sum / n as f64) / n as f64
            })
            .collect();
        let best = (0..misfit.len())
            .filter(|k| misfit[*k].is_finite())
            .min_by(|a, b| misfit[*a].total_cmp(&misfit[*b]))?;
        if best == 0 || best + 1 == misfit.len() {
            return None;
        }
        let shift =
            best as f64 - reach as f64 + vertex(misfit[best - 1], misfit[best], misfit[best + 1]);
        Some(landmark_ms + shift * step_ms)
    }
}
