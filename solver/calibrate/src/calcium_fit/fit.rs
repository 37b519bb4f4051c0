//! Bounds, starts and minimisation of the calcium fit, and the conclusions from its intervals.

use super::{CalciumFit, Estimate, Rice2008Parameters, TimeConstants};
use crate::least_squares::{self, Fit, LeastSquaresError};
use crate::profile_interval::Profile;
use crate::{Interval, normal};
use serde::{Deserialize, Serialize};

/// Asymmetries to start from; each gives the mean time constant together with the time of the peak.
const STARTS: [f64; 3] = [0.01, 0.5, 0.9];
/// Largest asymmetry, at which one time constant is 199 times the other.
const LARGEST_ASYMMETRY: f64 = 0.98;
/// Asymmetry below which the time constants are equal to a thousandth.
const EQUAL: f64 = 1e-6;

/// Settings of a calcium fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalciumFitSettings {
    /// Time of activation on the clock of the trace, ms.
    pub activation_ms: f64,
    /// Probability that an interval covers the truth, dimensionless.
    pub confidence_level: f64,
}

impl Default for CalciumFitSettings {
    fn default() -> Self {
        Self {
            activation_ms: 0.0,
            confidence_level: 0.95,
        }
    }
}

/// Reasons why a trace cannot be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalciumFitError {
    /// Times and values differ in number or are too few.
    #[error(
        "a trace with {n_times} times and {n_values} values instead of equal numbers of at least 8"
    )]
    Samples {
        /// Number of times of the trace.
        n_times: usize,
        /// Number of values of the trace.
        n_values: usize,
    },
    /// A sample is not finite, or its time does not exceed the previous one.
    #[error(
        "sample {idx} at {time_ms} ms with {calcium_um} µM: values must be finite and times must increase"
    )]
    Sample {
        /// Position of the sample.
        idx: usize,
        /// Time of the sample, ms.
        time_ms: f64,
        /// Value of the sample, µM.
        calcium_um: f64,
    },
    /// The trace does not rise, or does not fall again after its rise.
    #[error(
        "no rise and fall of the trace after activation at {activation_ms} ms: its largest value is at {peak_ms} ms"
    )]
    NoTransient {
        /// Time of activation that the caller gave \[ms\].
        activation_ms: f64,
        /// Time of the largest value \[ms\].
        peak_ms: f64,
    },
    /// The confidence level is not between 0 and 1.
    #[error("the confidence level is {level}, but must be above 0 and below 1")]
    Confidence {
        /// Confidence level that was given.
        level: f64,
    },
    /// The least-squares solver rejects its start.
    #[error("the transient cannot be fitted")]
    LeastSquares(#[from] LeastSquaresError),
}

/// A trace, with residuals in two kinds of coordinates.
pub(super) struct Problem<'a> {
    /// Times after activation, ms.
    times_ms: Vec<f64>,
    calcium_um: &'a [f64],
}

/// Parameters from resting and peak calcium, mean time constant and asymmetry.
fn from_asymmetry(x: &[f64]) -> Rice2008Parameters {
    let half_gap = x[3].max(0.0).sqrt();
    Rice2008Parameters {
        ca_res_um: x[0],
        ca_max_um: x[1],
        tau_cr_ms: x[2] * (1.0 + half_gap),
        tau_cd_ms: x[2] * (1.0 - half_gap),
    }
}

/// Parameters from resting and peak calcium and both time constants.
fn from_time_constants(x: &[f64]) -> Rice2008Parameters {
    Rice2008Parameters {
        ca_res_um: x[0],
        ca_max_um: x[1],
        tau_cr_ms: x[2],
        tau_cd_ms: x[3],
    }
}

impl Problem<'_> {
    fn residuals(&self, parameters: &Rice2008Parameters) -> Vec<f64> {
        let transient = parameters.transient_um(&self.times_ms);
        transient
            .iter()
            .zip(self.calcium_um)
            .map(|(model, trace)| model - trace)
            .collect()
    }

    fn by_asymmetry(&self, start: &[f64], bounds: &[Interval]) -> Result<Fit, LeastSquaresError> {
        least_squares::fit(
            &|x| self.residuals(&from_asymmetry(x)),
            start,
            bounds,
            Default::default(),
        )
    }

    fn by_time_constants(
        &self,
        start: &[f64],
        bounds: &[Interval],
    ) -> Result<Fit, LeastSquaresError> {
        least_squares::fit(
            &|x| self.residuals(&from_time_constants(x)),
            start,
            bounds,
            Default::default(),
        )
    }
}

/// Fits Rice's transient to a trace.
///
/// - `times_ms`, `calcium_um`: samples at any spacing, including those of the beat before
///   activation
///
/// # Errors
/// [`CalciumFitError`] if the trace holds no transient.
pub fn fit_calcium(
    times_ms: &[f64],
    calcium_um: &[f64],
    settings: CalciumFitSettings,
) -> Result<CalciumFit, CalciumFitError> {
    let peak_ms = check(times_ms, calcium_um, settings)?;
    let problem = Problem {
        times_ms: times_ms
            .iter()
            .map(|t| t - settings.activation_ms)
            .collect(),
        calcium_um,
    };
    let bounds = bounds(&problem.times_ms, calcium_um);
    let mut best: Option<Fit> = None;
    let mut refused = None;
    for u in STARTS {
        let root = f64::sqrt(u);
        let peak_over_mean = root.atanh() / root * (1.0 - u);
        let lowest = calcium_um.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = calcium_um.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        match problem.by_asymmetry(&[lowest, highest, peak_ms / peak_over_mean, u], &bounds) {
            Ok(fit)
                if best
                    .as_ref()
                    .is_none_or(|b| fit.sum_of_squares < b.sum_of_squares) =>
            {
                best = Some(fit)
            }
            Ok(_) => {}
            Err(error) => refused = Some(error),
        }
    }
    match (best, refused) {
        (Some(best), _) => conclude(&problem, &bounds, best, settings.confidence_level),
        (None, Some(error)) => Err(error.into()),
        (None, None) => unreachable!("each start ends in a fit or an error"),
    }
}

/// Checks that the trace is a transient and returns the time of its peak after activation.
fn check(
    times_ms: &[f64],
    calcium_um: &[f64],
    settings: CalciumFitSettings,
) -> Result<f64, CalciumFitError> {
    let (n_times, n_values) = (times_ms.len(), calcium_um.len());
    if n_times != n_values || n_times < 8 {
        return Err(CalciumFitError::Samples { n_times, n_values });
    }
    for idx in 0..n_times {
        let (time_ms, calcium_um) = (times_ms[idx], calcium_um[idx]);
        let in_order = idx == 0 || time_ms > times_ms[idx - 1];
        if !(time_ms.is_finite() && calcium_um.is_finite() && in_order) {
            return Err(CalciumFitError::Sample {
                idx,
                time_ms,
                calcium_um,
            });
        }
    }
    let level = settings.confidence_level;
    if !(level > 0.0 && level < 1.0) {
        return Err(CalciumFitError::Confidence { level });
    }
    let peak = (0..n_times).fold(0, |best, i| {
        if calcium_um[i] > calcium_um[best] {
            i
        } else {
            best
        }
    });
    let (activation_ms, peak_ms) = (settings.activation_ms, times_ms[peak]);
    let at_an_end = peak == 0 || peak + 1 == n_times;
    if at_an_end || peak_ms <= activation_ms || calcium_um[peak] <= 0.0 {
        return Err(CalciumFitError::NoTransient {
            activation_ms,
            peak_ms,
        });
    }
    Ok(peak_ms - activation_ms)
}

/// Bounds of the parameters, from the range of the trace.
fn bounds(times_ms: &[f64], calcium_um: &[f64]) -> [Interval; 4] {
    let lowest = calcium_um.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = calcium_um.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let range = highest - lowest;
    let duration = times_ms[times_ms.len() - 1].max(times_ms[times_ms.len() - 1] - times_ms[0]);
    // Concentrations of the model are positive even if a background was subtracted from the trace.
    let least = 1e-6 * highest;
    [
        Interval::new(
            (lowest - 0.5 * range).max(least),
            (lowest + 0.5 * range).max(2.0 * least),
        ),
        Interval::new((highest - 0.5 * range).max(least), highest + range),
        Interval::new(1e-3 * duration, duration),
        Interval::new(0.0, LARGEST_ASYMMETRY),
    ]
}

/// Computes the intervals and what they imply for the time constants.
fn conclude(
    problem: &Problem<'_>,
    bounds: &[Interval; 4],
    mut best: Fit,
    level: f64,
) -> Result<CalciumFit, CalciumFitError> {
    let z = normal::quantile(0.5 + 0.5 * level);
    let threshold = |fit: &Fit| fit.sum_of_squares + z * z * fit.residual_variance();
    let mut equal_bounds = *bounds;
    equal_bounds[3] = Interval::new(0.0, 0.0);
    let equal = problem.by_asymmetry(&best.parameters, &equal_bounds)?;
    let time_constants =
        if best.parameters[3] < EQUAL || equal.sum_of_squares <= best.sum_of_squares {
            best = equal;
            TimeConstants::Equal
        } else if equal.sum_of_squares <= threshold(&best) {
            TimeConstants::Indistinct
        } else {
            TimeConstants::Distinct
        };
    let parameters = from_asymmetry(&best.parameters);
    let errors = best.standard_errors();
    let (least, threshold) = (best.sum_of_squares, threshold(&best));
    let estimate = |value: f64,
                    standard_error: Option<f64>,
                    limits: Interval,
                    profile: Profile<'_>|
     -> Estimate {
        let step = standard_error.map_or(0.01 * value.abs(), |e| z * e);
        let [lower, upper] = profile.interval(value, step, limits);
        Estimate {
            value,
            standard_error,
            lower,
            upper,
        }
    };
    let along = |k: usize| {
        let profile = |value: f64, start: &[f64]| {
            let (mut bounds, mut start) = (*bounds, start.to_vec());
            bounds[k] = Interval::new(value, value);
            start[k] = value;
            problem
                .by_asymmetry(&start, &bounds)
                .ok()
                .map(|fit| (fit.sum_of_squares, fit.parameters))
        };
        estimate(
            best.parameters[k],
            errors[k],
            bounds[k],
            Profile {
                at: &profile,
                start: &best.parameters,
                least,
                threshold,
            },
        )
    };
    let tau_limits = Interval::new(1e-3 * bounds[2].lower, 2.0 * bounds[2].upper);
    let tau_bounds = [bounds[0], bounds[1], tau_limits, tau_limits];
    let both = [
        parameters.ca_res_um,
        parameters.ca_max_um,
        parameters.tau_cr_ms,
        parameters.tau_cd_ms,
    ];
    let tau_errors = match time_constants {
        // The two columns of derivatives are equal.
        TimeConstants::Equal => vec![None; 4],
        _ => problem
            .by_time_constants(&both, &tau_bounds)?
            .standard_errors(),
    };
    let along_tau = |k: usize| {
        let profile = |value: f64, start: &[f64]| {
            let (mut bounds, mut start) = (tau_bounds, start.to_vec());
            bounds[k] = Interval::new(value, value);
            start[k] = value;
            problem
                .by_time_constants(&start, &bounds)
                .ok()
                .map(|fit| (fit.sum_of_squares, fit.parameters))
        };
        estimate(
            both[k],
            tau_errors[k],
            tau_limits,
            Profile {
                at: &profile,
                start: &both,
                least,
                threshold,
            },
        )
    };
    let residuals = problem.residuals(&parameters);
    Ok(CalciumFit {
        parameters,
        ca_res_um: along(0),
        ca_max_um: along(1),
        tau_cr_ms: along_tau(2),
        tau_cd_ms: along_tau(3),
        tau_mean_ms: along(2),
        time_constants,
        confidence_level: level,
        n_samples: residuals.len(),
        root_mean_square_um: (best.sum_of_squares / residuals.len() as f64).sqrt(),
        residual_correlation: neighbours_correlation(&residuals),
        converged: best.converged,
    })
}

fn neighbours_correlation(residuals: &[f64]) -> f64 {
    let squares: f64 = residuals.iter().map(|r| r * r).sum();
    let neighbours: f64 = residuals.windows(2).map(|w| w[0] * w[1]).sum();
    if squares > 0.0 {
        neighbours / squares
    } else {
        0.0
    }
}
