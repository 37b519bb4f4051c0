//! Resampling of all traces of a comparison, measured or simulated, alike to one step.
//!
//! Measured traces repeat, so a periodic cubic spline goes through their samples (cine frames, catheter samples).
//! A single simulated beat is never wrapped around: it gets a monotone cubic, which knows nothing beyond its ends and
//! adds no extremum that the simulation did not have. Samples that already lie on the grid pass unchanged, bit for bit.

use crate::{Continuation, Quantity, Trace, TraceError};
use cardiotwin_units::Ms;

/// The step that biomarkers are taken at.
pub const STEP: Ms = Ms(1.0);

/// Fraction of the cycle by which a periodic trace may run beyond it, dimensionless: rounding, or a beat's last samples.
const OVERLAP: f64 = 0.02;
/// Fraction of the usual step within which a last sample counts as the cycle's end, dimensionless.
const CLOSING: f64 = 0.25;

/// Reasons why a trace cannot be resampled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ResampleError {
    /// A periodic spline needs three knots within one cycle.
    #[error(
        "the {quantity} trace has {n_samples} samples within its cycle of {cycle_length_ms} ms, but a periodic spline needs at least 3"
    )]
    TooFew {
        /// Quantity of the trace.
        quantity: Quantity,
        /// Number of samples within one cycle.
        n_samples: usize,
        /// Cycle length of the trace \[ms\].
        cycle_length_ms: f64,
    },
    /// The samples span more than the cycle, so that it cannot repeat after it.
    #[error("the {quantity} trace spans {span_ms} ms, more than its cycle of {cycle_length_ms} ms")]
    LongerThanCycle {
        /// Quantity of the trace.
        quantity: Quantity,
        /// Time between first and last sample \[ms\].
        span_ms: f64,
        /// Cycle length of the trace \[ms\].
        cycle_length_ms: f64,
    },
    /// A step or a cycle length that is not positive.
    #[error(
        "step and cycle length must be positive, but are {step_ms} ms and {cycle_length_ms:?} ms"
    )]
    Step {
        /// Step to which the trace was to be resampled \[ms\].
        step_ms: f64,
        /// Cycle length of a periodic trace \[ms\].
        cycle_length_ms: Option<f64>,
    },
    /// The resampled values do not make a trace, for instance because a single beat is shorter than the step.
    #[error(transparent)]
    Trace(#[from] TraceError),
}

/// A trace on a grid of `step`: from 0 to before the cycle's end if periodic, from its first to its last sample if not.
///
/// # Errors
/// [`ResampleError`] when a periodic trace has fewer than three samples or spans more than its cycle, or when the step
/// or the cycle length is not positive.
pub fn resample(
    trace: &Trace,
    continuation: Continuation,
    step: Ms,
) -> Result<Trace, ResampleError> {
    let cycle_length_ms = continuation.cycle_length_ms();
    let positive = |x: f64| x.is_finite() && x > 0.0;
    if !positive(step.0) || cycle_length_ms.is_some_and(|t| !positive(t)) {
        return Err(ResampleError::Step {
            step_ms: step.0,
            cycle_length_ms,
        });
    }
    match cycle_length_ms {
        Some(period) => periodic(trace, period, step.0),
        None => single(trace, step.0),
    }
}

fn periodic(trace: &Trace, period_ms: f64, step_ms: f64) -> Result<Trace, ResampleError> {
    let quantity = trace.quantity();
    let (mut time, mut values) = (trace.time_ms(), trace.values());
    let span_ms = trace.end_ms() - time[0];
    if span_ms > period_ms * (1.0 + OVERLAP) {
        return Err(ResampleError::LongerThanCycle {
            quantity,
            span_ms,
            cycle_length_ms: period_ms,
        });
    }
    // A sample at the cycle's end or just before it is the first one again: two knots so near would bend the spline.
    let usual_step = span_ms / (time.len() - 1) as f64;
    let n = time.partition_point(|t| t - time[0] < period_ms - CLOSING * usual_step);
    (time, values) = (&time[..n], &values[..n]);
    if time.len() < 3 {
        return Err(ResampleError::TooFew {
            quantity,
            n_samples: time.len(),
            cycle_length_ms: period_ms,
        });
    }
    // A grid point within a millionth of a step of the cycle's end would be time zero again.
    let n_grid = ((period_ms / step_ms - 1e-6).floor() as usize) + 1;
    let grid: Vec<f64> = (0..n_grid).map(|i| i as f64 * step_ms).collect();
    if is_on(&grid, time) {
        return Ok(Trace::new(quantity, time.to_vec(), values.to_vec())?);
    }
    let spline = PeriodicSpline::through(time, values, period_ms);
    let values = grid.iter().map(|t| spline.at(*t)).collect();
    Ok(Trace::new(quantity, grid, values)?)
}

fn single(trace: &Trace, step_ms: f64) -> Result<Trace, ResampleError> {
    let (time, values) = (trace.time_ms(), trace.values());
    let begin = time[0];
    let n_grid = (((trace.end_ms() - begin) / step_ms + 1e-6).floor() as usize) + 1;
    let mut grid: Vec<f64> = (0..n_grid).map(|i| begin + i as f64 * step_ms).collect();
    // The beat's end is kept even where it falls between grid points: biomarkers not reached are taken there.
    if trace.end_ms() - grid[n_grid - 1] > 1e-6 * step_ms {
        grid.push(trace.end_ms());
    }
    if is_on(&grid, time) {
        return Ok(trace.clone());
    }
    let slopes = monotone_slopes(time, values);
    let mut j = 0;
    let resampled = grid
        .iter()
        .map(|t| {
            while j + 2 < time.len() && *t >= time[j + 1] {
                j += 1;
            }
            hermite(
                [time[j], time[j + 1]],
                [values[j], values[j + 1]],
                [slopes[j], slopes[j + 1]],
                *t,
            )
        })
        .collect();
    Ok(Trace::new(trace.quantity(), grid, resampled)?)
}

fn is_on(grid: &[f64], time: &[f64]) -> bool {
    grid.len() == time.len() && grid.iter().zip(time).all(|(g, t)| (g - t).abs() < 1e-9)
}

/// Cubic spline through periodic knots, twice continuously differentiable everywhere.
struct PeriodicSpline<'a> {
    time: &'a [f64],
    values: &'a [f64],
    /// Second derivatives at the knots.
    second: Vec<f64>,
    period: f64,
}

impl<'a> PeriodicSpline<'a> {
    fn through(time: &'a [f64], values: &'a [f64], period: f64) -> Self {
        let n = time.len();
        let width = |i: usize| {
            if i + 1 < n {
                time[i + 1] - time[i]
            } else {
                time[0] + period - time[n - 1]
            }
        };
        let slope = |i: usize| (values[(i + 1) % n] - values[i]) / width(i);
        // h[i-1] m[i-1] + 2 (h[i-1] + h[i]) m[i] + h[i] m[i+1] = 6 (slope[i] - slope[i-1]), cyclic.
        let before = |i: usize| (i + n - 1) % n;
        let lower: Vec<f64> = (0..n).map(|i| width(before(i))).collect();
        let upper: Vec<f64> = (0..n).map(width).collect();
        let diagonal: Vec<f64> = (0..n).map(|i| 2.0 * (lower[i] + upper[i])).collect();
        let rhs: Vec<f64> = (0..n)
            .map(|i| 6.0 * (slope(i) - slope(before(i))))
            .collect();
        Self {
            time,
            values,
            second: solve_cyclic(&lower, diagonal, &upper, &rhs),
            period,
        }
    }

    fn at(&self, t: f64) -> f64 {
        let n = self.time.len();
        let t = self.time[0] + (t - self.time[0]).rem_euclid(self.period);
        let i = self.time.partition_point(|k| *k <= t) - 1;
        let next = (i + 1) % n;
        let end = if i + 1 < n {
            self.time[i + 1]
        } else {
            self.time[0] + self.period
        };
        let h = end - self.time[i];
        let (a, b) = ((end - t) / h, (t - self.time[i]) / h);
        a * self.values[i]
            + b * self.values[next]
            + ((a * a * a - a) * self.second[i] + (b * b * b - b) * self.second[next]) * h * h / 6.0
    }
}

/// Cyclic tridiagonal system by Sherman and Morrison's formula; the matrix is diagonally dominant.
fn solve_cyclic(lower: &[f64], mut diagonal: Vec<f64>, upper: &[f64], rhs: &[f64]) -> Vec<f64> {
    let n = rhs.len();
    let gamma = -diagonal[0];
    let (corner_low, corner_up) = (upper[n - 1], lower[0]);
    diagonal[0] -= gamma;
    diagonal[n - 1] -= corner_low * corner_up / gamma;
    let mut u = vec![0.0; n];
    u[0] = gamma;
    u[n - 1] = corner_low;
    let x = solve_tridiagonal(lower, &diagonal, upper, rhs);
    let z = solve_tridiagonal(lower, &diagonal, upper, &u);
    let factor =
        (x[0] + corner_up * x[n - 1] / gamma) / (1.0 + z[0] + corner_up * z[n - 1] / gamma);
    x.iter().zip(&z).map(|(x, z)| x - factor * z).collect()
}

fn solve_tridiagonal(lower: &[f64], diagonal: &[f64], upper: &[f64], rhs: &[f64]) -> Vec<f64> {
    let n = rhs.len();
    let mut scratch = vec![0.0; n];
    let mut x = vec![0.0; n];
    let mut pivot = diagonal[0];
    x[0] = rhs[0] / pivot;
    for i in 1..n {
        scratch[i] = upper[i - 1] / pivot;
        pivot = diagonal[i] - lower[i] * scratch[i];
        x[i] = (rhs[i] - lower[i] * x[i - 1]) / pivot;
    }
    for i in (0..n - 1).rev() {
        x[i] -= scratch[i + 1] * x[i + 1];
    }
    x
}

/// Knot slopes of the monotone cubic of Fritsch and Butland 1984 (SIAM J. Sci. Stat. Comput. 5:300, eq. 5).
fn monotone_slopes(time: &[f64], values: &[f64]) -> Vec<f64> {
    let n = time.len();
    let h: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = values
        .windows(2)
        .zip(&h)
        .map(|(w, h)| (w[1] - w[0]) / h)
        .collect();
    let mut slopes = vec![0.0; n];
    slopes[0] = d[0];
    slopes[n - 1] = d[n - 2];
    for i in 1..n - 1 {
        if d[i - 1] * d[i] > 0.0 {
            let (w1, w2) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            slopes[i] = (w1 + w2) / (w1 / d[i - 1] + w2 / d[i]);
        }
    }
    slopes
}

fn hermite(t: [f64; 2], v: [f64; 2], m: [f64; 2], at: f64) -> f64 {
    let h = t[1] - t[0];
    let s = (at - t[0]) / h;
    let (s2, s3) = (s * s, s * s * s);
    v[0] * (2.0 * s3 - 3.0 * s2 + 1.0)
        + h * m[0] * (s3 - 2.0 * s2 + s)
        + v[1] * (3.0 * s2 - 2.0 * s3)
        + h * m[1] * (s3 - s2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn frames(n: usize, period: f64) -> Trace {
        let time: Vec<f64> = (0..n).map(|i| i as f64 * period / n as f64).collect();
        let values = time
            .iter()
            .map(|t| 100.0 + 30.0 * (TAU * t / period).cos())
            .collect();
        Trace::new(Quantity::Volume, time, values).unwrap()
    }

    #[test]
    fn periodic_spline_converges_with_fourth_order() {
        let period = 852.6;
        let error = |n: usize| {
            let r = resample(&frames(n, period), Continuation::periodic(Ms(period)), STEP).unwrap();
            assert_eq!(r.n_samples(), 853);
            let exact = |t: &f64| 100.0 + 30.0 * (TAU * t / period).cos();
            r.time_ms()
                .iter()
                .zip(r.values())
                .map(|(t, v)| (v - exact(t)).abs())
                .fold(0.0, f64::max)
        };
        let order = (error(20) / error(40)).log2();
        assert!((order - 4.0).abs() < 0.2, "order {order}");
    }

    #[test]
    fn samples_on_the_grid_pass_unchanged() {
        let t = Trace::uniform(Quantity::Pressure, 1.0, vec![8.0, 9.0, 7.5, 8.1]).unwrap();
        assert_eq!(
            resample(&t, Continuation::periodic(Ms(4.0)), STEP).unwrap(),
            t
        );
        assert_eq!(resample(&t, Continuation::Single, STEP).unwrap(), t);
    }

    #[test]
    fn a_single_beat_is_not_wrapped() {
        // The end differs widely from the beginning: a periodic curve would bend there.
        let values: Vec<f64> = (0..=50).map(|i| 100.0 - f64::from(i)).collect();
        let t = Trace::uniform(Quantity::Volume, 2.0, values).unwrap();
        let r = resample(&t, Continuation::Single, STEP).unwrap();
        assert_eq!(r.n_samples(), 101);
        for (t, v) in r.time_ms().iter().zip(r.values()) {
            assert!((v - (100.0 - t / 2.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn the_end_of_a_single_beat_is_kept() {
        let t = Trace::new(Quantity::Volume, vec![0.0, 1.5, 3.4], vec![1.0, 2.0, 3.0]).unwrap();
        assert_eq!(
            resample(&t, Continuation::Single, STEP).unwrap().time_ms(),
            [0.0, 1.0, 2.0, 3.0, 3.4]
        );
    }

    #[test]
    fn samples_at_the_cycles_end_are_the_first_again() {
        let period = 852.4;
        // 854 samples: those at 852.4 and beyond belong to the next beat, the one at 852 is kept.
        let f = |t: f64| 60.0 + 50.0 * (TAU * t / period).sin();
        let t = Trace::uniform(
            Quantity::Pressure,
            1.0,
            (0..854).map(|i| f(f64::from(i))).collect(),
        )
        .unwrap();
        let r = resample(&t, Continuation::periodic(Ms(period)), STEP).unwrap();
        assert_eq!((r.n_samples(), r.end_ms()), (853, 852.0));
        // A closing frame with noise, 0.01 ms early, must not bend the curve.
        let mut frames: Vec<(f64, f64)> = (0..30)
            .map(|i| f64::from(i) * period / 30.0)
            .map(|t| (t, f(t)))
            .collect();
        frames.push((period - 0.01, f(0.0) + 2.0));
        let (time, values) = frames.into_iter().unzip();
        let noisy = Trace::new(Quantity::Volume, time, values).unwrap();
        let r = resample(&noisy, Continuation::periodic(Ms(period)), STEP).unwrap();
        assert!(
            r.time_ms()
                .iter()
                .zip(r.values())
                .all(|(t, v)| (v - f(*t)).abs() < 0.1)
        );
    }

    #[test]
    fn what_cannot_repeat_is_refused() {
        let t = Trace::uniform(Quantity::Volume, 10.0, vec![1.0, 2.0, 3.0, 2.0]).unwrap();
        assert!(matches!(
            resample(&t, Continuation::periodic(Ms(25.0)), STEP),
            Err(ResampleError::LongerThanCycle { .. })
        ));
        let two = Trace::uniform(Quantity::Volume, 10.0, vec![1.0, 2.0]).unwrap();
        assert!(matches!(
            resample(&two, Continuation::periodic(Ms(25.0)), STEP),
            Err(ResampleError::TooFew { n_samples: 2, .. })
        ));
        assert!(resample(&t, Continuation::Single, Ms(0.0)).is_err());
        assert!(resample(&t, Continuation::periodic(Ms(f64::NAN)), STEP).is_err());
    }

    proptest! {
        #[test]
        fn monotone_cubic_stays_between_neighbours(values in prop::collection::vec(-50.0..150.0f64, 4..30)) {
            let t = Trace::uniform(Quantity::Pressure, 7.0, values.clone()).unwrap();
            let r = resample(&t, Continuation::Single, STEP).unwrap();
            for (time, v) in r.time_ms().iter().zip(r.values()) {
                let i = ((time / 7.0) as usize).min(values.len() - 2);
                let (lo, hi) = (values[i].min(values[i + 1]), values[i].max(values[i + 1]));
                prop_assert!(*v >= lo - 1e-9 && *v <= hi + 1e-9);
            }
        }

        #[test]
        fn periodic_spline_goes_through_its_knots_wherever_the_cycle_begins(
            values in prop::collection::vec(20.0..150.0f64, 5..30), shift in 0usize..30,
        ) {
            let n = values.len();
            let period = 25.0 * n as f64;
            let rotated: Vec<f64> = (0..n).map(|i| values[(i + shift) % n]).collect();
            let periodic = Continuation::periodic(Ms(period));
            let a = resample(&Trace::uniform(Quantity::Volume, 25.0, values.clone()).unwrap(), periodic, STEP).unwrap();
            let b = resample(&Trace::uniform(Quantity::Volume, 25.0, rotated).unwrap(), periodic, STEP).unwrap();
            for (i, v) in values.iter().enumerate() {
                prop_assert!((a.values()[25 * i] - v).abs() < 1e-9);
            }
            let m = a.n_samples();
            for i in 0..m {
                prop_assert!((a.values()[(i + 25 * shift) % m] - b.values()[i]).abs() < 1e-8);
            }
        }
    }
}
