//! Biomarkers and penalty terms of a beat on the 1 ms grid (SPEC: Appendix C and section 2.3.2 of Jung et al. 2022).

use cardiotwin_vocabulary::biomarkers::CellBiomarkers;
use serde::{Deserialize, Serialize};

use crate::trace::Segment;

/// Biomarkers of a beat of the cell, and what else is read from it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CellReading {
    /// Biomarkers of the beat.
    pub biomarkers: CellBiomarkers,
    /// Time of the largest active stress \[ms\].
    pub t_sa_max_ms: f64,
    /// Whether STD30, STD50 and STD90 each lack a crossing, which is then taken at that end of the
    /// beat.
    pub cut: [bool; 3],
    /// Stress at the beat's start \[kPa\].
    pub sa_res_kpa: f64,
    /// Smallest active stress of the beat \[kPa\].
    pub sa_min_kpa: f64,
    /// Steepest rise between two samples after the maximum, 0 if none \[kPa/ms\].
    pub max_rise_after_peak_kpa_per_ms: f64,
    /// Time from activation to 50 % decay of calcium \[ms\], from the analytic transient and not
    /// cut at the cycle's end.
    pub ctd50_ms: f64,
    /// Time from activation to 90 % decay of calcium \[ms\], read in the same way.
    pub ctd90_ms: f64,
}

/// The terms of the paper's penalty, kPa and ms, unweighted.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Penalty {
    /// Square of the stress at the beat's start, Sa(0)².
    pub sa_res: f64,
    /// Integral of negative stress, ∫ min(0, Sa)² dt, by trapezoids.
    pub negative_stress: f64,
    /// Integral of rises after the maximum, ∫ max(0, dSa/dt)² dt, with one slope per interval.
    pub rise_after_peak: f64,
    /// Square of the time by which CTD50 is below 120 ms.
    pub ctd50_low: f64,
    /// Square of the time by which CTD50 is above 420 ms.
    pub ctd50_high: f64,
    /// Square of the time by which CTD90 is below 220 ms.
    pub ctd90_low: f64,
    /// Square of the time by which CTD90 is above 785 ms.
    pub ctd90_high: f64,
}

impl Penalty {
    /// Sum of the terms.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.sa_res
            + self.negative_stress
            + self.rise_after_peak
            + self.ctd50_low
            + self.ctd50_high
            + self.ctd90_low
            + self.ctd90_high
    }
}

/// Penalty terms of the calcium transient's durations, which are known before any step.
pub fn calcium_penalty(ctd50: f64, ctd90: f64) -> Penalty {
    let squared = |x: f64| x.max(0.0).powi(2);
    Penalty {
        ctd50_low: squared(120.0 - ctd50),
        ctd50_high: squared(ctd50 - 420.0),
        ctd90_low: squared(220.0 - ctd90),
        ctd90_high: squared(ctd90 - 785.0),
        ..Penalty::default()
    }
}

/// Biomarkers and penalty of a beat on the 1 ms grid; calcium's part is filled in by the caller. Only samples of segments
/// whose bounds say that they can matter are computed, so that this costs a fraction of the whole grid.
pub fn of_segments(segments: &[Segment]) -> (CellReading, Penalty) {
    let Some(n) = segments.last().map(|s| s.end) else {
        return Default::default();
    };
    let grid = Grid { segments, n };
    let first = grid.sa(0, 0);
    let (peak, peak_at, top) = grid.peak();
    let (rise, rise_sum) = grid.rise_after(peak, peak_at);
    let (lowest, negative) = grid.negative(first);
    let durations = [0.7, 0.5, 0.1].map(|share| {
        if top > 0.0 {
            grid.duration(peak, peak_at, share * top)
        } else {
            (0.0, true)
        }
    });
    let [std30_ms, std50_ms, std90_ms] = durations.map(|(ms, _)| ms);
    let reading = CellReading {
        biomarkers: CellBiomarkers {
            sa_max_kpa: top,
            dsadt_max_kpa_per_ms: grid.fastest_rise(peak, peak_at),
            std30_ms,
            std50_ms,
            std90_ms,
            lambda_min: grid.shortest(),
        },
        t_sa_max_ms: peak as f64,
        cut: durations.map(|(_, cut)| cut),
        sa_res_kpa: first,
        sa_min_kpa: lowest,
        max_rise_after_peak_kpa_per_ms: rise,
        ctd50_ms: 0.0,
        ctd90_ms: 0.0,
    };
    let penalty = Penalty {
        sa_res: first * first,
        negative_stress: negative,
        rise_after_peak: rise_sum,
        ..Penalty::default()
    };
    (reading, penalty)
}

/// The samples of a beat, computed when asked for.
struct Grid<'a> {
    segments: &'a [Segment],
    n: usize,
}

impl Grid<'_> {
    /// Stress at sample `k`, which lies in segment `near` or in one next to it.
    fn sa(&self, k: usize, near: usize) -> f64 {
        let mut i = near;
        while i > 0 && k < self.segments[i].first {
            i -= 1;
        }
        while i + 1 < self.segments.len() && k >= self.segments[i].end {
            i += 1;
        }
        self.segments[i].sa().at(k)
    }

    /// All segments, the one with the largest `key` first: what it yields lets most of the others be passed over.
    fn from_largest<K: Fn(&Segment) -> f64>(
        segments: &[Segment],
        key: K,
    ) -> impl Iterator<Item = usize> + use<K> {
        let mut best = 0;
        for (i, segment) in segments.iter().enumerate() {
            if key(segment) > key(&segments[best]) {
                best = i;
            }
        }
        std::iter::once(best).chain(0..segments.len())
    }

    /// Largest sample: its number, its segment and its value.
    fn peak(&self) -> (usize, usize, f64) {
        let mut best = (0, 0, f64::NEG_INFINITY);
        for i in Self::from_largest(self.segments, |s| s.sa_high) {
            let segment = &self.segments[i];
            if segment.sa_high < best.2 {
                continue;
            }
            let stress = segment.sa();
            for k in segment.first..segment.end {
                let x = stress.at(k);
                if x > best.2 || (x == best.2 && k < best.0) {
                    best = (k, i, x);
                }
            }
        }
        best
    }

    /// Smallest stretch of all samples.
    fn shortest(&self) -> f64 {
        let mut best = f64::INFINITY;
        for i in Self::from_largest(self.segments, |s| -s.lambda_low) {
            let segment = &self.segments[i];
            if segment.lambda_low < best {
                let stretch = segment.lambda();
                best = (segment.first..segment.end)
                    .map(|k| stretch.at(k))
                    .fold(best, f64::min);
            }
        }
        best
    }

    /// Smallest stress, and ∫ min(0, Sa)² by trapezoids.
    fn negative(&self, first: f64) -> (f64, f64) {
        let (mut lowest, mut sum) = (first, 0.0);
        // A negative sample counts in the integral even where it is not the lowest.
        for i in Self::from_largest(self.segments, |s| -s.sa_low) {
            let segment = &self.segments[i];
            if segment.sa_low < lowest {
                let stress = segment.sa();
                lowest = (segment.first..segment.end)
                    .map(|k| stress.at(k))
                    .fold(lowest, f64::min);
            }
        }
        if lowest < 0.0 {
            for segment in self.segments.iter().filter(|s| s.sa_low < 0.0) {
                let stress = segment.sa();
                for k in segment.first..segment.end {
                    let weight = if k == 0 || k + 1 == self.n { 0.5 } else { 1.0 };
                    sum += weight * stress.at(k).min(0.0).powi(2);
                }
            }
        }
        (lowest, sum)
    }

    /// Whether the stress may rise faster than `rate` somewhere between the times `from` and `to`, around segment `i`.
    fn may_rise(&self, i: usize, from: f64, to: f64, rate: f64) -> bool {
        let before = self.segments[..i]
            .iter()
            .rev()
            .take_while(|s| s.to.t > from);
        let after = self.segments[i + 1..].iter().take_while(|s| s.from.t < to);
        self.segments[i].rise_high > rate || before.chain(after).any(|s| s.rise_high > rate)
    }

    /// Largest central difference before the peak \[kPa/ms\].
    fn fastest_rise(&self, peak: usize, peak_at: usize) -> f64 {
        let mut best = 0.0;
        for i in Self::from_largest(&self.segments[..=peak_at], |s| s.rise_high) {
            let segment = &self.segments[i];
            let (first, end) = (segment.first.max(1), segment.end.min(peak));
            if first >= end || !self.may_rise(i, first as f64 - 1.0, end as f64, best) {
                continue;
            }
            let stress = segment.sa();
            let (mut before, mut here) = (self.sa(first - 1, i), stress.at(first));
            for k in first..end {
                let next = if k + 1 < segment.end {
                    stress.at(k + 1)
                } else {
                    self.sa(k + 1, i)
                };
                best = f64::max(best, 0.5 * (next - before));
                (before, here) = (here, next);
            }
        }
        best
    }

    /// Steepest rise between two samples after the peak, and the sum of the squares of all of them.
    fn rise_after(&self, peak: usize, peak_at: usize) -> (f64, f64) {
        let (mut steepest, mut sum) = (0.0, 0.0);
        for (i, segment) in self.segments.iter().enumerate().skip(peak_at) {
            let first = segment.first.max(peak + 1);
            if first >= segment.end
                || !self.may_rise(i, first as f64 - 1.0, segment.end as f64, 0.0)
            {
                continue;
            }
            let stress = segment.sa();
            let mut before = self.sa(first - 1, i);
            for k in first..segment.end {
                let x = stress.at(k);
                let rise = (x - before).max(0.0);
                steepest = f64::max(steepest, rise);
                sum += rise * rise;
                before = x;
            }
        }
        (steepest, sum)
    }

    /// Time above `level` around the peak \[ms\], from the last upward crossing before it to the first downward one after it,
    /// and whether a crossing is missing.
    fn duration(&self, peak: usize, peak_at: usize, level: f64) -> (f64, bool) {
        let mut up = None;
        for (i, segment) in self.segments[..=peak_at]
            .iter()
            .enumerate()
            .rev()
            .filter(|(_, s)| s.sa_low < level)
        {
            let stress = segment.sa();
            let below = |k: usize| Some((k, stress.at(k))).filter(|&(_, x)| x < level);
            if let Some((k, x)) = (segment.first..segment.end.min(peak)).rev().find_map(below) {
                up = Some(k as f64 + (level - x) / (self.sa(k + 1, i) - x));
                break;
            }
        }
        let mut down = None;
        for (i, segment) in self
            .segments
            .iter()
            .enumerate()
            .skip(peak_at)
            .filter(|(_, s)| s.sa_low < level)
        {
            let stress = segment.sa();
            let below = |k: usize| Some((k, stress.at(k))).filter(|&(_, x)| x < level);
            if let Some((k, x)) = (segment.first.max(peak + 1)..segment.end).find_map(below) {
                down = Some(k as f64 - (level - x) / (self.sa(k - 1, i) - x));
                break;
            }
        }
        let end = (self.n - 1) as f64;
        (
            down.unwrap_or(end) - up.unwrap_or(0.0),
            up.is_none() || down.is_none(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::{Node, sample, segments};
    use proptest::prelude::*;

    /// The same from all samples, as the definitions say it.
    fn of_samples(sa: &[f64], lambda: &[f64]) -> (CellReading, Penalty) {
        let peak = (0..sa.len()).fold(0, |best, k| if sa[k] > sa[best] { k } else { best });
        let duration = |level: f64| {
            let cross = |a: usize, b: usize| {
                a as f64 + (level - sa[a]) / (sa[b] - sa[a]) * (b as f64 - a as f64)
            };
            let up = (0..peak)
                .rev()
                .find(|&k| sa[k] < level)
                .map(|k| cross(k, k + 1));
            let down = (peak + 1..sa.len())
                .find(|&k| sa[k] < level)
                .map(|k| cross(k, k - 1));
            let ms = down.unwrap_or((sa.len() - 1) as f64) - up.unwrap_or(0.0);
            (ms, up.is_none() || down.is_none())
        };
        let rises: Vec<f64> = sa[peak..]
            .windows(2)
            .map(|w| (w[1] - w[0]).max(0.0))
            .collect();
        let square = |k: usize| sa[k].min(0.0).powi(2);
        let durations = [0.7, 0.5, 0.1].map(|share| duration(share * sa[peak]));
        let reading = CellReading {
            biomarkers: CellBiomarkers {
                sa_max_kpa: sa[peak],
                dsadt_max_kpa_per_ms: (1..peak)
                    .map(|k| 0.5 * (sa[k + 1] - sa[k - 1]))
                    .fold(0.0, f64::max),
                std30_ms: durations[0].0,
                std50_ms: durations[1].0,
                std90_ms: durations[2].0,
                lambda_min: lambda.iter().copied().fold(f64::INFINITY, f64::min),
            },
            t_sa_max_ms: peak as f64,
            cut: durations.map(|(_, cut)| cut),
            sa_res_kpa: sa[0],
            sa_min_kpa: sa.iter().copied().fold(f64::INFINITY, f64::min),
            max_rise_after_peak_kpa_per_ms: rises.iter().copied().fold(0.0, f64::max),
            ..CellReading::default()
        };
        let penalty = Penalty {
            sa_res: sa[0] * sa[0],
            negative_stress: (1..sa.len())
                .map(|k| 0.5 * (square(k - 1) + square(k)))
                .sum(),
            rise_after_peak: rises.iter().map(|r| r * r).sum(),
            ..Penalty::default()
        };
        (reading, penalty)
    }

    #[test]
    fn penalty_terms_by_hand() {
        let nodes: Vec<Node> = [0.5, 4.0, 1.0, 3.0, -2.0]
            .into_iter()
            .enumerate()
            .map(|(k, sa)| Node {
                t: k as f64,
                sa,
                dsa: 0.0,
                l: 1.0,
                dl: 0.0,
            })
            .collect();
        let mut cut = Vec::new();
        segments(&nodes, nodes.len(), &mut cut);
        let (_, stress) = of_segments(&cut);
        let calcium = calcium_penalty(422.0, 210.0);
        assert_eq!(stress.sa_res, 0.25);
        assert_eq!(stress.rise_after_peak, 4.0);
        assert_eq!(stress.negative_stress, 2.0);
        assert_eq!((calcium.ctd50_low, calcium.ctd50_high), (0.0, 4.0));
        assert_eq!((calcium.ctd90_low, calcium.ctd90_high), (100.0, 0.0));
        assert_eq!(stress.total() + calcium.total(), 110.25);
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-10 * (1.0 + a.abs())
    }

    proptest! {
        #[test]
        fn bounds_pass_over_nothing_that_matters(
            steps in prop::collection::vec((0.05..25.0f64, -3.0..10.0f64, -1.0..1.0f64, 0.8..1.1f64, -0.01..0.01f64), 4..30),
        ) {
            let mut t = 0.0;
            let mut nodes = vec![Node { t, sa: 1.0, dsa: 0.1, l: 1.0, dl: 0.0 }];
            for (h, sa, dsa, l, dl) in steps {
                t += h;
                nodes.push(Node { t, sa, dsa, l, dl });
            }
            let n = t as usize + 1;
            let mut cut = Vec::new();
            segments(&nodes, n, &mut cut);
            let (mut sa, mut lambda) = (vec![f64::NAN; n], vec![f64::NAN; n]);
            sample(&cut, &mut sa, &mut lambda);
            prop_assert!(sa.iter().chain(&lambda).all(|x| x.is_finite()));
            let ((a, p), (b, q)) = (of_segments(&cut), of_samples(&sa, &lambda));
            prop_assume!(b.biomarkers.sa_max_kpa > 0.0);
            prop_assert_eq!(a.t_sa_max_ms, b.t_sa_max_ms);
            prop_assert_eq!(a.cut, b.cut);
            for (x, y) in std::iter::zip(a.biomarkers.values(), b.biomarkers.values()).chain([
                (a.sa_res_kpa, b.sa_res_kpa),
                (a.sa_min_kpa, b.sa_min_kpa),
                (a.max_rise_after_peak_kpa_per_ms, b.max_rise_after_peak_kpa_per_ms),
                (p.sa_res, q.sa_res),
                (p.negative_stress, q.negative_stress),
                (p.rise_after_peak, q.rise_after_peak),
            ]) {
                prop_assert!(close(x, y), "{} is not {}", x, y);
            }
        }
    }
}
