//! Samples of an external solver's beat from which the organ's law is learned.

use std::convert::Infallible;

use cardiotwin_models::beat::{BeatTraces, NodalTraces};
use cardiotwin_schemas::organ_law::LawSamples;

use crate::finite_element::wall_means::{WallMeans, interpolated};

/// Samples of a beat, linear between those of its traces; `None` without nodal traces.
///
/// - `time_ms`: times of the nodal traces, which may differ from those of the cavity's
pub(super) fn samples(
    traces: &BeatTraces,
    time_ms: &[f64],
    nodes: &NodalTraces,
    cycle_length_ms: f64,
) -> Option<LawSamples> {
    let sum: f64 = nodes.weights.iter().sum();
    if time_ms.is_empty() || traces.time_ms.is_empty() || sum <= 0.0 {
        return None;
    }
    let weights: Vec<f64> = nodes.weights.iter().map(|weight| weight / sum).collect();
    let at_nodal_times = |values: &[f64]| -> Vec<f64> {
        let value = |at: &f64| interpolated(&traces.time_ms, values, *at);
        time_ms.iter().map(value).collect()
    };
    let traces = BeatTraces {
        time_ms: time_ms.to_vec(),
        pressure_mmhg: at_nodal_times(&traces.pressure_mmhg),
        volume_ml: at_nodal_times(&traces.volume_ml),
        ..BeatTraces::default()
    };
    let row = |values: &[f64], k: usize| values[k * nodes.n_nodes..][..nodes.n_nodes].to_vec();
    let rows = |k: usize| [row(&nodes.sa_kpa, k), row(&nodes.lambda, k)];
    let mut means = WallMeans::default();
    for k in 0..time_ms.len() {
        let [stress, stretch] = rows(k);
        means.add(&stress, &stretch, &weights);
    }
    let Ok(samples) = means.samples(&traces, cycle_length_ms, &weights, |k| {
        Ok::<_, Infallible>(rows(k))
    });
    Some(samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_schemas::organ_law::N_LAW_SAMPLES;

    #[test]
    fn nodal_traces_at_other_times_and_weights_of_any_sum_give_means_over_the_wall() {
        let time_ms: Vec<f64> = (0..=40).map(|k| 20.0 * f64::from(k)).collect();
        let traces = BeatTraces {
            pressure_mmhg: time_ms.iter().map(|t| 0.1 * t).collect(),
            volume_ml: time_ms.iter().map(|t| 200.0 - 0.1 * t).collect(),
            time_ms,
            ..BeatTraces::default()
        };
        // Every 5 ms up to 800 ms; the second node has three times the stress and shortens.
        let nodal_ms: Vec<f64> = (0..=160).map(|k| 5.0 * f64::from(k)).collect();
        let nodes = NodalTraces {
            n_nodes: 2,
            activation_ms: vec![0.0, 10.0],
            weights: vec![6.0, 2.0],
            sa_kpa: nodal_ms.iter().flat_map(|t| [0.1 * t, 0.3 * t]).collect(),
            ca_um: vec![0.0; 2 * nodal_ms.len()],
            lambda: nodal_ms
                .iter()
                .flat_map(|t| [1.1, 1.1 - 1e-4 * t])
                .collect(),
        };
        let found = samples(&traces, &nodal_ms, &nodes, 800.0).expect("samples");
        for k in 0..N_LAW_SAMPLES {
            let t = 10.0 * k as f64;
            assert!((found.pressure_mmhg[k] - 0.1 * t).abs() < 1e-9);
            assert!((found.volume_ml[k] - 200.0 + 0.1 * t).abs() < 1e-9);
            assert!((found.active_stress_kpa[k] - 0.15 * t).abs() < 1e-9);
            assert!((found.stretch[k] - 1.1 + 0.25e-4 * t).abs() < 1e-12);
            // Two nodes: the deviation is their difference times √(¾ · ¼), signed as at the end.
            let share = (0.75f64 * 0.25).sqrt();
            assert!((found.stretch_deviation[k] - share * 1e-4 * t).abs() < 1e-12);
            assert!((found.stress_deviation_kpa[k] + share * 0.2 * t).abs() < 1e-9);
        }
        let without = NodalTraces::default();
        assert_eq!(samples(&traces, &[], &without, 800.0), None);
    }
}
