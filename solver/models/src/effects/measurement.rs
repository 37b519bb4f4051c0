//! Measurement of the heart: periodic traces, and terms that change them.

use serde::Serialize;

/// Pressure and volume of a periodic beat, sampled uniformly: sample `i` of `n` is at `i · T/n`,
/// and sample `n` would equal sample `0`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PeriodicTraces {
    /// Cycle length T, the period of the traces \[ms\].
    pub cycle_length_ms: f64,
    /// Pressure in the cavity \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Volume of the cavity \[mL\].
    pub volume_ml: Vec<f64>,
}

impl PeriodicTraces {
    /// Time between samples \[ms\].
    #[must_use]
    pub fn spacing_ms(&self) -> f64 {
        self.cycle_length_ms / self.pressure_mmhg.len() as f64
    }

    /// Pressure at any times \[ms\].
    #[must_use]
    pub fn pressures_at(&self, times_ms: &[f64]) -> Vec<f64> {
        times_ms
            .iter()
            .map(|t| interpolate(&self.pressure_mmhg, t / self.spacing_ms()))
            .collect()
    }

    /// Volume at any times \[ms\].
    #[must_use]
    pub fn volumes_at(&self, times_ms: &[f64]) -> Vec<f64> {
        times_ms
            .iter()
            .map(|t| interpolate(&self.volume_ml, t / self.spacing_ms()))
            .collect()
    }
}

/// Value of periodic samples at a fractional index, by linear interpolation.
#[must_use]
pub fn interpolate(samples: &[f64], position: f64) -> f64 {
    let n = samples.len();
    let below = position.floor();
    let share = position - below;
    let idx = below.rem_euclid(n as f64) as usize % n;
    samples[idx] + share * (samples[(idx + 1) % n] - samples[idx])
}

/// Delays periodic samples by `lag` samples: `out[i] = samples(i − lag)`.
pub(super) fn delay(samples: &mut [f64], lag: f64) {
    let before = samples.to_vec();
    for (i, out) in samples.iter_mut().enumerate() {
        *out = interpolate(&before, i as f64 - lag);
    }
}

/// One term of a measurement.
pub trait MeasurementTerm: std::fmt::Debug + Send + Sync {
    /// Changes the traces as the measurement does.
    fn apply(&self, traces: &mut PeriodicTraces);

    /// Inverts the change as far as noise allows: measured traces become those of the heart.
    fn remove(&self, traces: &mut PeriodicTraces);
}

/// The terms of a measurement, in order; none in the base model.
#[derive(Debug, Default)]
pub struct Measurement {
    terms: Vec<Box<dyn MeasurementTerm>>,
}

impl Measurement {
    /// Adds a term after the others.
    pub fn push(&mut self, term: Box<dyn MeasurementTerm>) {
        self.terms.push(term);
    }

    /// Whether the data equal the heart's traces.
    #[must_use]
    pub fn is_faithful(&self) -> bool {
        self.terms.is_empty()
    }

    /// Converts the heart's traces to measured ones.
    pub fn apply(&self, traces: &mut PeriodicTraces) {
        for term in &self.terms {
            term.apply(traces);
        }
    }

    /// Converts measured traces to those of the heart, the last term first.
    pub fn remove(&self, traces: &mut PeriodicTraces) {
        for term in self.terms.iter().rev() {
            term.remove(traces);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn periodic_interpolation_wraps_and_hits_samples(shift in -3i32..3, idx in 0usize..50) {
            let samples: Vec<f64> = (0..50).map(|i| f64::from(i * i)).collect();
            let at = |x: f64| interpolate(&samples, x + 50.0 * f64::from(shift));
            prop_assert!((at(idx as f64) - samples[idx]).abs() < 1e-9);
            prop_assert!((at(idx as f64 + 0.5) - 0.5 * (samples[idx] + samples[(idx + 1) % 50])).abs() < 1e-9);
        }
    }

    #[test]
    fn a_whole_delay_is_a_rotation() {
        let mut samples: Vec<f64> = (0..10).map(f64::from).collect();
        delay(&mut samples, 3.0);
        assert_eq!(samples, [7.0, 8.0, 9.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        delay(&mut samples, -3.0);
        assert_eq!(samples[0], 0.0);
    }
}
