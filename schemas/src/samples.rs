//! Samples of a beat's pressure and volume at a few times, for the comparison of traces in step 3.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Number of samples of a beat, equally spaced from its start.
pub const N_SAMPLES: usize = 40;

/// Values at the times k T / 40, where T is the cycle length. A list is empty if there is no trace.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BeatSamples {
    /// Pressure in the ventricle's cavity.
    #[serde(
        rename = "pressure_mmHg",
        default,
        skip_serializing_if = "Vec::is_empty"
    )]
    pub pressure_mmhg: Vec<f64>,
    /// Volume of the ventricle's cavity.
    #[serde(rename = "volume_mL", default, skip_serializing_if = "Vec::is_empty")]
    pub volume_ml: Vec<f64>,
}

/// Standard deviations of the difference between a model's traces and the measured ones. 0 if a
/// trace does not count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TraceDeviations {
    /// Standard deviation of the pressure.
    #[serde(rename = "pressure_mmHg")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e3))]
    pub pressure_mmhg: f64,
    /// Standard deviation of the volume.
    #[serde(rename = "volume_mL")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e3))]
    pub volume_ml: f64,
    /// Correlation time of the difference. The cycle length divided by it is the number of
    /// independent values in a trace.
    #[schemars(extend("minimum" = 1.0, "maximum" = 1e4))]
    pub correlation_ms: f64,
}

impl Default for TraceDeviations {
    fn default() -> Self {
        Self {
            pressure_mmhg: 3.0,
            volume_ml: 3.0,
            correlation_ms: 100.0,
        }
    }
}

/// Measured traces as used in step 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct MeasuredTraces {
    /// Measured values.
    pub samples: BeatSamples,
    /// Standard deviations of the difference between a beat and the measured traces.
    pub deviations: TraceDeviations,
    /// Length of the cardiac cycle.
    pub cycle_length_ms: f64,
}

/// Difference over standard deviation assigned to each sample of a failed beat.
const OF_FAILED: f64 = 10.0;

impl MeasuredTraces {
    /// Differences over standard deviations, one per sample of each trace that counts.
    ///
    /// They are scaled so that the sum of squares corresponds to independent samples, one per
    /// correlation time of the beat: T/τ · rms²/σ² for each trace. Their number is the same for
    /// every beat.
    #[must_use]
    pub fn residuals(&self, simulated: Option<&BeatSamples>) -> Vec<f64> {
        let Self {
            samples,
            deviations,
            ..
        } = self;
        let pressure = (
            &samples.pressure_mmhg,
            simulated.map(|s| &s.pressure_mmhg),
            deviations.pressure_mmhg,
        );
        let volume = (
            &samples.volume_ml,
            simulated.map(|s| &s.volume_ml),
            deviations.volume_ml,
        );
        let counted = [pressure, volume]
            .into_iter()
            .filter(|(_, _, sd)| *sd > 0.0);
        counted
            .flat_map(|(measured, simulated, sd)| self.of_trace(measured, simulated, sd))
            .collect()
    }

    fn of_trace(&self, measured: &[f64], simulated: Option<&Vec<f64>>, sd: f64) -> Vec<f64> {
        let scale = (self.n_independent() / measured.len().max(1) as f64).sqrt();
        let difference = |(k, measured): (usize, &f64)| {
            let simulated = simulated.and_then(|simulated| simulated.get(k));
            scale * simulated.map_or(OF_FAILED, |simulated| (simulated - measured) / sd)
        };
        measured.iter().enumerate().map(difference).collect()
    }

    fn n_independent(&self) -> f64 {
        self.cycle_length_ms / self.deviations.correlation_ms
    }

    /// Number of independent data in the traces that count.
    #[must_use]
    pub fn n_measured(&self) -> f64 {
        let Self {
            samples,
            deviations,
            ..
        } = self;
        let of = |trace: &[f64], sd: f64| f64::from(u8::from(!trace.is_empty() && sd > 0.0));
        let n_traces = of(&samples.pressure_mmhg, deviations.pressure_mmhg)
            + of(&samples.volume_ml, deviations.volume_ml);
        n_traces * self.n_independent()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_of_one_deviation_everywhere_counts_as_often_as_it_could_change() {
        let samples = BeatSamples {
            pressure_mmhg: vec![50.0; 40],
            volume_ml: vec![100.0; 40],
        };
        let deviations = TraceDeviations {
            pressure_mmhg: 2.0,
            volume_ml: 5.0,
            correlation_ms: 100.0,
        };
        let measured = MeasuredTraces {
            samples,
            deviations,
            cycle_length_ms: 800.0,
        };
        let sum = |beat: Option<&BeatSamples>| {
            measured.residuals(beat).iter().map(|r| r * r).sum::<f64>()
        };
        let off = BeatSamples {
            pressure_mmhg: vec![52.0; 40],
            volume_ml: vec![95.0; 40],
        };
        assert!(
            (sum(Some(&off)) - 16.0).abs() < 1e-9 && (measured.n_measured() - 16.0).abs() < 1e-9
        );
        assert!(
            (sum(None) - 1600.0).abs() < 1e-6,
            "a failed beat is far off"
        );
        let deviations = TraceDeviations {
            pressure_mmhg: 0.0,
            ..deviations
        };
        let of_volume = MeasuredTraces {
            deviations,
            ..measured
        };
        assert_eq!(
            (
                of_volume.residuals(Some(&off)).len(),
                of_volume.n_measured()
            ),
            (40, 8.0)
        );
    }
}
