//! Onset of activation, estimated from the measured pressure.
//!
//! Stress begins after the electromechanical delay, and in the middle of the wall half the spread
//! later than in its first part. The pressure then rises like a parabola, because the Tanh stress
//! does. The first activation therefore lies this much before the vertex of a parabola through the
//! lower upstroke: `onset = t_vertex − t_emd − spread/2`. A line through 5 to 20 % of the rise A,
//! with slope k, meets the pressure before the upstroke at t_foot (intersecting tangents; Chiu et
//! al. 1991, Am Heart J 121:1460). If the line is a chord of a parabola between these shares, the
//! vertex lies 0.1 A/k before t_foot. The time at which the rate passes a share of its maximum
//! gives the same information in smooth traces only, because the noise of a catheter has rates as
//! large.
//!
//! The onset is negative if the trace's time zero is later, for example at the R wave or at the
//! largest volume. Durations do not depend on the onset. It determines when the pressure rises and
//! how much of the cycle is left for filling.

use cardiotwin_schemas::outcome::Estimate;
use cardiotwin_schemas::task::PassiveStateSpec;
use cardiotwin_signals::Trace;

use super::measurements::Measurements;

/// Electromechanical delay of the Tanh model (Jung 2022, Table A1).
const T_EMD_MS: f64 = 15.0;
/// Shares of the pressure's rise between which a line is fitted to the upstroke.
const LOWER_UPSTROKE: [f64; 2] = [0.05, 0.2];
/// Onset without a pressure trace: the usual beginning of the QRS complex in gated traces \[ms\].
pub const ONSET_WITHOUT_TRACE_MS: f64 = 30.0;

/// First activation \[ms\], from the specification or estimated.
pub(super) fn onset_ms(
    spec: &PassiveStateSpec,
    measured: &Measurements,
    spread_ms: f64,
    estimates: &mut Vec<Estimate>,
) -> f64 {
    spec.activation.onset_ms.unwrap_or_else(|| {
        let found = measured
            .pressure
            .as_ref()
            .and_then(|trace| from_upstroke(trace, spread_ms));
        let (value, method) = match found {
            Some(onset) => (
                onset,
                "measured pressure upstroke less electromechanical delay and half the spread",
            ),
            None => (
                ONSET_WITHOUT_TRACE_MS,
                "usual place, for lack of a pressure trace",
            ),
        };
        estimates.push(Estimate {
            key: "solver.activation.onset_ms".to_owned(),
            value,
            sd: None,
            method: method.to_owned(),
        });
        value
    })
}

/// First activation \[ms\] after the trace's time zero; `None` if the pressure never rises.
///
/// - `pressure`: measured pressure, resampled to 1 ms
/// - `spread_ms`: time between first and last activation
#[must_use]
pub fn from_upstroke(pressure: &Trace, spread_ms: f64) -> Option<f64> {
    Some(vertex_ms(pressure.time_ms(), pressure.values())? - T_EMD_MS - 0.5 * spread_ms)
}

/// Start of the upstroke: vertex of the parabola through its lower part.
fn vertex_ms(time_ms: &[f64], values: &[f64]) -> Option<f64> {
    let peak = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b]))?;
    let last_below = |level: f64| {
        (0..peak)
            .rev()
            .find(|idx| values[*idx] < level)
            .unwrap_or(0)
    };
    let level = |before: f64, share: f64| before + share * (values[peak] - before);
    // Pressure before the upstroke, from which the start of the upstroke is found in a second pass.
    let first = median(&values[..values.len().min(10)]);
    let before = median(&values[..=last_below(level(first, 2.0 * LOWER_UPSTROKE[0]))]);
    let [low, high] = LOWER_UPSTROKE.map(|share| last_below(level(before, share)));
    let range = low..(high + 2).min(peak + 1);
    let n = range.len() as f64;
    let (t, p) = range.clone().fold((0.0, 0.0), |(t, p), k| {
        (t + time_ms[k] / n, p + values[k] / n)
    });
    let (tt, tp) = range.fold((0.0, 0.0), |(tt, tp), k| {
        let dt = time_ms[k] - t;
        (tt + dt * dt, tp + dt * (values[k] - p))
    });
    let slope = tp / tt;
    let [low, high] = LOWER_UPSTROKE.map(f64::sqrt);
    // Distance of the vertex from the chord's crossing with the pressure before the upstroke, in
    // units of the rise divided by the chord's slope.
    let to_vertex = low * high;
    (slope > 0.0).then(|| t - (p - before + to_vertex * (values[peak] - before)) / slope)
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_signals::Quantity;

    /// Pressure that rises like a parabola from `begin_ms` on, so that its rate is linear in time,
    /// and falls after 60 ms.
    fn upstroke(begin_ms: f64) -> Trace {
        let value = |time: f64| {
            let since = (time - begin_ms).max(0.0);
            if since <= 60.0 {
                8.0 + 0.03 * since * since
            } else {
                116.0 - (since - 60.0)
            }
        };
        Trace::uniform(
            Quantity::Pressure,
            1.0,
            (0..400).map(|idx| value(f64::from(idx))).collect(),
        )
        .unwrap()
    }

    #[test]
    fn the_onset_moves_with_the_upstroke_and_the_spread() {
        let onset = |begin, spread| from_upstroke(&upstroke(begin), spread).unwrap();
        assert!(
            (onset(80.0, 40.0) - (80.0 - 15.0 - 20.0)).abs() < 1.5,
            "{}",
            onset(80.0, 40.0)
        );
        assert!((onset(100.0, 40.0) - onset(80.0, 40.0) - 20.0).abs() < 1e-6);
        assert!((onset(80.0, 20.0) - onset(80.0, 40.0) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn a_catheters_noise_hardly_moves_it() {
        let clean = upstroke(80.0);
        let mut state = 0.0;
        // Noise of 1 mmHg, correlated over 10 ms.
        let noisy = clean.values().iter().enumerate().map(|(idx, p)| {
            let unit = (idx as f64 * 12.9898).sin() * 43_758.545_3;
            state = 0.905 * state + 1.47 * (unit - unit.floor() - 0.5);
            p + state
        });
        let noisy = Trace::uniform(Quantity::Pressure, 1.0, noisy.collect()).unwrap();
        let moved = from_upstroke(&noisy, 40.0).unwrap() - from_upstroke(&clean, 40.0).unwrap();
        assert!(moved.abs() < 6.0, "{moved}");
    }

    #[test]
    fn it_may_be_before_the_trace_and_is_absent_without_a_rise() {
        let onset = from_upstroke(&upstroke(5.0), 40.0).unwrap();
        assert!((onset - (5.0 - 15.0 - 20.0)).abs() < 4.0, "{onset}");
        let falling = Trace::uniform(Quantity::Pressure, 1.0, vec![9.0, 8.0, 7.0, 6.0]).unwrap();
        assert_eq!(from_upstroke(&falling, 40.0), None);
    }
}
