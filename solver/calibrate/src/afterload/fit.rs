//! Fit of a three-element Windkessel to a record.

use super::noise;
use super::problem::Problem;
use super::record::Record;
use super::simulate::Start;
use super::{AfterloadError, Determined, Estimate, WindkesselFit, WindkesselFitSettings};
use crate::least_squares::{Fit, Settings};
use crate::profile_interval::Profile;
use crate::{Interval, normal};

/// Ratio of an interval's half-width to the value beyond which a parameter is poorly determined.
const POOR: f64 = 0.3;

/// Fits R1, R2, C and the initial pressure of the compliance by least squares over all pressure
/// samples.
///
/// Intervals come from the profile: all values at which the other parameters can be fitted so that
/// the sum of squares rises by less than z² residual variances, for the effective number of
/// samples.
///
/// # Errors
/// [`AfterloadError`] if the confidence level is invalid or the minimisation fails.
pub fn fit_windkessel(
    record: &Record,
    settings: WindkesselFitSettings,
) -> Result<WindkesselFit, AfterloadError> {
    let level = settings.confidence_level;
    if !(level > 0.0 && level < 1.0) {
        return Err(AfterloadError::Confidence { level });
    }
    let problem = Problem::new(record, settings.start, &[]);
    let fit = problem.fit_base(Settings::default())?;
    let residuals = problem.all_residuals(&fit.parameters);
    let sample_size = noise::effective_sample_size(record, &residuals);
    let z = normal::quantile(0.5 + 0.5 * level);
    // By how much variances of estimates are larger than for independent residuals.
    let inflation = record.n_samples() as f64 / sample_size.n_effective;
    let profiles = Profiles {
        problem: &problem,
        fit: &fit,
        z,
        inflation,
    };
    let x = &fit.parameters;
    let values = problem.values(x);
    let errors = fit.standard_errors();
    // The error of a logarithm times the value is the error of the value.
    let error = |k: usize, scale: f64| errors[k].map(|e| e * scale * inflation.sqrt());
    let own = |k: usize| -> Map { Box::new(move |y: &[f64]| (k, y.to_vec())) };
    let r1 = profiles.estimate(x[0], error(0, 1.0), &own(0), |u| u);
    let r2 = profiles.estimate(x[1], error(1, x[1].exp()), &own(1), f64::exp);
    let compliance = profiles.estimate(x[2], error(2, x[2].exp()), &own(2), f64::exp);
    // ln τ = ln R2 + ln C replaces ln C as coordinate.
    let tau_map: Map = Box::new(|y: &[f64]| {
        let mut y = y.to_vec();
        y[2] -= y[1];
        (2, y)
    });
    let time_constant = profiles.estimate(x[1] + x[2], None, &tau_map, f64::exp);
    let start = match settings.start {
        Start::Free => profiles.estimate(x[3], error(3, 1.0), &own(3), |u| u),
        Start::Periodic => Estimate {
            value: first_pc(&residuals, record, values[0]),
            ..Estimate::default()
        },
    };
    let start = Estimate {
        determined: Determined::Well,
        ..start
    };
    let rms = (fit.sum_of_squares / residuals.len() as f64).sqrt();
    Ok(WindkesselFit {
        r1,
        r2,
        compliance,
        time_constant,
        start,
        confidence_level: level,
        correlations: correlations(&problem, x),
        n_samples: residuals.len(),
        root_mean_square_mmhg: rms,
        sample_size,
        converged: fit.converged,
        residuals_mmhg: residuals,
    })
}

/// Pressure of the compliance at the first sample, for a periodic start.
fn first_pc(residuals: &[f64], record: &Record, r1: f64) -> f64 {
    let flow = record.flow[record
        .flow_time_s
        .partition_point(|t| *t < -1e-8)
        .min(record.flow.len() - 1)];
    residuals[0] + record.pressure[0] - r1 * flow
}

/// Maps coordinates that contain the profiled quantity to its index and the fit's own coordinates.
type Map = Box<dyn Fn(&[f64]) -> (usize, Vec<f64>)>;

struct Profiles<'a> {
    problem: &'a Problem<'a>,
    fit: &'a Fit,
    z: f64,
    inflation: f64,
}

impl Profiles<'_> {
    /// Value, error and interval of one quantity; `natural` converts the coordinate to the
    /// quantity.
    fn estimate(
        &self,
        best: f64,
        standard_error: Option<f64>,
        map: &Map,
        natural: impl Fn(f64) -> f64,
    ) -> Estimate {
        let x = &self.fit.parameters;
        let bounds = self.problem.bounds();
        let (k, _) = map(x);
        // Optimum in the profile's coordinates, which differ from the fit's only in the profiled
        // one.
        let mut start = x.clone();
        start[k] = best;
        let limits = if (best - x[k]).abs() > 0.0 {
            Interval::new(best - bounds[k].width(), best + bounds[k].width())
        } else {
            bounds[k]
        };
        let least = self.fit.sum_of_squares;
        let threshold = least + self.z * self.z * self.inflation * self.fit.residual_variance();
        let at = |value: f64, warm: &[f64]| {
            let mut box_here = bounds.clone();
            box_here[k] = Interval::new(value, value);
            let mut from = warm.to_vec();
            from[k] = value;
            let residuals = |y: &[f64]| self.problem.residuals(&map(y).1);
            let settings = Settings {
                max_steps: 40,
                cost_tolerance: 1e-9,
                step_tolerance: 1e-8,
                ..Settings::default()
            };
            let fit = crate::least_squares::fit(&residuals, &from, &box_here, settings).ok()?;
            Some((fit.sum_of_squares, fit.parameters))
        };
        let profile = Profile {
            at: &at,
            start: &start,
            least,
            threshold,
        };
        let ends = profile.interval(best, 0.02 * limits.width(), limits);
        let [lower, upper] = ends.map(|end| end.map(&natural));
        let value = natural(best);
        let determined = match (lower, upper) {
            (Some(low), Some(high)) if high - low <= 2.0 * POOR * value.abs() => Determined::Well,
            (Some(_), Some(_)) => Determined::Poorly,
            _ => Determined::Not,
        };
        Estimate {
            value,
            standard_error,
            lower,
            upper,
            determined,
        }
    }
}

/// Correlations of the estimates of R1, R2 and C by the linearised model, in the order R1-R2, R1-C,
/// R2-C.
fn correlations(problem: &Problem<'_>, x: &[f64]) -> [Option<f64>; 3] {
    let n = problem.n_coordinates();
    let columns: Vec<Vec<f64>> = (0..n)
        .map(|k| {
            let h = 1e-5 * problem.bounds()[k].width();
            let moved = |step: f64| {
                let mut y = x.to_vec();
                y[k] += step;
                problem.residuals(&y)
            };
            moved(h)
                .iter()
                .zip(moved(-h))
                .map(|(a, b)| (a - b) / (2.0 * h))
                .collect()
        })
        .collect();
    let lengths: Vec<f64> = columns
        .iter()
        .map(|c| c.iter().map(|v| v * v).sum::<f64>().sqrt())
        .collect();
    let gram = nalgebra::DMatrix::from_fn(n, n, |i, j| {
        let product: f64 = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
        product / (lengths[i] * lengths[j])
    });
    let inverse = gram.cholesky().map(|c| c.inverse());
    [(0, 1), (0, 2), (1, 2)].map(|(i, j)| {
        let inverse = inverse.as_ref()?;
        Some(inverse[(i, j)] / (inverse[(i, i)] * inverse[(j, j)]).sqrt()).filter(|c| c.is_finite())
    })
}
