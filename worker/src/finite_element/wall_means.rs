//! Active stress and stretch of the wall over a beat, their means and the stretch's pattern over the
//! wall, from which the organ's law is learned.

use cardiotwin_models::beat::BeatTraces;
use cardiotwin_schemas::organ_law::{LawSamples, N_LAW_SAMPLES};

/// Means at every sample of the traces so far.
#[derive(Debug, Default)]
pub struct WallMeans {
    stress_kpa: Vec<f64>,
    stretch: Vec<f64>,
}

impl WallMeans {
    /// Adds the next sample.
    ///
    /// - `stress_kpa`, `stretch`, `weights`: one value for each node; the weights sum to one
    pub fn add(&mut self, stress_kpa: &[f64], stretch: &[f64], weights: &[f64]) {
        let mean = |values: &[f64]| values.iter().zip(weights).map(|(x, w)| x * w).sum();
        self.stress_kpa.push(mean(stress_kpa));
        self.stretch.push(mean(stretch));
    }

    /// Number of the sample with the greatest stress.
    fn strongest(&self) -> usize {
        (0..self.stress_kpa.len())
            .max_by(|a, b| self.stress_kpa[*a].total_cmp(&self.stress_kpa[*b]))
            .unwrap_or(0)
    }

    /// Samples of the beat, linear between those of its traces.
    ///
    /// - `weights`: one value for each node, summing to one
    /// - `rows`: stress \[kPa\] and stretch of all nodes at a sample of the traces
    ///
    /// # Errors
    /// That of `rows`.
    pub fn samples<E>(
        &self,
        traces: &BeatTraces,
        cycle_length_ms: f64,
        weights: &[f64],
        mut rows: impl FnMut(usize) -> Result<[Vec<f64>; 2], E>,
    ) -> Result<LawSamples, E> {
        let places: Vec<Place> = (0..N_LAW_SAMPLES)
            .map(|k| {
                let time_ms = k as f64 * cycle_length_ms / N_LAW_SAMPLES as f64;
                place(&traces.time_ms, time_ms)
            })
            .collect();
        let sampled = |values: &[f64]| places.iter().map(|at| at.value(values)).collect();
        let pattern = Pattern::of(&rows(self.strongest())?[1], weights);
        let mut deviation = || -> Result<_, E> {
            let (mut of_stress, mut of_stretch) = (Vec::new(), Vec::new());
            for at in &places {
                let mut both = rows(at.sample)?.map(|field| pattern.share(&field));
                if at.share > 0.0 {
                    let next = rows(at.sample + 1)?.map(|field| pattern.share(&field));
                    both = std::array::from_fn(|i| both[i] + at.share * (next[i] - both[i]));
                }
                of_stress.push(both[0]);
                of_stretch.push(both[1]);
            }
            Ok((of_stress, of_stretch))
        };
        let (stress_deviation_kpa, stretch_deviation) = deviation()?;
        Ok(LawSamples {
            pressure_mmhg: sampled(&traces.pressure_mmhg),
            volume_ml: sampled(&traces.volume_ml),
            active_stress_kpa: sampled(&self.stress_kpa),
            stretch: sampled(&self.stretch),
            stretch_deviation,
            stress_deviation_kpa,
        })
    }
}

/// Pattern of the stretch over the wall: mean zero, mean square one.
struct Pattern {
    /// Value at each node times its weight.
    weighted: Vec<f64>,
}

impl Pattern {
    /// Pattern of a stretch. Without differences it is zero.
    fn of(stretch: &[f64], weights: &[f64]) -> Self {
        let mean: f64 = stretch.iter().zip(weights).map(|(x, w)| x * w).sum();
        let square: f64 = stretch
            .iter()
            .zip(weights)
            .map(|(x, w)| w * (x - mean).powi(2))
            .sum();
        let scale = if square > 0.0 {
            square.sqrt().recip()
        } else {
            0.0
        };
        let weighted = stretch
            .iter()
            .zip(weights)
            .map(|(x, w)| w * scale * (x - mean))
            .collect();
        Self { weighted }
    }

    /// Share of the pattern in values at the nodes.
    fn share(&self, values: &[f64]) -> f64 {
        self.weighted.iter().zip(values).map(|(p, x)| p * x).sum()
    }
}

/// Place of a time between two samples of the traces.
#[derive(Debug, Clone, Copy)]
struct Place {
    sample: usize,
    /// Share of the next sample.
    share: f64,
}

impl Place {
    fn value(self, values: &[f64]) -> f64 {
        let value = values[self.sample];
        if self.share > 0.0 {
            value + self.share * (values[self.sample + 1] - value)
        } else {
            value
        }
    }
}

/// Value at a time, linear between samples and constant beyond them.
///
/// - `values`: one value for each time, at least one
pub fn interpolated(time_ms: &[f64], values: &[f64], at_ms: f64) -> f64 {
    place(time_ms, at_ms).value(values)
}

/// Place of a time, at an end of the traces beyond it.
fn place(time_ms: &[f64], at_ms: f64) -> Place {
    let next = time_ms.partition_point(|t| *t <= at_ms);
    let Some(sample) = next.checked_sub(1) else {
        return Place {
            sample: 0,
            share: 0.0,
        };
    };
    let share = time_ms.get(next).map_or(0.0, |end| {
        (at_ms - time_ms[sample]) / (end - time_ms[sample])
    });
    Place { sample, share }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_weighted_means_at_equal_times() {
        let time_ms: Vec<f64> = (0..=160).map(f64::from).collect();
        let mut means = WallMeans::default();
        for t in &time_ms {
            means.add(&[*t, 3.0 * t], &[1.0, 1.1], &[0.75, 0.25]);
        }
        let traces = BeatTraces {
            pressure_mmhg: time_ms.iter().map(|t| 2.0 * t).collect(),
            volume_ml: time_ms.iter().map(|t| 100.0 - t).collect(),
            time_ms,
            ..BeatTraces::default()
        };
        let rows = |k: usize| {
            let t = k as f64;
            // The pattern is that of the last sample, where the stress is greatest.
            Ok::<_, std::convert::Infallible>([vec![t, 3.0 * t], vec![1.0, 1.1 - 0.001 * t]])
        };
        let Ok(samples) = means.samples(&traces, 160.0, &[0.75, 0.25], rows);
        assert_eq!(samples.active_stress_kpa.len(), N_LAW_SAMPLES);
        assert!((samples.active_stress_kpa[5] - 15.0).abs() < 1e-12);
        assert!((samples.stretch[79] - 1.025).abs() < 1e-12);
        assert_eq!(
            (samples.pressure_mmhg[10], samples.volume_ml[10]),
            (40.0, 80.0)
        );
        // At the last sample the second node is the shorter one; before t = 100 ms it is longer.
        let sd = |difference: f64| difference * (0.75f64 * 0.25).sqrt();
        assert!((samples.stretch_deviation[5] - sd(-0.09)).abs() < 1e-12);
        assert!((samples.stretch_deviation[79] - sd(0.058)).abs() < 1e-12);
        assert!((samples.stress_deviation_kpa[5] - sd(-20.0)).abs() < 1e-12);
    }
}
