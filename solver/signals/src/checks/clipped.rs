//! Pressures that an amplifier cut: a top or a bottom at which they stay.

use super::facts::Verdict::{Broken, Doubtful, Holds};
use super::facts::{Facts, Verdict, extremes};
use crate::Trace;

/// Width of a peak half a percent below its top over that five percent below it, above which the top
/// is cut. It is 0.32 for a parabola and nearly 1 for a cut one.
const CUT: f64 = 0.8;
/// Distance from the top within which a pressure counts as standing still, as a share of its range.
const STILL: f64 = 2e-4;
/// Width within [`STILL`] of the top over that five percent below it, above which the top is cut. It is
/// 0.06 for a parabola, and 0.25 where the third derivative vanishes too. A top that is cut by a tenth of
/// the range has 0.5.
const STANDS: f64 = 0.35;
/// The same in widths of a parabola's top that is rounded to the trace's steps.
const STANDS_ROUNDED: f64 = 1.6;
/// Share of samples between the first and the last one within [`STILL`] that are within it too.
const TOGETHER: f64 = 0.6;
/// Fewest samples of a top or bottom that stands still.
const FEWEST: usize = 5;
/// Shortest time for which a bottom stands still, as a share of the cycle.
const BOTTOM: f64 = 0.04;
/// Height above the smallest value, as a share of the range, up to which a trace is at its bottom.
const NEAR_BOTTOM: f64 = 0.01;
/// Time before the bottom, as a share of the cycle, and the fall within it, as a share of the range, from
/// which the pressure stops too suddenly for a relaxation.
const SUDDEN: [f64; 2] = [0.012, 0.03];

/// Share of beats with a cut top from which their mean is too low.
const CUT_BEATS: f64 = 0.25;

/// The rule for the ventricle and the aorta.
pub(super) fn clipped(facts: &Facts<'_>) -> Verdict {
    if let Some(pressure) = facts.pressure {
        let [least, most] = extremes(pressure);
        let of_beats = (facts.cut_beats).filter(|[cut, of]| *cut as f64 > CUT_BEATS * *of as f64);
        let found = match of_beats {
            _ if top_is_cut(pressure) => Some(format!(
                "a pressure that stays at its largest value of {most:.1} mmHg"
            )),
            Some([cut, of]) => Some(format!(
                "a pressure that stays at its largest value in {cut} of {of} beats, with a mean peak of {most:.1} mmHg"
            )),
            None => None,
        };
        if let Some(found) = found {
            return match facts.aorta {
                Some([systolic, _]) if systolic > most => {
                    Broken(format!("{found}, below the aorta's {systolic:.1} mmHg"))
                }
                _ => Doubtful(found),
            };
        }
        if bottom_is_cut(pressure, facts.cycle_ms) {
            return Doubtful(format!(
                "a pressure that falls to its smallest value of {least:.1} mmHg and stays there"
            ));
        }
    }
    match facts.aortic_pressure {
        Some(aorta) if top_is_cut(aorta) => Doubtful(format!(
            "an aortic pressure that stays at its largest value of {:.1} mmHg",
            extremes(aorta)[1]
        )),
        Some(aorta) if end_of_diastole_is_cut(aorta) => Doubtful(format!(
            "an aortic pressure that stays at its smallest value of {:.1} mmHg",
            extremes(aorta)[0]
        )),
        _ => Holds,
    }
}

/// Whether an aorta's pressure stands still at its smallest value: it falls until the valve opens. An average
/// of cut beats swings below the cut by a little where it turns.
fn end_of_diastole_is_cut(trace: &Trace) -> bool {
    let [low, high] = extremes(trace);
    let range = high - low;
    let values = trace.values();
    let Some(top) = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])) else {
        return false;
    };
    // From the largest pressure on, so that the end of the beat joins its begin.
    let from_top: Vec<f64> = values[top..]
        .iter()
        .chain(&values[..top])
        .copied()
        .collect();
    let below = |share: f64| {
        from_top
            .iter()
            .filter(|v| **v <= low + share * range)
            .count()
    };
    let still = (0..from_top.len()).map(|i| {
        let same = |v: &&f64| (**v - from_top[i]).abs() <= STILL * range;
        let is_bottom = from_top[i] <= low + NEAR_BOTTOM * range;
        if is_bottom {
            from_top[i..].iter().take_while(same).count()
        } else {
            0
        }
    });
    let (n, base) = (still.max().unwrap_or(0), below(0.05));
    // Values in steps stand still for as long as the pressure falls by one.
    let rounded = STANDS_ROUNDED * resolution(trace) / 0.05;
    n >= FEWEST && n as f64 > STANDS.max(rounded) * base as f64
}

/// Indices of the first and last sample within a share of the range below the top, and how many samples
/// are within it.
fn within(trace: &Trace, share: f64) -> (usize, usize, usize) {
    let [low, high] = extremes(trace);
    let level = high - share * (high - low);
    let values = trace.values();
    let above = |v: &f64| *v >= level;
    let first = values.iter().position(above).unwrap_or(0);
    let last = values.iter().rposition(above).unwrap_or(0);
    (first, last, values.iter().filter(|v| above(v)).count())
}

/// Smallest difference between two values, as a share of the range.
fn resolution(trace: &Trace) -> f64 {
    let mut values = trace.values().to_vec();
    values.sort_by(f64::total_cmp);
    let least = values
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|step| *step > 0.0)
        .fold(f64::INFINITY, f64::min);
    let [low, high] = extremes(trace);
    least / (high - low)
}

/// Whether the peak is flat: almost as wide near its top as five percent below it, or a part of it stands
/// still as no rounded peak does.
#[must_use]
pub fn top_is_cut(trace: &Trace) -> bool {
    let times = trace.time_ms();
    let width = |(first, last, _): (usize, usize, usize)| times[last] - times[first];
    let base = within(trace, 0.05);
    let near = within(trace, 0.005);
    // Of a narrow peak between two samples nothing can be said.
    let seen = |(first, last, _): (usize, usize, usize)| last >= first + 4;
    if !seen(base) {
        return false;
    }
    if seen(near) && width(near) / width(base) >= CUT {
        return true;
    }
    let still = within(trace, STILL);
    let (first, last, n) = still;
    let together = n as f64 >= TOGETHER * (last - first + 1) as f64;
    // Values in steps, such as whole mmHg, round a peak to a top of this width.
    let rounded = (resolution(trace) / 0.05).sqrt();
    n >= FEWEST && together && width(still) / width(base) > STANDS.max(STANDS_ROUNDED * rounded)
}

/// Whether the pressure falls steeply and then stands still near its smallest value. An average of cut
/// beats swings below the cut by a little where it turns.
fn bottom_is_cut(trace: &Trace, cycle_ms: f64) -> bool {
    let [low, high] = extremes(trace);
    let range = high - low;
    let (times, values) = (trace.time_ms(), trace.values());
    let mut i = 0;
    while i < values.len() {
        let still = |v: &&f64| (**v - values[i]).abs() <= STILL * range;
        let n = values[i..].iter().take_while(still).count();
        let is_bottom = values[i] <= low + NEAR_BOTTOM * range;
        if is_bottom && n >= FEWEST && times[i + n - 1] - times[i] >= BOTTOM * cycle_ms {
            // The last sample at or before the interval's beginning.
            let since = times[i] - SUDDEN[0] * cycle_ms;
            let before = times[..i].partition_point(|t| *t <= since);
            let is_fine = before > 0 && times[i] - times[before - 1] <= 2.0 * SUDDEN[0] * cycle_ms;
            if is_fine && values[before - 1] - values[i] > SUDDEN[1] * range {
                return true;
            }
        }
        i += n.max(1);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quantity;

    const CYCLE_MS: f64 = 900.0;

    /// A ventricle's pressure of 5 to 120 mmHg, cut between two values and rounded to steps.
    fn pressure(cut: [f64; 2], steps_mmhg: f64) -> Trace {
        let values = (0..225)
            .map(|i| {
                let t = 4.0 * f64::from(i);
                let up = 1.0 / (1.0 + (-(t - 70.0) / 10.0).exp());
                let down = 1.0 / (1.0 + ((t - 330.0) / 16.0).exp());
                let bend = 1.0 - 1.2e-5 * (t - 210.0).powi(2);
                let p = (5.0 + 115.0 * up * down * bend).clamp(cut[0], cut[1]);
                (p / steps_mmhg).round() * steps_mmhg
            })
            .collect();
        Trace::uniform(Quantity::Pressure, 4.0, values).unwrap()
    }

    fn of(trace: &Trace) -> Verdict {
        clipped(&Facts {
            cycle_ms: CYCLE_MS,
            pressure: Some(trace),
            ..Facts::default()
        })
    }

    #[test]
    fn a_top_that_is_cut_a_little_is_seen_at_every_resolution() {
        for steps in [1e-6, 0.01, 0.1, 0.5, 1.0] {
            let sound = pressure([0.0, 200.0], steps);
            assert!(matches!(of(&sound), Holds), "steps of {steps} mmHg");
        }
        for most in [115.0, 112.0, 110.0, 100.0, 70.0] {
            for steps in [1e-6, 0.01, 0.1] {
                let cut = pressure([0.0, most], steps);
                let Doubtful(found) = of(&cut) else {
                    panic!("cut at {most}, steps of {steps} mmHg");
                };
                assert!(found.contains("largest value"), "{found}");
            }
        }
    }

    #[test]
    fn a_mean_of_some_cut_beats_is_told() {
        let sound = pressure([0.0, 200.0], 0.1);
        for (cut, is_told) in [(0, false), (2, false), (4, true), (11, true)] {
            let facts = Facts {
                cycle_ms: CYCLE_MS,
                pressure: Some(&sound),
                cut_beats: Some([cut, 11]),
                ..Facts::default()
            };
            match clipped(&facts) {
                Doubtful(found) => assert!(
                    is_told && found.contains(&format!("in {cut} of 11 beats")),
                    "{found}"
                ),
                _ => assert!(!is_told, "{cut} beats"),
            }
        }
    }

    #[test]
    fn a_bottom_is_cut_where_relaxation_stops_suddenly() {
        for least in [15.0, 20.0, 40.0] {
            let Doubtful(found) = of(&pressure([least, 200.0], 0.1)) else {
                panic!("cut at {least}");
            };
            assert!(found.contains("smallest value"), "{found}");
        }
        // A long rest after a complete relaxation is none.
        assert!(matches!(of(&pressure([0.0, 200.0], 0.1)), Holds));
    }

    #[test]
    fn an_aorta_that_is_cut_is_a_doubt_and_a_cut_below_the_aorta_is_wrong() {
        let (sound, cut) = (pressure([0.0, 200.0], 0.1), pressure([0.0, 108.0], 0.1));
        let facts = Facts {
            cycle_ms: CYCLE_MS,
            pressure: Some(&sound),
            aorta: Some([108.0, 60.0]),
            aortic_pressure: Some(&cut),
            ..Facts::default()
        };
        assert!(matches!(clipped(&facts), Doubtful(found) if found.contains("aortic")));
        // Diastole ends with a fall, which a too high lower end of the range cuts.
        let aortic = |least: f64| {
            let values = (0..225).map(|i| {
                let t = 4.0 * f64::from(i);
                let up = 1.0 / (1.0 + (-(t - 80.0) / 12.0).exp());
                let fall = 54.0 * (-(t - 200.0).max(0.0) / 900.0).exp() + 6.0;
                (60.0 - 0.02 * t + up * fall).max(least)
            });
            Trace::uniform(Quantity::Pressure, 4.0, values.collect()).unwrap()
        };
        for (least, is_cut) in [(0.0, false), (70.0, true), (76.0, true)] {
            let aorta = aortic(least);
            let facts = Facts {
                aortic_pressure: Some(&aorta),
                ..facts
            };
            match clipped(&facts) {
                Doubtful(found) => assert!(is_cut && found.contains("smallest"), "{found}"),
                _ => assert!(!is_cut, "{least}"),
            }
        }
        let below = Facts {
            pressure: Some(&cut),
            aorta: Some([114.0, 60.0]),
            ..facts
        };
        assert!(matches!(clipped(&below), Broken(found) if found.contains("below the aorta")));
    }
}
