//! Start and end of ejection on the cine's clock, estimated from all frames of systole together,
//! because a single frame is too noisy.
//!
//! The times of valve motion are known on the pressure's clock; on the cine's clock, the same
//! events happen at `s t + lag`. The volume is constant until the aortic valve opens, falls by a
//! flow `(1 − w) x^p (1 − x)^q / B + w` until it closes, is constant again, and rises from the
//! mitral valve's opening on. For each s, lag and q, the volume before ejection, the stroke volume
//! and the rate of filling follow from linear least squares. Priors of s and q apply if the frames
//! do not determine them.

use crate::cine::Cine;
use crate::events::ValveEvents;
use crate::filter::solve;

/// Exponent p of the flow; the flow rises steeply.
const RISE: f64 = 0.9;
/// Share w of the volume that leaves at a constant rate, because flow starts and ends more abruptly
/// than a power law.
const EVEN: f64 = 0.15;
/// Exponents q that are tried, from late peaks of the flow to early ones.
const FALLS: [f64; 10] = [0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4, 2.6];
/// Prior mean and standard deviation of q: after half of the ejection time, 62 % are ejected. The
/// values are chosen so that the mean error vanishes for synthetic hearts of another formulation
/// (`tests/known_truth.rs`).
const USUAL_FALL: (f64, f64) = (1.7, 0.25);
/// Duration of ejection as a function of heart rate: 413 ms − 1.7 ms for each beat per minute
/// (Weissler, Harris and Schoenfeld 1968, Circulation 37:149, men).
const DURATION: (f64, f64) = (413.0, 1.7);
/// Prior standard deviation of the factor s around the value from this duration.
const FACTOR_SD: f64 = 0.05;
/// Share of the stroke volume filled again up to which frames are used.
const FILLED: f64 = 0.35;
/// Time before the valve's opening from which on frames are used \[ms\]. It covers the plateau, but
/// not the atrial contraction before it.
const PLATEAU_MS: f64 = 60.0;
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
#[must_use]
pub fn find(cine: &Cine, valves: &ValveEvents, cycle_length_ms: f64) -> Option<Ejection> {
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
    // Fine search, with the frames for the coarse result.
    search.frames = frames(factor * open + lag);
    let mut fine = Best::default();
    for k in -4..=4 {
        let here = factor + 0.01 * f64::from(k);
        let lag = lag + (factor - here) * half;
        (-20..=20).for_each(|j| search.try_it(here, lag + f64::from(j), &mut fine));
    }
    let (factor, lag) = fine.place?;
    Some(Ejection {
        begin_ms: factor * open + lag,
        end_ms: factor * close + lag,
        middle_error_ms: search.error_of_middle(factor, lag, 0.5 * (open + close)),
    })
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
}

impl Search<'_> {
    fn try_it(&self, factor: f64, lag: f64, best: &mut Best) {
        let Some(cost) = self.cost(factor, lag) else {
            return;
        };
        if best.cost.is_none_or(|least| cost < least) {
            *best = Best {
                cost: Some(cost),
                place: Some((factor, lag)),
            };
        }
    }

    /// Negative log-likelihood times two, up to a constant, for the best shape; `None` if the
    /// volume would not fall and fill.
    fn cost(&self, factor: f64, lag: f64) -> Option<f64> {
        if self.frames.len() < FEWEST {
            return None;
        }
        let duration = ((factor / self.usual - 1.0) / FACTOR_SD).powi(2);
        let of_shape = |(table, q): (&Vec<f64>, &f64)| {
            let squares = self.squares(factor, lag, table)?;
            Some(squares / self.noise_ml.powi(2) + ((q - USUAL_FALL.0) / USUAL_FALL.1).powi(2))
        };
        let best = self
            .tables
            .iter()
            .zip(&FALLS)
            .filter_map(of_shape)
            .min_by(f64::total_cmp)?;
        Some(best + duration)
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
        let right = [a[0][3], a[1][3], a[2][3]];
        let x = solve(a)?;
        if x[1] <= 0.0 || x[2] < 0.0 {
            return None;
        }
        Some((whole - x.iter().zip(right).map(|(a, b)| a * b).sum::<f64>()).max(0.0))
    }

    /// Error from the curvature of the cost, minimised over the factor.
    fn error_of_middle(&self, factor: f64, lag: f64, middle: f64) -> f64 {
        let beside = |d: f64| {
            let moved = (-6..=6).filter_map(|k| {
                let here = factor + 0.01 * f64::from(k);
                self.cost(here, lag + (factor - here) * middle + d)
            });
            moved.min_by(f64::total_cmp)
        };
        let h = 6.0;
        let (Some(before), Some(here), Some(after)) = (beside(-h), beside(0.0), beside(h)) else {
            return f64::INFINITY;
        };
        let curvature = (before + after - 2.0 * here) / (h * h);
        if curvature > 0.0 {
            (2.0 / curvature).sqrt()
        } else {
            f64::INFINITY
        }
    }
}
