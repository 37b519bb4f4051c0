//! A trace seen as a cycle: neighbours, crossings of a level and central differences, wrapped or not.

use cardiotwin_units::Ms;
use serde::{Deserialize, Serialize};

/// What comes after a trace's last sample and before its first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Continuation {
    /// The trace repeats after the cycle length: measured traces, and simulations of several beats.
    Periodic {
        /// Cycle length in ms.
        cycle_length_ms: Ms,
    },
    /// One simulated beat: nothing is known beyond its ends, and it is never wrapped around.
    Single,
}

impl Continuation {
    /// A measured trace of this cycle length, or a simulation that was run to periodicity.
    #[must_use]
    pub fn periodic(cycle_length: Ms) -> Self {
        Self::Periodic { cycle_length_ms: cycle_length }
    }

    /// The cycle length in ms of a periodic trace.
    #[must_use]
    pub fn cycle_length_ms(self) -> Option<f64> {
        match self {
            Self::Periodic { cycle_length_ms } => Some(cycle_length_ms.0),
            Self::Single => None,
        }
    }
}

/// Samples with indices that run beyond both ends when the trace is periodic.
#[derive(Clone, Copy)]
pub(crate) struct Cycle<'a> {
    time_ms: &'a [f64],
    values: &'a [f64],
    period_ms: Option<f64>,
}

impl<'a> Cycle<'a> {
    /// A view of equally long, non-empty slices; a periodic trace's closing sample (one period after the first) is
    /// left out, because it is the first one again.
    pub(crate) fn new(time_ms: &'a [f64], values: &'a [f64], continuation: Continuation) -> Self {
        debug_assert!(!time_ms.is_empty() && time_ms.len() == values.len());
        let period_ms = continuation.cycle_length_ms();
        let mut n = time_ms.len();
        if let Some(period) = period_ms {
            while n > 1 && time_ms[n - 1] - time_ms[0] > period * (1.0 - 1e-9) {
                n -= 1;
            }
        }
        Self { time_ms: &time_ms[..n], values: &values[..n], period_ms }
    }

    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    pub(crate) fn values(&self) -> &'a [f64] {
        self.values
    }

    pub(crate) fn is_periodic(&self) -> bool {
        self.period_ms.is_some()
    }

    /// First index that may be asked for when going back from `i`: one whole cycle, or the first sample.
    pub(crate) fn lowest(&self, i: isize) -> isize {
        if self.is_periodic() { i - self.len() as isize } else { 0 }
    }

    /// Last index that may be asked for when going on from `i`: one whole cycle, or the last sample.
    pub(crate) fn highest(&self, i: isize) -> isize {
        if self.is_periodic() { i + self.len() as isize } else { self.len() as isize - 1 }
    }

    pub(crate) fn value(&self, i: isize) -> f64 {
        self.values[i.rem_euclid(self.len() as isize) as usize]
    }

    pub(crate) fn time(&self, i: isize) -> f64 {
        let n = self.len() as isize;
        self.time_ms[i.rem_euclid(n) as usize] + i.div_euclid(n) as f64 * self.period_ms.unwrap_or(0.0)
    }

    /// Central difference at sample `i`, in value per ms; none at the ends of a single beat.
    pub(crate) fn slope(&self, i: isize) -> Option<f64> {
        if !self.is_periodic() && (i < 1 || i + 1 >= self.len() as isize) || self.len() < 3 {
            return None;
        }
        Some((self.value(i + 1) - self.value(i - 1)) / (self.time(i + 1) - self.time(i - 1)))
    }

    /// Index of the largest value, the first one if there are several.
    pub(crate) fn argmax(&self) -> isize {
        let mut best = 0;
        for (i, v) in self.values.iter().enumerate() {
            if *v > self.values[best] {
                best = i;
            }
        }
        best as isize
    }

    /// Index of the smallest value, the first one if there are several.
    pub(crate) fn argmin(&self) -> isize {
        let mut best = 0;
        for (i, v) in self.values.iter().enumerate() {
            if *v < self.values[best] {
                best = i;
            }
        }
        best as isize
    }

    /// Time of the last crossing of `level` from below at or before sample `before`, by linear interpolation.
    pub(crate) fn last_rise(&self, level: f64, before: isize) -> Option<f64> {
        let lowest = self.lowest(before);
        let mut i = before;
        while i > lowest {
            if self.value(i - 1) < level && self.value(i) >= level {
                return Some(self.interpolate(i - 1, level));
            }
            i -= 1;
        }
        None
    }

    /// Time of the first crossing of `level` from above at or after sample `after`, by linear interpolation,
    /// together with the first sample at or below it.
    pub(crate) fn first_fall(&self, level: f64, after: isize) -> Option<(f64, isize)> {
        let highest = self.highest(after);
        let mut i = after;
        while i < highest {
            if self.value(i) > level && self.value(i + 1) <= level {
                return Some((self.interpolate(i, level), i + 1));
            }
            i += 1;
        }
        None
    }

    /// Time of the first crossing of `level` from below at or after sample `after`, by linear interpolation,
    /// together with the first sample at or above it.
    pub(crate) fn first_rise(&self, level: f64, after: isize) -> Option<(f64, isize)> {
        let highest = self.highest(after);
        let mut i = after;
        while i < highest {
            if self.value(i) < level && self.value(i + 1) >= level {
                return Some((self.interpolate(i, level), i + 1));
            }
            i += 1;
        }
        None
    }

    fn interpolate(&self, i: isize, level: f64) -> f64 {
        let (t0, t1) = (self.time(i), self.time(i + 1));
        let (v0, v1) = (self.value(i), self.value(i + 1));
        t0 + (t1 - t0) * (level - v0) / (v1 - v0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_beat_ends_and_a_periodic_one_goes_on() {
        let (t, v) = ([0.0, 1.0, 2.0, 3.0], [2.0, 3.0, 1.5, 1.4]);
        let single = Cycle::new(&t, &v, Continuation::Single);
        assert_eq!(single.last_rise(1.8, 1), None);
        assert_eq!(single.slope(0), None);
        let periodic = Cycle::new(&t, &v, Continuation::periodic(Ms(4.0)));
        // Between the last sample (3, 1.4) of the beat before and the first (4, 2.0) of this one, one period earlier.
        assert!((periodic.last_rise(1.8, 1).unwrap() - (-1.0 + 0.4 / 0.6)).abs() < 1e-12);
        assert!((periodic.slope(0).unwrap() - (3.0 - 1.4) / 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_closing_sample_of_a_periodic_trace_counts_once() {
        let (t, v) = ([0.0, 1.0, 2.0], [1.0, 5.0, 1.0]);
        assert_eq!(Cycle::new(&t, &v, Continuation::periodic(Ms(2.0))).len(), 2);
        assert_eq!(Cycle::new(&t, &v, Continuation::Single).len(), 3);
    }
}
