//! A trace seen as a cycle: neighbours, crossings of a level and central differences, wrapped or not.

use cardiotwin_units::Ms;
use serde::{Deserialize, Serialize};

/// Continuation of a trace after its last sample and before its first.
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
        Self::Periodic {
            cycle_length_ms: cycle_length,
        }
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

/// Direction of a search in time.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// To earlier times.
    Back,
    /// To later times.
    On,
}

/// On which side of a level a limb lies.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// Larger than the level.
    Above,
    /// Smaller than the level.
    Below,
}

/// Point at which a limb leaves a level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crossing {
    /// Time of the crossing \[ms\]; it may lie beyond the ends of a single beat.
    pub(crate) time_ms: f64,
    /// Whether the trace itself crosses there, not the limb's extension.
    pub(crate) on_trace: bool,
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
        Self {
            time_ms: &time_ms[..n],
            values: &values[..n],
            period_ms,
        }
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
        if self.is_periodic() {
            i - self.len() as isize
        } else {
            0
        }
    }

    /// Last index that may be asked for when going on from `i`: one whole cycle, or the last sample.
    pub(crate) fn highest(&self, i: isize) -> isize {
        if self.is_periodic() {
            i + self.len() as isize
        } else {
            self.len() as isize - 1
        }
    }

    pub(crate) fn value(&self, i: isize) -> f64 {
        self.values[i.rem_euclid(self.len() as isize) as usize]
    }

    pub(crate) fn time(&self, i: isize) -> f64 {
        let n = self.len() as isize;
        self.time_ms[i.rem_euclid(n) as usize]
            + i.div_euclid(n) as f64 * self.period_ms.unwrap_or(0.0)
    }

    /// Central difference at sample `i`, in value per ms; none at the ends of a single beat.
    pub(crate) fn slope(&self, i: isize) -> Option<f64> {
        if !self.is_periodic() && (i < 1 || i + 1 >= self.len() as isize) || self.len() < 3 {
            return None;
        }
        Some((self.value(i + 1) - self.value(i - 1)) / (self.time(i + 1) - self.time(i - 1)))
    }

    /// Slope of the least-squares line through the samples up to `reach` away from sample `i`, in value per ms; none where
    /// the window leaves a single beat. Samples are equally far apart. A reach of 1 is the central difference.
    pub(crate) fn slope_over(&self, i: isize, reach: isize) -> Option<f64> {
        if reach <= 1 {
            return self.slope(i);
        }
        let n = self.len() as isize;
        if n < 2 * reach + 1 || !self.is_periodic() && (i < reach || i + reach >= n) {
            return None;
        }
        let step_ms = (self.time(i + reach) - self.time(i - reach)) / (2 * reach) as f64;
        let (over, under) = (1..=reach).fold((0.0, 0.0), |(over, under), k| {
            (
                over + k as f64 * (self.value(i + k) - self.value(i - k)),
                under + 2.0 * (k * k) as f64,
            )
        });
        Some(over / (under * step_ms))
    }

    /// Value at sample `i` of the least-squares parabola through samples up to `reach` away, of which seventeen count; of a
    /// single beat, those that it has. Samples are equally far apart.
    pub(crate) fn parabola_at(&self, i: isize, reach: isize) -> f64 {
        let stride = (reach / 8).max(1);
        let inside = |k: &isize| self.is_periodic() || (0..self.len() as isize).contains(&(i + k));
        let (mut moments, mut sums) = ([0.0; 5], [0.0; 3]);
        for k in (-(reach / stride)..=reach / stride)
            .map(|k| k * stride)
            .filter(inside)
        {
            let (x, value) = (k as f64 / reach as f64, self.value(i + k));
            for (power, moment) in moments.iter_mut().enumerate() {
                *moment += x.powi(power as i32);
            }
            for (power, sum) in sums.iter_mut().enumerate() {
                *sum += value * x.powi(power as i32);
            }
        }
        let [m0, m1, m2, m3, m4] = moments;
        // The first row of the normal matrix's inverse, by cofactors.
        let cofactors = [m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2];
        let determinant = m0 * cofactors[0] + m1 * cofactors[1] + m2 * cofactors[2];
        if determinant.abs() < 1e-9 {
            return self.value(i);
        }
        cofactors
            .iter()
            .zip(sums)
            .map(|(cofactor, sum)| cofactor * sum)
            .sum::<f64>()
            / determinant
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

    /// Where the limb that holds sample `anchor` leaves the level, going back or on from there, continuous in the trace.
    ///
    /// The literal crossing jumps where the trace only touches the level: a foot that lies a hair above it sends the
    /// search on to the beat's end. So the limb is taken to be at least as steep as `rate`: with the height
    /// h(s) = ±(value − level), positive at the anchor, the crossing going back is
    /// `max {t : h(s) ≤ rate · (s − t) for some s from t to the anchor}`. A limb steeper than `rate` gives the literal
    /// crossing, bit for bit; otherwise its foot is extended with `rate`. The right-hand side grows with slope `rate`, so
    /// values and level moved by ε and δ move the crossing by at most (ε + δ)/`rate`.
    /// - `rate`: value per ms, positive
    ///
    /// None where the anchor is not above the level (below it on [`Side::Below`]).
    pub(crate) fn leaves(
        &self,
        anchor: isize,
        way: Way,
        side: Side,
        level: f64,
        rate: f64,
    ) -> Option<Crossing> {
        let (step, last) = match way {
            Way::Back => (-1, self.lowest(anchor)),
            Way::On => (1, self.highest(anchor)),
        };
        let height = |i: isize| match side {
            Side::Above => self.value(i) - level,
            Side::Below => level - self.value(i),
        };
        if height(anchor) <= 0.0 {
            return None;
        }
        let forward = |t: f64| step as f64 * t;
        let mut nearest = Crossing {
            time_ms: forward(f64::INFINITY),
            on_trace: false,
        };
        let mut i = anchor;
        loop {
            let h = height(i);
            let found = if h <= 0.0 {
                Crossing {
                    time_ms: self.interpolate(i.min(i - step), level),
                    on_trace: true,
                }
            } else {
                Crossing {
                    time_ms: self.time(i) + forward(h / rate),
                    on_trace: false,
                }
            };
            // At a tie the trace itself meets the level.
            if forward(found.time_ms) <= forward(nearest.time_ms) {
                nearest = found;
            }
            if h <= 0.0 || i == last || forward(self.time(i)) >= forward(nearest.time_ms) {
                return Some(nearest);
            }
            i += step;
        }
    }

    /// The last sample that lies on a side of a level, going back or on from `start`; `start` itself at the least. The end
    /// of the search is one cycle away, or the beat's end.
    pub(crate) fn last_on_limb(&self, start: isize, way: Way, side: Side, level: f64) -> isize {
        let (step, last) = match way {
            Way::Back => (-1, self.lowest(start)),
            Way::On => (1, self.highest(start)),
        };
        let mut i = start;
        while i != last {
            let next = self.value(i + step);
            if (side == Side::Above && next <= level) || (side == Side::Below && next >= level) {
                break;
            }
            i += step;
        }
        i
    }

    /// A time cut to a single beat; any time of a periodic trace.
    pub(crate) fn within(&self, time_ms: f64) -> f64 {
        if self.is_periodic() {
            time_ms
        } else {
            time_ms.clamp(self.time(0), self.time(self.len() as isize - 1))
        }
    }

    /// Indices of the samples strictly between two times.
    pub(crate) fn inside(
        &self,
        begin_ms: f64,
        end_ms: f64,
    ) -> impl Iterator<Item = isize> + use<'a> {
        let this = *self;
        let first = this.len() as isize
            * this
                .period_ms
                .map_or(0, |p| ((begin_ms - this.time_ms[0]) / p).floor() as isize);
        let last = if this.is_periodic() {
            isize::MAX
        } else {
            this.len() as isize
        };
        (first..last)
            .skip_while(move |i| this.time(*i) <= begin_ms)
            .take_while(move |i| this.time(*i) < end_ms)
    }

    /// Index of the sample next to a time; of a single beat, one that it has.
    pub(crate) fn nearest(&self, time_ms: f64) -> isize {
        let reach = 0.5 * self.usual_step();
        let index = self.inside(time_ms - reach, f64::INFINITY).next();
        let last = self.len() as isize - 1;
        index.unwrap_or(last)
    }

    /// Mean time between samples, ms.
    pub(crate) fn usual_step(&self) -> f64 {
        (self.time_ms[self.len() - 1] - self.time_ms[0]) / (self.len() as f64 - 1.0).max(1.0)
    }

    /// Value at a time by linear interpolation; a single beat's first or last value beyond its ends.
    pub(crate) fn at(&self, time_ms: f64) -> f64 {
        let n = self.len() as isize;
        let cycles = self
            .period_ms
            .map_or(0.0, |period| ((time_ms - self.time_ms[0]) / period).floor());
        let within = time_ms - cycles * self.period_ms.unwrap_or(0.0);
        let i = self.time_ms.partition_point(|t| *t <= within) as isize - 1;
        if !self.is_periodic() && (i < 0 || i + 1 >= n) {
            return self.value(i.clamp(0, n - 1));
        }
        let (t0, t1) = (self.time(i), self.time(i + 1));
        self.value(i) + (self.value(i + 1) - self.value(i)) * (within - t0) / (t1 - t0)
    }

    /// Time of the last crossing of `level` from below at or before sample `before`, by linear interpolation.
    pub(crate) fn last_rise(&self, level: f64, before: isize) -> Option<f64> {
        let lowest = self.lowest(before);
        let crosses = |i: &isize| self.value(i - 1) < level && self.value(*i) >= level;
        (lowest + 1..=before)
            .rev()
            .find(crosses)
            .map(|i| self.interpolate(i - 1, level))
    }

    /// Time of the first crossing of `level` from above at or after sample `after`, by linear interpolation.
    pub(crate) fn first_fall(&self, level: f64, after: isize) -> Option<f64> {
        let highest = self.highest(after);
        let crosses = |i: &isize| self.value(*i) > level && self.value(i + 1) <= level;
        (after..highest)
            .find(crosses)
            .map(|i| self.interpolate(i, level))
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
        let back = |c: &Cycle| c.leaves(1, Way::Back, Side::Above, 1.8, 0.5).unwrap();
        let single = Cycle::new(&t, &v, Continuation::Single);
        // From (0, 2.0) down to 1.8 at a rate of 0.5.
        assert_eq!(
            back(&single),
            Crossing {
                time_ms: -0.3999999999999999,
                on_trace: false
            }
        );
        assert_eq!(single.slope(0), None);
        assert_eq!(
            (single.at(-5.0), single.at(0.5), single.at(9.0)),
            (2.0, 2.5, 1.4)
        );
        let periodic = Cycle::new(&t, &v, Continuation::periodic(Ms(4.0)));
        // Between the last sample (3, 1.4) of the beat before and the first (4, 2.0) of this one, one period earlier.
        let crossing = back(&periodic);
        assert!((crossing.time_ms - (-1.0 + 0.4 / 0.6)).abs() < 1e-12 && crossing.on_trace);
        assert!((periodic.slope(0).unwrap() - (3.0 - 1.4) / 2.0).abs() < 1e-12);
        assert!((periodic.at(-0.5) - 1.7).abs() < 1e-12 && (periodic.at(7.5) - 1.7).abs() < 1e-12);
    }

    #[test]
    fn a_limb_that_only_touches_the_level_is_left_at_its_foot() {
        // Flat at 1 up to 3 ms, then 1 per ms: a level of 1 ± a hair is left near 3 ms, not at the beginning.
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let v: Vec<f64> = t.iter().map(|t| 1.0 + (t - 3.0).max(0.0)).collect();
        let cycle = Cycle::new(&t, &v, Continuation::Single);
        let at = |level: f64| {
            cycle
                .leaves(9, Way::Back, Side::Above, level, 0.1)
                .unwrap()
                .time_ms
        };
        assert!(
            (at(1.001) - 3.001).abs() < 1e-9 && (at(0.999) - 2.99).abs() < 1e-9,
            "{} {}",
            at(1.001),
            at(0.999)
        );
        // Mirrored in value and in time.
        let fall: Vec<f64> = v.iter().rev().map(|v| -v).collect();
        let cycle = Cycle::new(&t, &fall, Continuation::Single);
        let on = cycle.leaves(0, Way::On, Side::Below, -0.999, 0.1).unwrap();
        assert!((on.time_ms - 6.01).abs() < 1e-9 && !on.on_trace);
        assert_eq!(cycle.leaves(9, Way::On, Side::Below, -1.0, 0.1), None);
    }

    #[test]
    fn the_closing_sample_of_a_periodic_trace_counts_once() {
        let (t, v) = ([0.0, 1.0, 2.0], [1.0, 5.0, 1.0]);
        assert_eq!(Cycle::new(&t, &v, Continuation::periodic(Ms(2.0))).len(), 2);
        assert_eq!(Cycle::new(&t, &v, Continuation::Single).len(), 3);
    }
}
