//! How sure a twin is: distributions of parameters, biomarkers and traces, given the patient's noise.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarkers;
use crate::outcome::Determination;
use crate::patient::Noise;
use crate::samples::{BeatSamples, N_SAMPLES};
use crate::task::{MovedParameter, OrganBeatSpec};

/// Sampling of the posterior after step 3.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PosteriorSettings {
    /// Whether it is sampled.
    pub enabled: bool,
    /// Number of draws.
    // The 5 % quantile of fewer draws is the smallest of them.
    #[schemars(range(min = 40, max = 100_000))]
    pub draws: u32,
    /// How long a difference between model and data lasts that is no noise.
    #[schemars(extend("minimum" = 1.0, "maximum" = 1e4))]
    pub discrepancy_correlation_ms: f64,
    /// Factor on the standard deviations of the data's errors, found on simulated patients so that intervals hold their share
    /// of true values (docs/step3.md).
    #[schemars(extend("minimum" = 0.1, "maximum" = 10.0))]
    pub error_factor: f64,
}

impl Default for PosteriorSettings {
    fn default() -> Self {
        Self {
            enabled: true,
            draws: 100,
            discrepancy_correlation_ms: 100.0,
            error_factor: 1.4,
        }
    }
}

/// The beat of step 3 that was taken, or the verification beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TwinBeat {
    /// Moved parameters by name.
    pub parameters: BTreeMap<String, f64>,
    /// The organ's biomarkers.
    pub biomarkers: Biomarkers,
    /// The organ's traces.
    pub samples: BeatSamples,
}

/// The posterior of a twin's parameters in the one-fibre ventricle, corrected to the twin's beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PosteriorSpec {
    /// The twin's beat; of a finite-element ventricle the figures are used.
    pub beat: OrganBeatSpec,
    /// What it gave.
    pub twin: TwinBeat,
    /// What is uncertain, with its prior.
    pub parameters: BTreeMap<String, MovedParameter>,
    /// Measured biomarkers: rates of pressure count, others where their trace was not measured.
    pub measured: Biomarkers,
    /// Measured pressure and volume, at the times of the twin's.
    pub samples: BeatSamples,
    /// What the patient's file states of their noise.
    pub noise: Noise,
    /// Standard deviation of measured biomarkers, percent.
    pub uncertainty_percent: BTreeMap<String, f64>,
    /// How it is sampled.
    pub settings: PosteriorSettings,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Noise of a clinic's traces where a patient file states none: a fluid-filled or tip catheter averaged over some beats, and
/// cine imaging.
pub const USUAL_NOISE: TraceNoise = TraceNoise {
    pressure_rms_mmhg: 2.0,
    pressure_correlation_ms: 12.0,
    volume_rms_ml: 3.0,
    volume_frames: 25.0,
};

/// The noise of a patient's traces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TraceNoise {
    /// Standard deviation of the pressure.
    #[serde(rename = "pressure_rms_mmHg")]
    pub pressure_rms_mmhg: f64,
    /// Its exponential correlation time.
    pub pressure_correlation_ms: f64,
    /// Standard deviation of each frame's volume.
    #[serde(rename = "volume_rms_mL")]
    pub volume_rms_ml: f64,
    /// Number of frames of a beat.
    pub volume_frames: f64,
}

impl TraceNoise {
    /// What is stated, the rest as usual.
    #[must_use]
    pub fn of(noise: &Noise) -> Self {
        let stated = |value: Option<f64>, usual: f64| value.filter(|v| *v > 0.0).unwrap_or(usual);
        Self {
            pressure_rms_mmhg: stated(noise.pressure_rms_mmhg, USUAL_NOISE.pressure_rms_mmhg),
            pressure_correlation_ms: stated(
                noise.pressure_correlation_ms,
                USUAL_NOISE.pressure_correlation_ms,
            ),
            volume_rms_ml: stated(noise.volume_rms_ml, USUAL_NOISE.volume_rms_ml),
            volume_frames: stated(
                noise.volume_frames.map(f64::from),
                USUAL_NOISE.volume_frames,
            ),
        }
    }

    /// Variance of a sample's volume, so that [`N_SAMPLES`] of them tell as much as the frames do.
    #[must_use]
    pub fn volume_variance(&self) -> f64 {
        self.volume_rms_ml.powi(2) * (N_SAMPLES as f64 / self.volume_frames).max(1.0)
    }
}

/// Values below which 5, 50 and 95 % of a distribution lie.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Spread {
    /// 5 %.
    pub p5: f64,
    /// 50 %.
    pub p50: f64,
    /// 95 %.
    pub p95: f64,
}

/// What is known of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ParameterSpread {
    /// The twin's value.
    pub twin: f64,
    /// Given the data.
    pub posterior: Spread,
    /// Without data.
    pub prior: Spread,
    /// What follows: *determined* where the 90 % interval of the logarithm is at most a third of the prior's, *not
    /// determined* where it is four fifths or more, else *sloppy*.
    pub mark: Determination,
}

impl ParameterSpread {
    /// Whether the twin's value lies outside of the 90 % interval.
    #[must_use]
    pub fn excludes_twin(&self) -> bool {
        !(self.posterior.p5..=self.posterior.p95).contains(&self.twin)
    }
}

/// A trace's distribution at the times of [`BeatSamples`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct Band {
    /// 5 %.
    pub p5: Vec<f64>,
    /// 50 %.
    pub p50: Vec<f64>,
    /// 95 %.
    pub p95: Vec<f64>,
}

/// How the draws were made, and whether to trust them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Sampling {
    /// Share of the draws that were asked for whose search ended by itself.
    pub converged_share: f64,
    /// Sum of squares that data and prior leave, over its expected value: about 1 where model, prior and errors are right, more
    /// where the model cannot follow the data to within their errors.
    pub left_over_expected: f64,
    /// Beats of the one-fibre ventricle.
    pub evaluations: u64,
}

/// Share of searches that have to end by themselves.
const ENOUGH: f64 = 0.9;
/// What data and prior may leave over the expected value: beyond, intervals are too narrow.
const MOST_LEFT: f64 = 1.5;

impl Sampling {
    /// Why the intervals are not to be trusted; none where they are.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        if self.converged_share < ENOUGH {
            return Some(format!(
                "only {:.0} % of the searches ended by themselves",
                100.0 * self.converged_share
            ));
        }
        (self.left_over_expected > MOST_LEFT).then(|| {
            format!(
                "model and data differ by {:.1} times what their errors explain",
                self.left_over_expected.sqrt()
            )
        })
    }
}

/// Standard deviations that the data were given.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Deviations {
    /// Noise of the traces.
    pub noise: TraceNoise,
    /// What the twin's pressure misses beyond its noise, rms.
    #[serde(rename = "pressure_discrepancy_mmHg")]
    pub pressure_discrepancy_mmhg: f64,
    /// What its volume misses beyond its noise, rms.
    #[serde(rename = "volume_discrepancy_mL")]
    pub volume_discrepancy_ml: f64,
}

/// The posterior of a twin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PosteriorResult {
    /// What is known of each parameter, by name.
    pub parameters: BTreeMap<String, ParameterSpread>,
    /// By biomarker of the organ.
    pub biomarkers: BTreeMap<String, Spread>,
    /// Of the pressure, mmHg.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Band,
    /// Of the volume, mL.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Band,
    /// Correlations of the parameters' logarithms, rows and columns in the order of `parameters`.
    pub correlations: Vec<Vec<f64>>,
    /// Draws of all parameters, in their order: what predictions are made with.
    pub draws: Vec<Vec<f64>>,
    /// What the data were taken to be worth.
    pub deviations: Deviations,
    /// Whether to trust it.
    pub sampling: Sampling,
}

impl PosteriorResult {
    /// How many of the twin's parameters lie outside of their intervals, and why; none where all lie within.
    #[must_use]
    pub fn outside_words(&self) -> Option<String> {
        let outside = self
            .parameters
            .values()
            .filter(|spread| spread.excludes_twin())
            .count();
        (outside > 0).then(|| {
            format!(
                "{outside} of the twin's {} parameters lie outside of their intervals: step 3 weighs biomarkers most, the \
                 posterior weighs the traces most.",
                self.parameters.len()
            )
        })
    }

    /// A draw by name.
    #[must_use]
    pub fn draw(&self, at: usize) -> BTreeMap<String, f64> {
        let values = self.draws.get(at).into_iter().flatten();
        self.parameters
            .keys()
            .cloned()
            .zip(values.copied())
            .collect()
    }
}
