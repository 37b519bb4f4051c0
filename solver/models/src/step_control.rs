//! Lengths of a beat's time steps, from an estimate of their error.
//!
//! The estimate is the local error of the trapezoidal rule, `h³ y‴ / 12`, over the step's length, for pressure and volume of the
//! cavity. `y‴` is six times the third divided difference of the step's end and the three ends before it. An error over the
//! length of its step adds up to an error of the beat in proportion, so that half the tolerance gives half the error (Hairer,
//! Nørsett and Wanner 1993, Solving Ordinary Differential Equations I, II.4).
//!
//! Steps are powers of two of the output interval, because preconditioners and predictions are kept while a step's length
//! stays. A step becomes twice as long only after three of one length. The history of a run decides alone: a run that continues
//! from a checkpoint takes the same steps.

use cardiotwin_units::Ms;
use serde::{Deserialize, Serialize};

/// Error over tolerance beyond which a step is taken back.
const REJECTED: f64 = 2.0;
/// Room that a step of twice the length must leave below the tolerance, as a share of its length.
const ROOM: f64 = 0.8;
/// Number of states from which the next step's error is estimated.
const N_ENDS: usize = 3;

/// Control of a beat's steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StepControl {
    /// Longest step.
    pub longest: Ms,
    /// Tolerated error of a step over its length: of pressure \[mmHg/s\] and of volume \[mL/s\].
    pub tolerance_per_s: f64,
}

/// The part of each cycle in which points of the wall are activated, one after another. The cavity does not show it yet, so
/// that the estimate of the error cannot see what a long step does to cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Activation {
    begin_ms: f64,
    end_ms: f64,
    cycle_length_ms: f64,
}

impl Activation {
    /// From activation times \[ms\] within a cycle; those that are not finite are never activated.
    #[must_use]
    pub fn of(times_ms: &[f64], cycle_length: Ms) -> Self {
        let finite = times_ms.iter().filter(|time| time.is_finite());
        let (begin_ms, end_ms) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), time| {
            (a.min(*time), b.max(*time))
        });
        Self {
            begin_ms,
            end_ms,
            cycle_length_ms: cycle_length.0,
        }
    }

    /// Whether a point is activated between two times from the beginning of a cycle \[ms\]; times before the beginning are
    /// in the cycle before.
    #[must_use]
    pub fn is_within(&self, from_ms: f64, to_ms: f64) -> bool {
        [0.0, self.cycle_length_ms]
            .iter()
            .any(|later| from_ms < self.end_ms + later && to_ms > self.begin_ms + later)
    }
}

/// State of the cavity at a step's end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StepEnd {
    /// Time from the start of the run \[ms\].
    pub time_ms: f64,
    /// Pressure \[mmHg\].
    pub pressure_mmhg: f64,
    /// Volume \[mL\].
    pub volume_ml: f64,
}

/// Ends of the last steps, and what follows from them for the next step.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StepHistory {
    /// The last ends, oldest first.
    ends: Vec<StepEnd>,
    /// Length of the next step in output intervals, a power of two; zero for one.
    next: usize,
}

/// Third divided difference of a quantity at four times.
fn third_difference(ends: [StepEnd; 4], of: impl Fn(&StepEnd) -> f64) -> f64 {
    let mut values = ends.map(|end| of(&end));
    for order in 1..ends.len() {
        for k in (order..ends.len()).rev() {
            values[k] = (values[k] - values[k - 1]) / (ends[k].time_ms - ends[k - order].time_ms);
        }
    }
    values[3]
}

impl StepHistory {
    /// Intervals that the next step covers, at most `left`: a power of two.
    #[must_use]
    pub fn next_intervals(&self, left: usize) -> usize {
        let mut intervals = self.next.max(1);
        while intervals > left.max(1) {
            intervals /= 2;
        }
        intervals
    }

    /// Output intervals of `interval_ms` that the last step covered; `None` before the second end.
    #[must_use]
    pub fn last_intervals(&self, interval_ms: f64) -> Option<usize> {
        let [.., before, last] = &self.ends[..] else {
            return None;
        };
        Some(((last.time_ms - before.time_ms) / interval_ms).round() as usize)
    }

    /// Error of a step to `end` over its length, of pressure \[mmHg/s\] or volume \[mL/s\], whichever is larger; `None` as long
    /// as there are too few earlier steps.
    #[must_use]
    pub fn error_per_s(&self, end: StepEnd) -> Option<f64> {
        let [a, b, c] = self.ends[..] else {
            return None;
        };
        let ends = [a, b, c, end];
        let length_ms = end.time_ms - c.time_ms;
        let pressure = third_difference(ends, |end| end.pressure_mmhg).abs();
        let volume = third_difference(ends, |end| end.volume_ml).abs();
        // y‴ / 12 is half of the divided difference.
        Some(1e3 * 0.5 * length_ms * length_ms * pressure.max(volume))
    }

    /// Whether a step to `end` is accurate enough to be kept.
    #[must_use]
    pub fn accepts(&self, control: &StepControl, end: StepEnd) -> bool {
        self.error_per_s(end)
            .is_none_or(|error| error <= REJECTED * control.tolerance_per_s)
    }

    /// Adds a committed step that covered `intervals` output intervals of `interval_ms`, and sets the length of the next.
    pub fn keep(
        &mut self,
        control: &StepControl,
        end: StepEnd,
        (intervals, interval_ms): (usize, f64),
    ) {
        let intervals = intervals.max(1);
        let even = self.is_even(end, interval_ms);
        self.next = match self.error_per_s(end) {
            None => 1,
            Some(error) => {
                // The error over the length falls with the square of the length.
                let share = (control.tolerance_per_s / error.max(f64::MIN_POSITIVE)).sqrt();
                let twice = 2 * intervals;
                let fits = twice as f64 * interval_ms <= control.longest.0 * (1.0 + 1e-9);
                if share < 1.0 {
                    (intervals / 2).max(1)
                } else if even && fits && ROOM * share >= 2.0 {
                    twice
                } else {
                    intervals
                }
            }
        };
        self.ends.push(end);
        if self.ends.len() > N_ENDS {
            self.ends.remove(0);
        }
    }

    /// Whether the step to `end` is as long as the two before it.
    fn is_even(&self, end: StepEnd, interval_ms: f64) -> bool {
        let [a, b, c] = &self.ends[..] else {
            return false;
        };
        let lengths = [
            b.time_ms - a.time_ms,
            c.time_ms - b.time_ms,
            end.time_ms - c.time_ms,
        ];
        lengths[..2]
            .iter()
            .all(|length| (length - lengths[2]).abs() <= 1e-6 * interval_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTROL: StepControl = StepControl {
        longest: Ms(8.0),
        tolerance_per_s: 5.0,
    };

    /// Pressure `time³/1000` mmHg at a constant volume.
    fn cubic(time_ms: f64) -> StepEnd {
        StepEnd {
            time_ms,
            pressure_mmhg: 1e-3 * time_ms.powi(3),
            volume_ml: 80.0,
        }
    }

    fn after(times_ms: &[f64], end: impl Fn(f64) -> StepEnd) -> StepHistory {
        let mut history = StepHistory::default();
        for time in times_ms {
            history.keep(&CONTROL, end(*time), (1, 1.0));
        }
        history
    }

    #[test]
    fn error_is_that_of_the_trapezoidal_rule_at_any_spacing() {
        // y‴ = 0.006 mmHg/ms³, so that h² y‴ / 12 = 0.0005 h² mmHg/ms.
        for (times, end, wanted) in [
            ([0.0, 1.0, 2.0], 3.0, 0.5),
            ([0.0, 1.0, 3.0], 7.0, 8.0),
            ([0.0, 4.0, 5.0], 7.0, 2.0),
        ] {
            let error = after(&times, cubic)
                .error_per_s(cubic(end))
                .expect("four states");
            assert!((error - wanted).abs() < 1e-9, "{error} for {wanted}");
        }
        assert_eq!(after(&[0.0, 1.0], cubic).error_per_s(cubic(2.0)), None);
    }

    #[test]
    fn steps_grow_after_three_of_a_length_up_to_the_longest() {
        let flat = |time_ms| StepEnd {
            time_ms,
            pressure_mmhg: 9.0,
            volume_ml: 120.0,
        };
        let (mut history, mut time, mut taken) = (StepHistory::default(), 0.0, vec![]);
        history.keep(&CONTROL, flat(0.0), (1, 1.0));
        for _ in 0..14 {
            let intervals = history.next_intervals(usize::MAX);
            time += intervals as f64;
            taken.push(intervals);
            history.keep(&CONTROL, flat(time), (intervals, 1.0));
        }
        assert_eq!(taken, [1, 1, 1, 2, 2, 2, 4, 4, 4, 8, 8, 8, 8, 8]);
        assert_eq!(history.next_intervals(5), 4);
        assert_eq!(history.next_intervals(1), 1);
    }

    #[test]
    fn activation_is_found_in_each_cycle() {
        let activation = Activation::of(&[12.0, f64::INFINITY, 48.0], Ms(800.0));
        assert!(activation.is_within(10.0, 14.0) && activation.is_within(40.0, 48.5));
        assert!(!activation.is_within(8.0, 12.0) && !activation.is_within(48.0, 52.0));
        let early = Activation::of(&[-10.0, 30.0], Ms(800.0));
        assert!(early.is_within(788.0, 792.0) && early.is_within(0.0, 4.0));
        assert!(!early.is_within(700.0, 790.0));
        assert!(!Activation::of(&[], Ms(800.0)).is_within(0.0, 800.0));
    }

    #[test]
    fn a_kink_is_taken_back_and_shortens_what_follows() {
        let kinked = |time_ms: f64| StepEnd {
            time_ms,
            pressure_mmhg: 1.5 * (time_ms - 10.0).max(0.0),
            volume_ml: 120.0,
        };
        let before = after(&[0.0, 4.0, 8.0], kinked);
        assert!(before.accepts(&CONTROL, kinked(10.0)));
        assert!(!before.accepts(&CONTROL, kinked(12.0)));
        let mut history = before;
        history.keep(&CONTROL, kinked(12.0), (4, 1.0));
        assert_eq!(history.next_intervals(usize::MAX), 2);
    }
}
