//! Median over nodes of active stress, calcium and stretch, aligned by activation time: the targets of step 2 (Jung 2022, 2.3.1),
//! and how the nodes spread around it (Figure 2).

use crate::beat::BeatTraces;
use crate::cell0d::ActiveStressBiomarkers;
use crate::cell0d::biomarkers::active_stress_biomarkers;
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
    /// Median fibre stretch.
    pub lambda: Vec<f64>,
}

/// Shares of the wall below the values of a [`NodalSpread`].
pub const LEVELS: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// How the nodes' traces spread: at each time since activation the values below which the shares [`LEVELS`] of the wall lie.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodalSpread {
    /// Time since activation \[ms\].
    pub time_ms: Vec<f64>,
    /// Active stress \[kPa\].
    pub sa_kpa: Vec<[f64; 5]>,
    /// Calcium \[µM\]; zero where the contraction model has none.
    pub ca_um: Vec<[f64; 5]>,
    /// Fibre stretch.
    pub lambda: Vec<[f64; 5]>,
}

impl NodalSpread {
    /// Of a beat's nodal traces, each node with its weight; between samples the nodes' traces are linear. `None` when the
    /// beat has no nodal traces, or a node is activated after the beat's end.
    #[must_use]
    pub fn of(beat: &BeatTraces) -> Option<Self> {
        let nodes = beat.nodes.as_ref()?;
        let last = *beat.time_ms.last()?;
        let interval = beat.time_ms.get(1)? - beat.time_ms[0];
        let latest = nodes.activation_ms.iter().fold(0.0, |latest: f64, t| latest.max(*t));
        let n = ((last - latest) / interval + 1e-9).floor();
        if n < 0.0 || nodes.n_nodes == 0 {
            return None;
        }
        let time_ms: Vec<f64> = (0..=n as usize).map(|k| k as f64 * interval).collect();
        let spread = |trace: &[f64]| -> Vec<[f64; 5]> {
            let mut values = Vec::with_capacity(nodes.n_nodes);
            time_ms
                .iter()
                .map(|t| {
                    values.clear();
                    let aligned = nodes.activation_ms.iter().zip(&nodes.weights).enumerate();
                    values.extend(aligned.map(|(i, (t_a, weight))| {
                        (sample(&beat.time_ms, interval, |k| trace[k * nodes.n_nodes + i], t + t_a), *weight)
                    }));
                    weighted_quantiles(&mut values)
                })
                .collect()
        };
        Some(Self {
            sa_kpa: spread(&nodes.sa_kpa),
            ca_um: spread(&nodes.ca_um),
            lambda: spread(&nodes.lambda),
            time_ms,
        })
    }

    /// The medians alone.
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

    /// Biomarkers of the median traces; as targets, [`crate::cell0d::CellTargets::from`] of these.
    #[must_use]
    pub fn biomarkers(&self) -> Option<ActiveStressBiomarkers> {
        active_stress_biomarkers(&self.time_ms, &self.sa_kpa, &self.lambda)
    }
}

/// Linear interpolation on the beat's grid: a constant interval, but for the last sample.
fn sample(time_ms: &[f64], interval: f64, value: impl Fn(usize) -> f64, t: f64) -> f64 {
    let last = time_ms.len() - 1;
    let k = ((t / interval) as usize).min(last.saturating_sub(1));
    let share = ((t - time_ms[k]) / (time_ms[k + 1] - time_ms[k])).clamp(0.0, 1.0);
    value(k) + share * (value(k + 1) - value(k))
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
                    earlier + (wanted - earlier_position) / (position - earlier_position) * (value - earlier)
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
            let mut pairs: Vec<(f64, f64)> = values.iter().map(|v| (*v, 1.0 / values.len() as f64)).collect();
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
        assert_eq!(weighted_quantiles(&mut [(2.0, 0.5), (1.0, 0.5)]), [1.0, 1.0, 1.5, 2.0, 2.0]);
    }

    #[test]
    fn delayed_copies_of_one_trace_have_it_as_median() {
        let activation_ms = vec![0.0, 3.5, 8.0];
        let shape = |s: f64| if s > 0.0 { 2.0 * s } else { 0.0 };
        let time_ms: Vec<f64> = (0..=50).map(f64::from).collect();
        let sa_kpa =
            time_ms.iter().flat_map(|t| activation_ms.iter().map(|t_a| shape(t - t_a)).collect::<Vec<_>>()).collect();
        let n = time_ms.len() * 3;
        let nodes = NodalTraces {
            n_nodes: 3,
            activation_ms: activation_ms.clone(),
            weights: vec![1.0 / 3.0; 3],
            sa_kpa,
            ca_um: vec![0.0; n],
            lambda: vec![1.0; n],
        };
        let traces = BeatTraces { time_ms, nodes: Some(nodes), ..Default::default() };
        let median = MedianTraces::of(&traces).unwrap();
        assert_eq!(median.time_ms.len(), 43, "cut to the last activated node");
        for (t, sa) in median.time_ms.iter().zip(&median.sa_kpa) {
            assert!((sa - shape(*t)).abs() < 1e-12, "{t} {sa}");
        }
    }

    #[test]
    fn without_nodes_there_is_no_median() {
        assert_eq!(MedianTraces::of(&BeatTraces::default()), None);
    }
}
