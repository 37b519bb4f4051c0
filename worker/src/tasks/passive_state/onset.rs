//! When the wall is activated, found from the measured pressure.
//!
//! Stress begins after the electromechanical delay, in the middle of the wall half the spread after its first part, and
//! the pressure's rate then rises steeply. So the first activation is put that much before the measured rate passes a
//! share of its maximum:
//! `onset = t(dP/dt = 10 % of its max, before it) − t_emd − spread/2`.
//! It is negative where the trace's time zero is later, as with an R wave or the largest volume.
//! Durations do not depend on it; it decides when the pressure rises, and how much of the cycle is left for filling.

use cardiotwin_signals::Trace;

/// Electromechanical delay of the Tanh model (Jung 2022, Table A1).
const T_EMD_MS: f64 = 15.0;
/// Share of the largest rate at which the upstroke begins.
const RATE_SHARE: f64 = 0.1;
/// Onset where no pressure trace tells: the usual place of the QRS complex's start in gated traces.
pub const ONSET_WITHOUT_TRACE_MS: f64 = 30.0;

/// First activation, ms after the trace's time zero; `None` where pressure never rises.
///
/// - `pressure`: measured, resampled to 1 ms
/// - `spread_ms`: first activation to last
#[must_use]
pub fn from_upstroke(pressure: &Trace, spread_ms: f64) -> Option<f64> {
    let (time, values) = (pressure.time_ms(), pressure.values());
    let rate = |idx: usize| (values[idx + 1] - values[idx - 1]) / (time[idx + 1] - time[idx - 1]);
    let peak = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b]))?;
    let steepest = (1..peak).max_by(|a, b| rate(*a).total_cmp(&rate(*b)))?;
    let level = RATE_SHARE * rate(steepest);
    if level <= 0.0 {
        return None;
    }
    let before = (1..steepest).rev().find(|idx| rate(*idx) < level).unwrap_or(0);
    let crossing = if before == 0 {
        time[1]
    } else {
        let (low, high) = (rate(before), rate(before + 1));
        time[before] + (level - low) / (high - low) * (time[before + 1] - time[before])
    };
    Some(crossing - T_EMD_MS - 0.5 * spread_ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_signals::Quantity;

    /// Pressure that rises as a parabola from `begin_ms` on, so that its rate is linear in time, and falls after 60 ms.
    fn upstroke(begin_ms: f64) -> Trace {
        let value = |time: f64| {
            let since = (time - begin_ms).max(0.0);
            if since <= 60.0 { 8.0 + 0.03 * since * since } else { 116.0 - (since - 60.0) }
        };
        Trace::uniform(Quantity::Pressure, 1.0, (0..400).map(|idx| value(f64::from(idx))).collect()).unwrap()
    }

    #[test]
    fn the_onset_moves_with_the_upstroke_and_the_spread() {
        let onset = |begin, spread| from_upstroke(&upstroke(begin), spread).unwrap();
        // The rate reaches 10 % of its largest value (at 59 ms) 5.9 ms after the beginning.
        assert!((onset(80.0, 40.0) - (85.9 - 15.0 - 20.0)).abs() < 0.1, "{}", onset(80.0, 40.0));
        assert!((onset(100.0, 40.0) - onset(80.0, 40.0) - 20.0).abs() < 1e-9);
        assert!((onset(80.0, 20.0) - onset(80.0, 40.0) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn it_may_be_before_the_trace_and_is_absent_without_a_rise() {
        let onset = from_upstroke(&upstroke(5.0), 40.0).unwrap();
        assert!((onset - (10.9 - 15.0 - 20.0)).abs() < 0.1, "{onset}");
        let falling = Trace::uniform(Quantity::Pressure, 1.0, vec![9.0, 8.0, 7.0, 6.0]).unwrap();
        assert_eq!(from_upstroke(&falling, 40.0), None);
    }
}
