//! Phases of a beat, found from the data.

use crate::noise::{Signal, slopes};
use serde::{Deserialize, Serialize};

/// Start times of the phases within the cycle \[ms\], in order. The last phase ends where the first
/// starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// Foot of the upstroke, where isovolumic contraction starts.
    pub isovolumic_contraction_ms: f64,
    /// Time after the largest dP/dt at which dP/dt has fallen to half of it; about the opening of
    /// the aortic valve.
    pub early_ejection_ms: f64,
    /// Middle of the ejection.
    pub late_ejection_ms: f64,
    /// Time before the smallest dP/dt at which dP/dt reaches half of it; about the closure of the
    /// aortic valve.
    pub isovolumic_relaxation_ms: f64,
    /// Foot of the fall, where the mitral valve opens.
    pub rapid_filling_ms: f64,
    /// End of rapid filling: 70 % of the stroke volume has returned.
    pub diastasis_ms: f64,
    /// Latest start of atrial systole.
    pub atrial_systole_ms: f64,
}

/// Names of the phases, in order.
pub const PHASES: [&str; 7] = [
    "isovolumic_contraction",
    "early_ejection",
    "late_ejection",
    "isovolumic_relaxation",
    "rapid_filling",
    "diastasis",
    "atrial_systole",
];

/// Longest time from the start of atrial systole to the foot of the upstroke \[ms\]: a P-R interval
/// and the electromechanical delay.
const ATRIAL_LEAD_MS: f64 = 150.0;

impl Phases {
    /// Finds the phases in pressure and volume as measured, from extremes of dP/dt and levels of
    /// pressure and volume.
    ///
    /// - `cycle`: length of the cycle \[ms\]
    #[must_use]
    pub fn of(pressure: &Signal, volume: &Signal, cycle: f64) -> Self {
        let (t, p) = (&pressure.time_ms, &pressure.value);
        let rate = slopes(t, p, 8.0);
        let extreme = |sign: f64| {
            (0..t.len())
                .max_by(|a, b| (sign * rate[*a]).total_cmp(&(sign * rate[*b])))
                .unwrap_or(0)
        };
        let (up, down) = (extreme(1.0), extreme(-1.0));
        let (low, high) = pressure.range();
        let level = |share: f64| low + share * (high - low);
        // Walks from an index backwards or forwards around the cycle until the condition holds.
        let walk = |from: usize, step: isize, stop: &dyn Fn(usize) -> bool| -> f64 {
            let n = t.len() as isize;
            let mut i = from as isize;
            for _ in 0..n {
                if stop(i as usize) {
                    break;
                }
                i = (i + step).rem_euclid(n);
            }
            t[i as usize]
        };
        let foot = walk(up, -1, &|i| rate[i] < 0.1 * rate[up]);
        let opening = walk(up, 1, &|i| rate[i] < 0.5 * rate[up]);
        let closing = walk(down, -1, &|i| rate[i] > 0.5 * rate[down]);
        let filling = walk(down, 1, &|i| {
            p[i] < level(0.12) || rate[i] > 0.1 * rate[down]
        });
        let after = |a: f64, b: f64| (b - a).rem_euclid(cycle);
        let half = (opening + 0.5 * after(opening, closing)).rem_euclid(cycle);
        let atrial = (foot - ATRIAL_LEAD_MS).rem_euclid(cycle);
        // Rapid filling lasts until 70 % of the stroke volume has returned, but at most for two
        // thirds of the time to atrial systole.
        let (vt, v) = (&volume.time_ms, &volume.value);
        let (v_low, v_high) = volume.range();
        let way = after(filling, atrial);
        let back = (vt.iter().zip(v))
            .filter(|(t, v)| after(filling, **t) < way && **v > v_low + 0.7 * (v_high - v_low))
            .map(|(t, _)| after(filling, *t))
            .fold(way, f64::min);
        let rapid = if way > 0.0 {
            back.clamp(way.min(60.0), 0.67 * way.max(90.0)).min(way)
        } else {
            0.0
        };
        Self {
            isovolumic_contraction_ms: foot,
            early_ejection_ms: opening,
            late_ejection_ms: half,
            isovolumic_relaxation_ms: closing,
            rapid_filling_ms: filling,
            diastasis_ms: (filling + rapid).rem_euclid(cycle),
            atrial_systole_ms: atrial,
        }
    }

    /// Start times in order.
    #[must_use]
    pub fn beginnings(&self) -> [f64; 7] {
        [
            self.isovolumic_contraction_ms,
            self.early_ejection_ms,
            self.late_ejection_ms,
            self.isovolumic_relaxation_ms,
            self.rapid_filling_ms,
            self.diastasis_ms,
            self.atrial_systole_ms,
        ]
    }

    /// Index in [`PHASES`] of a time in the cycle.
    #[must_use]
    pub fn at(&self, time_ms: f64, cycle_ms: f64) -> usize {
        let begin = self.beginnings();
        let since = |i: usize| (time_ms - begin[i]).rem_euclid(cycle_ms);
        (0..7)
            .min_by(|a, b| since(*a).total_cmp(&since(*b)))
            .unwrap_or(0)
    }
}
