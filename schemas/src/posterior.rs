//! Uncertainty of a twin: distributions of parameters, biomarkers and traces, given the patient's
//! noise.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::biomarkers::Biomarkers;
use crate::determination::Determination;
use crate::input_file::InputFile;
use crate::organ_beat::OrganBeatSpec;
use crate::organ_law::{LawSamples, LearnedLaw};
use crate::patient::Noise;
use crate::samples::{BeatSamples, N_SAMPLES};
use crate::step3::MovedParameter;

pub use crate::posterior_settings::PosteriorSettings;

/// The twin's beat: the best one of step 3, or the verification beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TwinBeat {
    /// Values of the varied parameters, by name.
    pub parameters: BTreeMap<String, f64>,
    /// Biomarkers of the organ.
    pub biomarkers: Biomarkers,
    /// Traces of the organ.
    pub samples: BeatSamples,
}

/// Posterior of a twin's parameters in the one-fibre ventricle, corrected to the twin's beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PosteriorSpec {
    /// Settings of the twin's beat. Only the figures of a finite-element ventricle are used.
    pub beat: OrganBeatSpec,
    /// Parameters and results of the twin's beat.
    pub twin: TwinBeat,
    /// Uncertain parameters with their priors.
    pub parameters: BTreeMap<String, MovedParameter>,
    /// Measured biomarkers. Pressure rates are always used, the others only if their trace was not
    /// measured.
    pub measured: Biomarkers,
    /// Measured pressure and volume at the times of the twin's samples.
    pub samples: BeatSamples,
    /// Noise of the traces as stated in the patient's file.
    pub noise: Noise,
    /// Standard deviations of the measured biomarkers, percent.
    pub uncertainty_percent: BTreeMap<String, f64>,
    /// Beats from which the organ's law is learned, as in step 1's proposals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<Vec<LawSamples>>,
    /// File of the law before the first beat, as in step 1's proposals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<InputFile>,
    /// Settings of the sampling.
    pub settings: PosteriorSettings,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Noise of clinical traces if a patient file states none: a fluid-filled or tip catheter averaged
/// over several beats, and cine imaging.
pub const USUAL_NOISE: TraceNoise = TraceNoise {
    pressure_rms_mmhg: 2.0,
    pressure_correlation_ms: 12.0,
    volume_rms_ml: 3.0,
    volume_frames: 25.0,
};

/// Noise of a patient's traces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TraceNoise {
    /// Standard deviation of the pressure.
    #[serde(rename = "pressure_rms_mmHg")]
    pub pressure_rms_mmhg: f64,
    /// Exponential correlation time of the pressure noise.
    pub pressure_correlation_ms: f64,
    /// Standard deviation of a frame's volume.
    #[serde(rename = "volume_rms_mL")]
    pub volume_rms_ml: f64,
    /// Number of volume frames in a beat.
    pub volume_frames: f64,
}

impl TraceNoise {
    /// Stated noise levels, completed by the usual ones.
    #[must_use]
    pub fn of(noise: &Noise) -> Self {
        let stated = noise.stated();
        Self {
            pressure_rms_mmhg: stated
                .pressure_rms_mmhg
                .unwrap_or(USUAL_NOISE.pressure_rms_mmhg),
            pressure_correlation_ms: stated
                .pressure_correlation_ms
                .unwrap_or(USUAL_NOISE.pressure_correlation_ms),
            volume_rms_ml: stated.volume_rms_ml.unwrap_or(USUAL_NOISE.volume_rms_ml),
            volume_frames: stated
                .volume_frames
                .map_or(USUAL_NOISE.volume_frames, f64::from),
        }
    }

    /// Variance of a sample's volume, at which [`N_SAMPLES`] samples carry as much information as
    /// the frames.
    #[must_use]
    pub fn volume_variance(&self) -> f64 {
        self.volume_rms_ml.powi(2) * (N_SAMPLES as f64 / self.volume_frames).max(1.0)
    }
}

/// Quantiles of a distribution at 5, 50 and 95 %.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Spread {
    /// Quantile at 5 %.
    pub p5: f64,
    /// Quantile at 50 %, the median.
    pub p50: f64,
    /// Quantile at 95 %.
    pub p95: f64,
}

/// Knowledge about a parameter before and after the measurements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct ParameterSpread {
    /// Value in the twin.
    pub twin: f64,
    /// Distribution given the data.
    pub posterior: Spread,
    /// Distribution without data.
    pub prior: Spread,
    /// Conclusion: *determined* if the 90 % interval of the logarithm is at most a third of that of
    /// the prior, *not determined* if it is at least four fifths of it, otherwise *sloppy*.
    pub mark: Determination,
}

impl ParameterSpread {
    /// Whether the twin's value lies outside the 90 % interval.
    #[must_use]
    pub fn excludes_twin(&self) -> bool {
        !(self.posterior.p5..=self.posterior.p95).contains(&self.twin)
    }
}

/// Distribution of a trace at the times of its samples.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct Band {
    /// Quantiles at 5 %.
    pub p5: Vec<f64>,
    /// Quantiles at 50 %, the medians.
    pub p50: Vec<f64>,
    /// Quantiles at 95 %.
    pub p95: Vec<f64>,
}

/// Effort and reliability of the draws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Sampling {
    /// Share of the requested draws whose search converged.
    pub converged_share: f64,
    /// Ratio of the remaining sum of squares of data and prior to its expected value: about 1 if
    /// model, prior and errors are right, larger if the model cannot follow the data to within
    /// their errors.
    pub left_over_expected: f64,
    /// Number of beats of the one-fibre ventricle.
    pub evaluations: u64,
    /// Whether beats were not corrected to the twin's, because the ventricle has no beat with the
    /// twin's parameters.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_uncorrected: bool,
}

/// Smallest share of searches that must end by themselves.
const ENOUGH: f64 = 0.9;
/// Largest ratio of the remaining misfit of data and prior to its expected value. Beyond it the
/// intervals are too narrow.
const MOST_LEFT: f64 = 1.5;

impl Sampling {
    /// Reason why the intervals are not reliable; `None` if they are.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        if self.is_uncorrected {
            return Some(
                "the twin's beat does not end in the ventricle of the draws, so that no beat corrects it"
                    .to_owned(),
            );
        }
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

/// Standard deviations assumed for the data.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Deviations {
    /// Noise of the traces.
    pub noise: TraceNoise,
    /// Rms difference between the pressure of the twin and the measured pressure beyond the noise.
    #[serde(rename = "pressure_discrepancy_mmHg")]
    pub pressure_discrepancy_mmhg: f64,
    /// Rms difference between the volume of the twin and the measured volume beyond the noise.
    #[serde(rename = "volume_discrepancy_mL")]
    pub volume_discrepancy_ml: f64,
}

/// Posterior of a twin's parameters and predictions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PosteriorResult {
    /// Knowledge about each parameter, by name.
    pub parameters: BTreeMap<String, ParameterSpread>,
    /// Distributions of the organ's biomarkers, by name.
    pub biomarkers: BTreeMap<String, Spread>,
    /// Distribution of the pressure, mmHg.
    #[serde(rename = "pressure_mmHg")]
    pub pressure_mmhg: Band,
    /// Distribution of the volume, mL.
    #[serde(rename = "volume_mL")]
    pub volume_ml: Band,
    /// Correlations of the parameters' logarithms. Rows and columns have the order of `parameters`.
    pub correlations: Vec<Vec<f64>>,
    /// Draws of all parameters in the order of `parameters`, for predictions.
    pub draws: Vec<Vec<f64>>,
    /// Standard deviations assumed for the data.
    pub deviations: Deviations,
    /// Effort and reliability of the draws.
    pub sampling: Sampling,
    /// The organ's law; absent if the draws are in the one-fibre ventricle, and in results of earlier
    /// programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned_law: Option<LearnedLaw>,
}

impl PosteriorResult {
    /// Number of the twin's parameters outside their intervals, with the reason; `None` if all lie
    /// within.
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

    /// One draw, as values by parameter name.
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
