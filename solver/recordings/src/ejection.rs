//! Start and end of ejection on the cine's clock, estimated from all frames of systole together,
//! because a single frame is too noisy.
//!
//! The times of valve motion are known on the pressure's clock; on the cine's clock, the same
//! events happen at `s t + lag`. The volume is constant until the aortic valve opens, falls by a
//! flow `(1 − w) x^p (1 − x)^q / B + w` until it closes, is constant again, and rises from the
//! mitral valve's opening on. For each s, lag and q, the volume before ejection, the stroke volume
//! and the rate of filling follow from linear least squares. The priors of s and q come from the
//! heart rates and from the pressure's course in ejection ([`usual_fall`]). The result is the mean
//! over all values, weighted by their probability.

use crate::cine::Cine;
use crate::events::ValveEvents;
use crate::filter::{periodic_smooth, solve};
use crate::recording::at;

/// Exponent p of the flow; the flow rises steeply.
const RISE: f64 = 0.9;
/// Share w of the volume that leaves at a constant rate, because flow starts and ends more abruptly
/// than a power law.
const EVEN: f64 = 0.15;
/// Exponents q that are tried, from late peaks of the flow to early ones.
const FALLS: [f64; 13] = [
    0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4, 2.6, 2.8, 3.0,
];
/// Number of times at which the pressure in ejection is read, and the shares of ejection at which
/// the first and the last one lie.
const READ: (usize, f64, f64) = (13, 0.02, 0.98);
/// q as a linear function of the pressure in ejection, relative to its mean over all times: the
/// constant, and the factors of the first, second and last of the pressures that are used. The
/// earlier the flow peaks, the higher is the pressure in the second third of ejection, and the later
/// it falls. A regression over 120 synthetic hearts (seeds 1000 to 1119 of `tests/made`), which no
/// reported figure uses; it leaves a standard deviation of 0.13 of the hearts' 0.32.
const FALL_WITH_AORTA: (f64, [(usize, f64); 3]) = (-37.83, [(1, 6.61), (5, 21.83), (12, 10.99)]);
/// The same with the valve's motion from the ventricle's pressure alone; it leaves 0.19.
const FALL_ALONE: (f64, [(usize, f64); 3]) = (-18.61, [(4, 14.03), (12, 5.98), (0, 0.0)]);
/// Standard deviations of q around both relations.
const FALL_SD: (f64, f64) = (0.14, 0.2);
/// Range of q in the hearts of the regression. The relation is not continued beyond it.
const FALL_RANGE: (f64, f64) = (0.9, 2.4);
/// Duration of ejection as a function of heart rate: 413 ms − 1.7 ms for each beat per minute
/// (Weissler, Harris and Schoenfeld 1968, Circulation 37:149, for men; it was not read).
const DURATION: (f64, f64) = (413.0, 1.7);
/// Prior standard deviation of the factor s around the value from this duration.
const FACTOR_SD: f64 = 0.05;
/// Share of the stroke volume filled again up to which frames are used.
const FILLED: f64 = 0.6;
/// Time before the valve's opening from which on frames are used \[ms\]. It covers the plateau, but
/// not the atrial contraction before it.
const PLATEAU_MS: f64 = 90.0;
/// Typical share of the ejection time after which half of the stroke volume is ejected.
const HALF_OUT: f64 = 0.44;
/// Smallest assumed noise of a frame, as a share of the stroke volume.
const LEAST_NOISE: f64 = 0.01;
/// Smallest number of frames.
const FEWEST: usize = 6;
/// Number of steps in the table of a flow's shape.
const TABLE: usize = 200;

/// Ejection in a cine series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ejection {
    /// Start of ejection on the frames' clock \[ms\].
    pub begin_ms: f64,
    /// End of ejection on the frames' clock \[ms\].
    pub end_ms: f64,
    /// Standard error of the midpoint between start and end \[ms\], including the usual uncertainty
    /// of shape and duration.
    pub middle_error_ms: f64,
}

/// Finds start and end of ejection in the frames. `None` if the volume does not fall, or too few
/// frames show it.
/// - `cycle_length_ms`: cycle length of the pressure
/// - `fall`: prior mean and standard deviation of q
#[must_use]
pub fn find(
    cine: &Cine,
    valves: &ValveEvents,
    cycle_length_ms: f64,
    fall: (f64, f64),
) -> Option<Ejection> {
    let n = cine.volume_ml.len();
    let lowest = (0..n).min_by(|a, b| cine.volume_ml[*a].total_cmp(&cine.volume_ml[*b]))?;
    let (least, stroke) = (cine.volume_ml[lowest], cine.stroke_volume_ml());
    if stroke <= 0.0 {
        return None;
    }
    let time = |k: usize| cine.time_ms[k % n] + (k / n) as f64 * cine.cycle_length_ms;
    let filled = (1..n / 2)
        .find(|k| cine.volume_ml[(lowest + k) % n] > least + FILLED * stroke)
        .unwrap_or(n / 4);
    let last_ms = time(lowest + filled) - 0.25 * cine.step_ms();
    let half_ms = half_out(cine, lowest, least + 0.5 * stroke)?;
    let usual = duration(cine.cycle_length_ms) / duration(cycle_length_ms);
    let (open, close) = (valves.aortic_opening_ms, valves.aortic_closure_ms);
    let half = open + HALF_OUT * (close - open);
    let tables: Vec<Vec<f64>> = FALLS.iter().map(|q| table(*q)).collect();
    let frames = |begin: f64| -> Vec<(f64, f64)> {
        let begin = begin - PLATEAU_MS;
        let here = |t: f64| begin + (t - begin).rem_euclid(cine.cycle_length_ms);
        let placed = cine
            .time_ms
            .iter()
            .zip(&cine.volume_ml)
            .map(|(t, v)| (here(*t), *v));
        placed.filter(|(t, _)| *t <= last_ms).collect()
    };
    let noise_ml = cine.noise_rms_ml().max(LEAST_NOISE * stroke);
    let mut search = Search {
        frames: frames(half_ms + usual * (open - half)),
        valves,
        usual,
        noise_ml,
        tables,
        fall,
    };
    // Coarse search around the time at which half of the volume is ejected, which the frames show
    // directly.
    let mut coarse = Best::default();
    for k in -3..=3 {
        let factor = usual * (1.0 + 0.04 * f64::from(k));
        (-8..=8).for_each(|j| {
            search.try_it(
                factor,
                half_ms - factor * half + 6.0 * f64::from(j),
                &mut coarse,
            )
        });
    }
    let (factor, lag) = coarse.place?;
    // Mean over a fine grid, with the frames for the coarse result.
    search.frames = frames(factor * open + lag);
    let middle = 0.5 * (open + close);
    let mut seen: Vec<(f64, [f64; 2])> = Vec::new();
    for k in -9..=9 {
        let here = factor + 0.015 * f64::from(k);
        let lag = lag + (factor - here) * half;
        for j in -30..=30 {
            let lag = lag + f64::from(j);
            search.each(here, lag, |cost| {
                seen.push((cost, [here, here * middle + lag]))
            });
        }
    }
    let least = seen.iter().map(|s| s.0).min_by(f64::total_cmp)?;
    let (mut weight, mut first, mut second) = (0.0, [0.0; 2], 0.0);
    for (cost, [factor, middle]) in seen {
        let w = (-0.5 * (cost - least)).exp();
        weight += w;
        first[0] += w * factor;
        first[1] += w * middle;
        second += w * middle * middle;
    }
    let [factor, middle_ms] = first.map(|sum| sum / weight);
    let reach = 0.5 * factor * (close - open);
    Some(Ejection {
        begin_ms: middle_ms - reach,
        end_ms: middle_ms + reach,
        middle_error_ms: (second / weight - middle_ms * middle_ms).max(0.0).sqrt(),
    })
}

/// Prior mean and standard deviation of the exponent q, from the course of the ventricle's pressure
/// in ejection.
/// - `pressure_mmhg`: pressure over one periodic cycle, with samples every `step_ms`
#[must_use]
pub fn usual_fall(pressure_mmhg: &[f64], step_ms: f64, valves: &ValveEvents) -> (f64, f64) {
    let smooth = periodic_smooth(pressure_mmhg, (3.0 / step_ms) as usize);
    let (open, close) = (valves.aortic_opening_ms, valves.aortic_closure_ms);
    let (n, first, last) = READ;
    let read: Vec<f64> = (0..n)
        .map(|k| first + (last - first) * k as f64 / (n - 1) as f64)
        .map(|x| at(&smooth, (open + x * (close - open)) / step_ms))
        .collect();
    let mean = read.iter().sum::<f64>() / n as f64;
    let ((constant, factors), sd) = if valves.with_aorta {
        (FALL_WITH_AORTA, FALL_SD.0)
    } else {
        (FALL_ALONE, FALL_SD.1)
    };
    let seen = constant
        + factors
            .iter()
            .map(|(k, f)| f * read[*k] / mean)
            .sum::<f64>();
    if seen.is_finite() {
        (seen.clamp(FALL_RANGE.0, FALL_RANGE.1), sd)
    } else {
        (0.5 * (FALL_RANGE.0 + FALL_RANGE.1), 0.32)
    }
}

/// Duration of ejection for a cycle length \[ms\].
fn duration(cycle_ms: f64) -> f64 {
    (DURATION.0 - DURATION.1 * 60_000.0 / cycle_ms).max(120.0)
}

/// Time before the smallest volume at which the volume falls through a level \[ms\].
fn half_out(cine: &Cine, lowest: usize, level_ml: f64) -> Option<f64> {
    let n = cine.volume_ml.len();
    let place = |back: usize| (lowest + n - back) % n;
    let back = (1..n).find(|back| cine.volume_ml[place(*back)] >= level_ml)?;
    let (a, b) = (place(back), place(back - 1));
    let before = cine.time_ms[a]
        - if a > lowest {
            cine.cycle_length_ms
        } else {
            0.0
        };
    let step = (cine.time_ms[b] - cine.time_ms[a]).rem_euclid(cine.cycle_length_ms);
    let (high, low) = (cine.volume_ml[a], cine.volume_ml[b]);
    Some(before + step * (high - level_ml) / (high - low))
}

/// Ejected share as a function of the share of the ejection time.
fn table(q: f64) -> Vec<f64> {
    let mut ejected = vec![0.0];
    let mut sum = 0.0;
    for k in 0..TABLE {
        let x = (k as f64 + 0.5) / TABLE as f64;
        sum += x.powf(RISE) * (1.0 - x).powf(q);
        ejected.push(sum);
    }
    let evenly = |k: usize| EVEN * k as f64 / TABLE as f64;
    ejected
        .iter()
        .enumerate()
        .map(|(k, e)| (1.0 - EVEN) * e / sum + evenly(k))
        .collect()
}

#[derive(Default)]
struct Best {
    cost: Option<f64>,
    place: Option<(f64, f64)>,
}

struct Search<'a> {
    frames: Vec<(f64, f64)>,
    valves: &'a ValveEvents,
    usual: f64,
    noise_ml: f64,
    tables: Vec<Vec<f64>>,
    fall: (f64, f64),
}

impl Search<'_> {
    fn try_it(&self, factor: f64, lag: f64, best: &mut Best) {
        self.each(factor, lag, |cost| {
            if best.cost.is_none_or(|least| cost < least) {
                *best = Best {
                    cost: Some(cost),
                    place: Some((factor, lag)),
                };
            }
        });
    }

    /// Calls `see` with the negative log-likelihood times two, up to a constant, of each shape for
    /// which the volume would fall.
    fn each(&self, factor: f64, lag: f64, mut see: impl FnMut(f64)) {
        if self.frames.len() < FEWEST {
            return;
        }
        let duration = ((factor / self.usual - 1.0) / FACTOR_SD).powi(2);
        for (table, q) in self.tables.iter().zip(&FALLS) {
            if let Some(squares) = self.squares(factor, lag, table) {
                let shape = ((q - self.fall.0) / self.fall.1).powi(2);
                see(squares / self.noise_ml.powi(2) + shape + duration);
            }
        }
    }

    fn squares(&self, factor: f64, lag: f64, table: &[f64]) -> Option<f64> {
        let (open, close) = (self.valves.aortic_opening_ms, self.valves.aortic_closure_ms);
        let base = self.frames[0].1;
        let rows = self.frames.iter().map(|(t, v)| {
            let tau = (t - lag) / factor;
            let place = ((tau - open) / (close - open)).clamp(0.0, 1.0) * TABLE as f64;
            let k = (place as usize).min(TABLE - 1);
            let ejected = table[k] + (place - k as f64) * (table[k + 1] - table[k]);
            (
                [
                    1.0,
                    -ejected,
                    0.01 * (tau - self.valves.mitral_opening_ms).max(0.0),
                ],
                v - base,
            )
        });
        let mut a = vec![vec![0.0; 4]; 3];
        let mut whole = 0.0;
        for (row, v) in rows {
            for i in 0..3 {
                for j in 0..3 {
                    a[i][j] += row[i] * row[j];
                }
                a[i][3] += row[i] * v;
            }
            whole += v * v;
        }
        // Regularises the rate of filling, which frames without filling do not determine.
        (0..3).for_each(|i| a[i][i] += 1e-6);
        let fit = |unknowns: usize| -> Option<(Vec<f64>, f64)> {
            let rows: Vec<Vec<f64>> = a[..unknowns]
                .iter()
                .map(|row| [&row[..unknowns], &row[3..]].concat())
                .collect();
            let right: Vec<f64> = rows.iter().map(|row| row[unknowns]).collect();
            let x = solve(rows)?;
            let explained = x.iter().zip(right).map(|(a, b)| a * b).sum::<f64>();
            Some((x, (whole - explained).max(0.0)))
        };
        // A ventricle does not empty through the mitral valve.
        let (x, squares) = fit(3).filter(|(x, _)| x[2] >= 0.0).or_else(|| fit(2))?;
        (x[1] > 0.0).then_some(squares)
    }
}
