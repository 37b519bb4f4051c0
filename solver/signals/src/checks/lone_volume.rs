//! A volume far off both of its neighbours: a wrong contour, or a wrong digit.

use super::facts::{Facts, Verdict};
use crate::Trace;

/// Key of the rule that judges the volumes by themselves.
pub const VOLUME_KEY: &str = "measured.volume";

/// Distance from the neighbours over the stroke volume that is doubtful, and that is an error. Frames
/// of a whole beat with a noise of 6 % of the stroke reach 0.18, and corners of ejection 0.1.
const SHARES: [f64; 2] = [0.2, 0.35];
/// Ratio to the median distance of all samples below which the trace is only noisy.
const ALONE: f64 = 6.0;
/// Fewest samples of which one can be alone.
const FEWEST: usize = 8;
/// Share of samples at either end that the stroke does not count: one wrong sample is its extreme.
const ENDS: f64 = 0.06;

/// The volume that is farthest off its neighbours, if it is alone with that.
pub(super) fn lone_volume(facts: &Facts<'_>) -> Verdict {
    let Some(volume) = facts.volume.filter(|v| v.n_samples() >= FEWEST) else {
        return Verdict::Holds;
    };
    let expected: Vec<Option<f64>> = (0..volume.n_samples())
        .map(|i| by_neighbours(volume, i, facts.cycle_ms))
        .collect();
    let (times, values) = (volume.time_ms(), volume.values());
    let distance = |i: usize| expected[i].map_or(0.0, |v| (values[i] - v).abs());
    let mut distances: Vec<f64> = (0..values.len()).map(distance).collect();
    let Some(worst) = (0..values.len()).max_by(|a, b| distances[*a].total_cmp(&distances[*b]))
    else {
        return Verdict::Holds;
    };
    let farthest = distances[worst];
    distances.sort_by(f64::total_cmp);
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let end = (ENDS * sorted.len() as f64).ceil() as usize;
    let stroke = sorted[sorted.len() - 1 - end] - sorted[end];
    if farthest < ALONE * distances[distances.len() / 2] {
        return Verdict::Holds;
    }
    let found = format!(
        "{:.1} mL at {:.0} ms, where the volumes before and after give {:.1} mL",
        values[worst],
        times[worst],
        expected[worst].unwrap_or(f64::NAN)
    );
    match farthest / stroke {
        share if share > SHARES[1] => Verdict::Broken(found),
        share if share > SHARES[0] => Verdict::Doubtful(found),
        _ => Verdict::Holds,
    }
}

/// The volume that the two samples before and the two after give, by a line or a cubic, whichever lies
/// nearer: a cubic overshoots at corners of the flow. `None` where the beat has no such neighbours.
fn by_neighbours(volume: &Trace, i: usize, cycle_ms: f64) -> Option<f64> {
    let (times, values) = (volume.time_ms(), volume.values());
    let n = values.len();
    let is_whole = cycle_ms > times[n - 1] - times[0];
    let neighbour = |offset: usize| {
        // Counted from two before the sample, in the beat before, of and after the trace.
        let place = i + offset + n - 2;
        let turns = (place / n) as f64 - 1.0;
        (turns == 0.0 || is_whole).then(|| (times[place % n] + turns * cycle_ms, values[place % n]))
    };
    let [a, b, c, d] = [neighbour(0)?, neighbour(1)?, neighbour(3)?, neighbour(4)?];
    let at = times[i];
    let line = b.1 + (c.1 - b.1) * (at - b.0) / (c.0 - b.0);
    let all = [a, b, c, d];
    let cubic: f64 = all
        .iter()
        .map(|(time, value)| {
            let others = all.iter().filter(|other| other.0 != *time);
            value * others.map(|(t, _)| (at - t) / (time - t)).product::<f64>()
        })
        .sum();
    let nearer = |v: f64| (values[i] - v).abs();
    Some(if nearer(cubic) < nearer(line) {
        cubic
    } else {
        line
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quantity;
    use std::f64::consts::PI;

    /// A beat of 800 ms with a stroke of 80 mL in frames of 32 ms, one of them multiplied.
    fn verdict(frame: usize, factor: f64, noise_ml: f64) -> Verdict {
        let values = (0..25).map(|i| {
            let t = 32.0 * i as f64;
            let ejected = 0.5 - 0.5 * (PI * ((t - 60.0) / 300.0).clamp(0.0, 1.0)).cos();
            let filled = 0.5 - 0.5 * (PI * ((t - 400.0) / 300.0).clamp(0.0, 1.0)).cos();
            let noise = noise_ml * (7.0 * t).sin();
            (130.0 - 80.0 * (ejected - filled) + noise) * if i == frame { factor } else { 1.0 }
        });
        let volume = Trace::uniform(Quantity::Volume, 32.0, values.collect()).unwrap();
        lone_volume(&Facts {
            volume: Some(&volume),
            cycle_ms: 800.0,
            ..Facts::default()
        })
    }

    #[test]
    fn a_wrong_frame_is_found_wherever_it_is() {
        for frame in 0..25 {
            assert!(
                matches!(verdict(frame, 1.0, 5.0), Verdict::Holds),
                "{frame}"
            );
            let Verdict::Broken(found) = verdict(frame, 2.0, 2.0) else {
                panic!("{frame}");
            };
            assert!(found.contains(&format!(" at {} ms", 32 * frame)), "{found}");
        }
        assert!(matches!(verdict(2, 1.16, 1.0), Verdict::Doubtful(_)));
    }
}
