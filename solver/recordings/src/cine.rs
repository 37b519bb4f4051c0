//! Volumes of a cine series, as frames over one cycle.

use crate::filter::median;

/// Smallest number of frames in a cycle.
const FEWEST: usize = 8;
/// Distance from the end of the cycle, in typical steps, within which a frame counts as a
/// repetition of the first one.
const CLOSING: f64 = 0.25;
/// Share of the harmonics below which the volume itself lies; above it, there is only noise.
const NOISE_BAND: f64 = 0.66;
/// Number of frames on either side through which a local line is fitted.
const LINE_FRAMES: f64 = 1.6;

/// Frames of one cycle in temporal order.
#[derive(Debug, Clone, PartialEq)]
pub struct Cine {
    /// Times after the trigger \[ms\].
    pub time_ms: Vec<f64>,
    /// Cavity volume of each frame \[mL\].
    pub volume_ml: Vec<f64>,
    /// Length of the cycle over which the frames were gated \[ms\].
    pub cycle_length_ms: f64,
}

/// Reasons why frames do not form a cycle.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CineError {
    /// There are too few frames.
    #[error("{n_frames} frames, but a cycle needs at least {FEWEST}")]
    TooFew {
        /// Number of frames that were given.
        n_frames: usize,
    },
    /// Frames lie beyond the end of the cycle.
    #[error("frames from {first_ms} to {last_ms} ms, but the cycle lasts {cycle_length_ms} ms")]
    Beyond {
        /// Time of the first frame \[ms\].
        first_ms: f64,
        /// Time of the last frame \[ms\].
        last_ms: f64,
        /// Length of the cycle \[ms\].
        cycle_length_ms: f64,
    },
    /// A volume is missing, zero or negative.
    #[error("a volume of {volume_ml} mL at {time_ms} ms")]
    Volume {
        /// Time of the frame \[ms\].
        time_ms: f64,
        /// Volume of the frame \[mL\].
        volume_ml: f64,
    },
}

fn typical_step(time_ms: &[f64]) -> f64 {
    median(time_ms.windows(2).map(|w| w[1] - w[0]))
}

/// Length of the cycle of frames at increasing times \[ms\], which ends one typical step after the last
/// frame; NaN for fewer than two.
#[must_use]
pub fn cycle_of(time_ms: &[f64]) -> f64 {
    match time_ms {
        [first, .., last] => last - first + typical_step(time_ms),
        _ => f64::NAN,
    }
}

impl Cine {
    /// A series from frames at increasing times. Without a cycle length, the cycle ends one typical
    /// step after the last frame.
    ///
    /// # Errors
    /// [`CineError`] for too few frames, frames beyond the cycle, or invalid volumes.
    pub fn new(
        time_ms: Vec<f64>,
        volume_ml: Vec<f64>,
        cycle_length_ms: Option<f64>,
    ) -> Result<Self, CineError> {
        let n = time_ms.len().min(volume_ml.len());
        if n < FEWEST {
            return Err(CineError::TooFew { n_frames: n });
        }
        let bad = time_ms
            .iter()
            .zip(&volume_ml)
            .find(|(_, v)| !(v.is_finite() && **v > 0.0));
        if let Some((time_ms, volume_ml)) = bad {
            return Err(CineError::Volume {
                time_ms: *time_ms,
                volume_ml: *volume_ml,
            });
        }
        let step = typical_step(&time_ms);
        let (first_ms, last_ms) = (time_ms[0], time_ms[n - 1]);
        let cycle = cycle_length_ms.unwrap_or_else(|| cycle_of(&time_ms[..n]));
        if last_ms - first_ms > cycle + 0.5 * step || cycle <= 0.0 || cycle.is_nan() {
            return Err(CineError::Beyond {
                first_ms,
                last_ms,
                cycle_length_ms: cycle,
            });
        }
        let kept = time_ms.partition_point(|t| t - first_ms < cycle - CLOSING * step);
        let (mut time_ms, mut volume_ml) = (time_ms, volume_ml);
        time_ms.truncate(kept);
        volume_ml.truncate(kept);
        Ok(Self {
            time_ms,
            volume_ml,
            cycle_length_ms: cycle,
        })
    }

    /// Typical distance between frames \[ms\].
    #[must_use]
    pub fn step_ms(&self) -> f64 {
        typical_step(&self.time_ms)
    }

    /// Volume at a time, from a line through the frames around it, because the noise of a single
    /// frame would affect all others.
    #[must_use]
    pub fn near(&self, time_ms: f64) -> f64 {
        let half = LINE_FRAMES * self.step_ms();
        let cycle = self.cycle_length_ms;
        let close: Vec<(f64, f64)> = self
            .time_ms
            .iter()
            .zip(&self.volume_ml)
            .map(|(t, v)| {
                (
                    (t - time_ms + 0.5 * cycle).rem_euclid(cycle) - 0.5 * cycle,
                    *v,
                )
            })
            .filter(|(d, _)| d.abs() <= half)
            .collect();
        let n = close.len() as f64;
        if n < 2.0 {
            return self.at(time_ms);
        }
        let (mt, mv) = (
            close.iter().map(|p| p.0).sum::<f64>() / n,
            close.iter().map(|p| p.1).sum::<f64>() / n,
        );
        let cross: f64 = close.iter().map(|p| (p.0 - mt) * (p.1 - mv)).sum();
        let square: f64 = close.iter().map(|p| (p.0 - mt).powi(2)).sum();
        if square > 0.0 {
            mv - mt * cross / square
        } else {
            mv
        }
    }

    /// Volume at a time, linearly interpolated between frames.
    #[must_use]
    pub fn at(&self, time_ms: f64) -> f64 {
        let n = self.time_ms.len();
        let first = self.time_ms[0];
        let t = first + (time_ms - first).rem_euclid(self.cycle_length_ms);
        let i = self.time_ms.partition_point(|k| *k <= t).clamp(1, n) - 1;
        let end = if i + 1 < n {
            self.time_ms[i + 1]
        } else {
            first + self.cycle_length_ms
        };
        let share = (t - self.time_ms[i]) / (end - self.time_ms[i]);
        self.volume_ml[i] + share * (self.volume_ml[(i + 1) % n] - self.volume_ml[i])
    }

    /// Noise of a frame \[mL\], estimated from the upper harmonics, which contain almost nothing of
    /// the volume itself. Where frames are left out, their place is filled between its neighbours:
    /// without that, the gap itself would be seen as noise.
    #[must_use]
    pub fn noise_rms_ml(&self) -> f64 {
        let step = self.step_ms();
        let even = self.time_ms.windows(2).all(|w| w[1] - w[0] < 1.5 * step);
        let filled: Vec<f64>;
        let v = if even {
            &self.volume_ml
        } else {
            let n = (self.cycle_length_ms / step).round().max(FEWEST as f64);
            let every = self.cycle_length_ms / n;
            filled = (0..n as usize)
                .map(|k| self.at(self.time_ms[0] + k as f64 * every))
                .collect();
            &filled
        };
        let n = v.len();
        let top = (n - 1) / 2;
        let first = (NOISE_BAND * top as f64).ceil() as usize;
        let power = |k: usize| -> f64 {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, value) in v.iter().enumerate() {
                let (s, c) = (std::f64::consts::TAU * (k * i % n) as f64 / n as f64).sin_cos();
                re += value * c;
                im += value * s;
            }
            (re * re + im * im) / n as f64
        };
        let harmonics = first..=top;
        let count = harmonics.clone().count().max(1) as f64;
        (harmonics.map(power).sum::<f64>() / count).sqrt()
    }

    /// Difference between the largest and smallest volume \[mL\].
    #[must_use]
    pub fn stroke_volume_ml(&self) -> f64 {
        let (low, high) = self
            .volume_ml
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(*v), h.max(*v))
            });
        high - low
    }

    /// The frames at other times, sorted, within another cycle.
    #[must_use]
    pub fn moved(&self, cycle_length_ms: f64, time: impl Fn(f64) -> f64) -> Self {
        let mut frames: Vec<(f64, f64)> = self
            .time_ms
            .iter()
            .zip(&self.volume_ml)
            .map(|(t, v)| {
                let t = time(*t).rem_euclid(cycle_length_ms);
                // Rounding may give the end of the cycle itself.
                (if t >= cycle_length_ms - 1e-9 { 0.0 } else { t }, *v)
            })
            .collect();
        frames.sort_by(|a, b| a.0.total_cmp(&b.0));
        frames.dedup_by(|b, a| b.0 - a.0 < 1e-6);
        let (time_ms, volume_ml) = frames.into_iter().unzip();
        Self {
            time_ms,
            volume_ml,
            cycle_length_ms,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_validation::random::Random;

    fn made(n: usize, noise: f64, seed: u64) -> Cine {
        let mut random = Random::new(seed, 1);
        let time: Vec<f64> = (0..n).map(|i| i as f64 * 900.0 / n as f64).collect();
        let volume = time
            .iter()
            .map(|t| {
                110.0 + 35.0 * (t / 900.0 * std::f64::consts::TAU).cos() + noise * random.normal()
            })
            .collect();
        Cine::new(time, volume, Some(900.0)).unwrap()
    }

    #[test]
    fn noise_of_frames_is_seen_beside_their_course() {
        assert!(made(30, 0.0, 0).noise_rms_ml() < 0.3);
        let seen: Vec<f64> = (0..20)
            .map(|seed| made(30, 2.5, seed).noise_rms_ml())
            .collect();
        assert!((median(seen.into_iter()) / 2.5 - 1.0).abs() < 0.2);
    }

    #[test]
    fn the_closing_frame_is_the_first_one() {
        let time: Vec<f64> = (0..=20).map(|i| f64::from(i) * 40.0).collect();
        let cine = Cine::new(time.clone(), vec![100.0; 21], Some(800.0)).unwrap();
        assert_eq!(cine.time_ms.len(), 20);
        assert!(matches!(
            Cine::new(time.clone(), vec![100.0; 21], Some(700.0)),
            Err(CineError::Beyond { .. })
        ));
        assert!(matches!(
            Cine::new(time, vec![0.0; 21], None),
            Err(CineError::Volume { .. })
        ));
    }

    #[test]
    fn moved_frames_stay_in_the_cycle_and_in_order() {
        let moved = made(24, 0.0, 0).moved(800.0, |t| t * 800.0 / 900.0 - 50.0);
        assert_eq!(moved.time_ms.len(), 24);
        assert!(moved.time_ms.windows(2).all(|w| w[1] > w[0]) && moved.time_ms[23] < 800.0);
        assert!((moved.at(750.0) - made(24, 0.0, 0).at(0.0)).abs() < 1e-6);
    }
}
