//! Median over nodes of active stress, calcium and stretch, aligned by activation time: the targets of step 2 (Jung 2022, 2.3.1),
//! and how the nodes spread around it (Figure 2).

use std::collections::VecDeque;

use crate::beat::BeatTraces;
use cardiotwin_signals::StressReading;
use cardiotwin_vocabulary::biomarkers::CellBiomarkers;
use serde::{Deserialize, Serialize};

/// Median traces on the beat's interval from activation on, cut to the shortest node's.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MedianTraces {
    /// Time since activation \[ms\].
    pub time_ms: Vec<f64>,
    /// Median active stress \[kPa\].
    pub sa_kpa: Vec<f64>,
    /// Median calcium \[µM\]; zero where the contraction model has none.
    pub ca_um: Vec<f64>,
    /// Median fibre stretch, dimensionless.
    pub lambda: Vec<f64>,
}

/// Shares of the wall below the values of a [`NodalSpread`].
pub const LEVELS: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// Spread of the nodes' traces: at each time since activation, the values below which the shares
/// [`LEVELS`] of the wall lie.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodalSpread {
    /// Time since activation \[ms\].
    pub time_ms: Vec<f64>,
    /// Levels of the active stress \[kPa\].
    pub sa_kpa: Vec<[f64; 5]>,
    /// Levels of calcium \[µM\]; zero where the contraction model has none.
    pub ca_um: Vec<[f64; 5]>,
    /// Levels of the fibre stretch, dimensionless.
    pub lambda: Vec<[f64; 5]>,
}

impl NodalSpread {
    /// Spread of a beat's nodal traces, each node with its weight; between samples the nodes'
    /// traces are linear. `None` when the beat has no nodal traces, or a node is activated after
    /// the beat's end.
    #[must_use]
    pub fn of(beat: &BeatTraces) -> Option<Self> {
        let nodes = beat.nodes.as_ref()?;
        let mut growing =
            GrowingSpread::new(nodes.activation_ms.clone(), nodes.weights.clone(), true);
        for (k, time_ms) in beat.time_ms.iter().enumerate() {
            let of = |trace: &[f64]| trace[k * nodes.n_nodes..(k + 1) * nodes.n_nodes].to_vec();
            growing.add(
                *time_ms,
                [of(&nodes.sa_kpa), of(&nodes.ca_um), of(&nodes.lambda)].concat(),
            );
        }
        growing.finish()
    }

    /// Medians without the other levels.
    #[must_use]
    pub fn median(&self) -> MedianTraces {
        let middle = |values: &[[f64; 5]]| values.iter().map(|v| v[2]).collect();
        MedianTraces {
            time_ms: self.time_ms.clone(),
            sa_kpa: middle(&self.sa_kpa),
            ca_um: middle(&self.ca_um),
            lambda: middle(&self.lambda),
        }
    }
}

impl MedianTraces {
    /// Medians of a beat's nodal traces: see [`NodalSpread::of`].
    #[must_use]
    pub fn of(beat: &BeatTraces) -> Option<Self> {
        NodalSpread::of(beat).map(|spread| spread.median())
    }

    /// Biomarkers of the median traces.
    #[must_use]
    pub fn biomarkers(&self) -> Option<CellBiomarkers> {
        let reading = StressReading::of(&self.time_ms, &self.sa_kpa, &self.lambda).ok()?;
        Some(reading.biomarkers)
    }
}

/// A [`NodalSpread`] that grows sample by sample of the beat. It holds as many samples as lie between the first and the last
/// activation: those of a large mesh do not fit memory.
#[derive(Debug)]
pub struct GrowingSpread {
    activation_ms: Vec<f64>,
    weights: Vec<f64>,
    with_calcium: bool,
    earliest_ms: f64,
    latest_ms: f64,
    /// Samples that are still needed, with their times.
    held: VecDeque<(f64, Vec<f64>)>,
    /// Index in the beat of the first sample that is held.
    first: usize,
    start_ms: f64,
    interval_ms: f64,
    found: NodalSpread,
}

impl GrowingSpread {
    /// A spread of nodes that are activated at these times \[ms\], with their weights; samples have
    /// calcium or not.
    #[must_use]
    pub fn new(activation_ms: Vec<f64>, weights: Vec<f64>, with_calcium: bool) -> Self {
        let latest_ms = activation_ms
            .iter()
            .fold(0.0, |latest: f64, t| latest.max(*t));
        let earliest_ms = activation_ms
            .iter()
            .fold(latest_ms, |earliest, t| earliest.min(*t));
        Self {
            activation_ms,
            weights,
            with_calcium,
            earliest_ms,
            latest_ms,
            held: VecDeque::new(),
            first: 0,
            start_ms: 0.0,
            interval_ms: 0.0,
            found: NodalSpread::default(),
        }
    }

    /// Adds the next sample: active stress \[kPa\], calcium \[µM\] where samples have it, and stretch of all nodes.
    pub fn add(&mut self, time_ms: f64, values: Vec<f64>) {
        match self.first + self.held.len() {
            0 => self.start_ms = time_ms,
            1 => self.interval_ms = time_ms - self.start_ms,
            _ => {}
        }
        self.held.push_back((time_ms, values));
        let newest = self.first + self.held.len() - 1;
        if self.is_empty() {
            return;
        }
        // What lies between samples that are here, whatever follows.
        while self.before(self.next_ms() + self.latest_ms) < newest {
            self.append(newest);
        }
        while self.held.len() > 2 && self.first < self.before(self.next_ms() + self.earliest_ms) {
            self.held.pop_front();
            self.first += 1;
        }
    }

    /// All of it; `None` without a node or two samples, or when a node is activated after the last one.
    #[must_use]
    pub fn finish(mut self) -> Option<NodalSpread> {
        let newest = (self.first + self.held.len()).checked_sub(2)? + 1;
        let n = ((self.held.back()?.0 - self.latest_ms) / self.interval_ms + 1e-9).floor();
        if n < 0.0 || self.is_empty() {
            return None;
        }
        while self.found.time_ms.len() <= n as usize {
            self.append(newest);
        }
        Some(self.found)
    }

    /// Whether there is no node, or no interval between samples.
    fn is_empty(&self) -> bool {
        self.interval_ms <= 0.0 || self.activation_ms.is_empty()
    }

    /// Time since activation of what comes next.
    fn next_ms(&self) -> f64 {
        self.found.time_ms.len() as f64 * self.interval_ms
    }

    /// The sample before a time: the interval is constant, but for the last one.
    fn before(&self, time_ms: f64) -> usize {
        (time_ms / self.interval_ms) as usize
    }

    /// Appends what comes next, with `newest` the last sample that is held.
    fn append(&mut self, newest: usize) {
        let (t, n_nodes) = (self.next_ms(), self.activation_ms.len());
        let mut values = Vec::with_capacity(n_nodes);
        let mut quantiles = |quantity: usize| {
            values.clear();
            values.extend(
                self.activation_ms
                    .iter()
                    .zip(&self.weights)
                    .enumerate()
                    .map(|(i, (t_a, weight))| {
                        let at = t + t_a;
                        let k = self.before(at).min(newest - 1) - self.first;
                        let ((begin_ms, from), (end_ms, to)) = (&self.held[k], &self.held[k + 1]);
                        let share = ((at - begin_ms) / (end_ms - begin_ms)).clamp(0.0, 1.0);
                        let (from, to) = (from[quantity * n_nodes + i], to[quantity * n_nodes + i]);
                        (from + share * (to - from), *weight)
                    }),
            );
            weighted_quantiles(&mut values)
        };
        let stress = quantiles(0);
        let calcium = if self.with_calcium {
            quantiles(1)
        } else {
            [0.0; 5]
        };
        let stretch = quantiles(if self.with_calcium { 2 } else { 1 });
        self.found.sa_kpa.push(stress);
        self.found.ca_um.push(calcium);
        self.found.lambda.push(stretch);
        self.found.time_ms.push(t);
    }
}

/// Values at which the weights below are the shares [`LEVELS`], linear between values.
fn weighted_quantiles(values: &mut [(f64, f64)]) -> [f64; 5] {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total = values.iter().map(|v| v.1).sum::<f64>();
    LEVELS.map(|level| quantile(values, level * total))
}

/// Value at which the weights of sorted values sum to `wanted`.
fn quantile(sorted: &[(f64, f64)], wanted: f64) -> f64 {
    // Each value stands at the middle of its weight: equal weights give the ordinary median.
    let (mut below, mut previous) = (0.0, None);
    for &(value, weight) in sorted {
        let position = below + 0.5 * weight;
        if position >= wanted {
            return match previous {
                Some((earlier_position, earlier)) if position > earlier_position => {
                    earlier
                        + (wanted - earlier_position) / (position - earlier_position)
                            * (value - earlier)
                }
                _ => value,
            };
        }
        previous = Some((position, value));
        below += weight;
    }
    previous.map_or(f64::NAN, |(_, value)| value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beat::NodalTraces;

    #[test]
    fn equal_weights_give_the_ordinary_median() {
        let equal = |values: &[f64]| {
            let mut pairs: Vec<(f64, f64)> = values
                .iter()
                .map(|v| (*v, 1.0 / values.len() as f64))
                .collect();
            weighted_quantiles(&mut pairs)[2]
        };
        assert!((equal(&[3.0, 1.0, 2.0]) - 2.0).abs() < 1e-12);
        assert!((equal(&[4.0, 1.0, 2.0, 3.0]) - 2.5).abs() < 1e-12);
        assert_eq!(equal(&[7.0]), 7.0);
        let skewed = weighted_quantiles(&mut [(1.0, 0.8), (9.0, 0.1), (10.0, 0.1)])[2];
        assert!((skewed - (1.0 + 8.0 * 0.1 / 0.45)).abs() < 1e-12);
    }

    #[test]
    fn quantiles_of_even_values_are_their_shares_and_ends_hold() {
        let mut values: Vec<(f64, f64)> = (0..1000).map(|k| (f64::from(k) + 0.5, 1.0)).collect();
        let found = weighted_quantiles(&mut values);
        for (level, value) in LEVELS.iter().zip(found) {
            assert!((value - 1000.0 * level).abs() < 1e-9, "{level} {value}");
        }
        assert_eq!(
            weighted_quantiles(&mut [(2.0, 0.5), (1.0, 0.5)]),
            [1.0, 1.0, 1.5, 2.0, 2.0]
        );
    }

    #[test]
    fn delayed_copies_of_one_trace_have_it_as_median() {
        let activation_ms = vec![0.0, 3.5, 8.0];
        let shape = |s: f64| if s > 0.0 { 2.0 * s } else { 0.0 };
        let time_ms: Vec<f64> = (0..=50).map(f64::from).collect();
        let sa_kpa = time_ms
            .iter()
            .flat_map(|t| {
                activation_ms
                    .iter()
                    .map(|t_a| shape(t - t_a))
                    .collect::<Vec<_>>()
            })
            .collect();
        let n = time_ms.len() * 3;
        let nodes = NodalTraces {
            n_nodes: 3,
            activation_ms: activation_ms.clone(),
            weights: vec![1.0 / 3.0; 3],
            sa_kpa,
            ca_um: vec![0.0; n],
            lambda: vec![1.0; n],
        };
        let traces = BeatTraces {
            time_ms,
            nodes: Some(nodes),
            ..Default::default()
        };
        let median = MedianTraces::of(&traces).unwrap();
        assert_eq!(median.time_ms.len(), 43, "cut to the last activated node");
        for (t, sa) in median.time_ms.iter().zip(&median.sa_kpa) {
            assert!((sa - shape(*t)).abs() < 1e-12, "{t} {sa}");
        }
    }

    #[test]
    fn few_samples_are_held_at_a_time_and_the_last_interval_may_be_short() {
        let activation_ms = vec![2.0, 9.5, 4.0, 7.25];
        let weights = vec![0.1, 0.4, 0.3, 0.2];
        let mut time_ms: Vec<f64> = (0..200).map(|k| 0.5 * f64::from(k)).collect();
        time_ms.push(99.8);
        let value = |t: f64, i: usize| (0.1 * t).sin() + i as f64 * (0.05 * t).cos();
        let mut growing = GrowingSpread::new(activation_ms.clone(), weights.clone(), false);
        for t in &time_ms {
            let row = (0..4)
                .map(|i| value(*t, i))
                .chain((0..4).map(|i| -value(*t, i)))
                .collect();
            growing.add(*t, row);
            // 7.5 ms between the activations.
            assert!(growing.held.len() <= 15 + 3, "{}", growing.held.len());
        }
        let found = growing.finish().expect("a spread");
        assert_eq!((found.time_ms.len(), found.time_ms[180]), (181, 90.0));
        for (k, t) in found.time_ms.iter().enumerate() {
            // As it is with all samples at hand.
            let mut values: Vec<(f64, f64)> = (0..4)
                .map(|i| {
                    let at = t + activation_ms[i];
                    let k = ((at / 0.5) as usize).min(time_ms.len() - 2);
                    let share = ((at - time_ms[k]) / (time_ms[k + 1] - time_ms[k])).clamp(0.0, 1.0);
                    let (from, to) = (value(time_ms[k], i), value(time_ms[k + 1], i));
                    (from + share * (to - from), weights[i])
                })
                .collect();
            assert_eq!(
                found.sa_kpa[k],
                weighted_quantiles(&mut values),
                "at {t} ms"
            );
            assert_eq!(found.ca_um[k], [0.0; 5]);
            assert!((found.lambda[k][2] + found.sa_kpa[k][2]).abs() < 1e-12);
        }
        let mut late = GrowingSpread::new(vec![50.0], vec![1.0], true);
        (0..3).for_each(|k| late.add(f64::from(k), vec![0.0; 3]));
        assert_eq!(late.finish(), None);
    }

    #[test]
    fn without_nodes_there_is_no_median() {
        assert_eq!(MedianTraces::of(&BeatTraces::default()), None);
    }
}
