//! Catheter response: delay and ringing of a fluid-filled catheter.

use super::EffectError;
use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::measurement::{MeasurementTerm, PeriodicTraces, delay};
use cardiotwin_vocabulary::measurements::Measurement;
use std::f64::consts::TAU;

/// Catalogue entry of the catheter response.
pub const EFFECT: Effect = Effect {
    name: "catheter_response",
    kind: Kind::Artefact,
    meaning: "The catheter's fluid and tubing follow the pressure late, with ringing or rounded corners.",
    equation: "y'' + 2 ζ ω y' + ω² y = ω² P(t − lag), ω = 2π/period; the measured pressure is y",
    source: "Our values. The abstract of Gardner 1981, Anesthesiology 54:227 (errors by too little and too much damping), does not have them",
    parameters: &[
        Parameter {
            name: "natural_period_ms",
            unit: "ms",
            meaning: "natural period, 1000 over the natural frequency in Hz; 25 ms is 40 Hz",
            range: (0.0, 140.0),
            off: Some(0.0),
            smallest: 33.0,
            typical: 65.0,
            prior_scale: 35.0,
            role: Role::Strength,
        },
        Parameter {
            name: "damping",
            unit: "1",
            meaning: "damping ratio ζ; below 0.6 it rings",
            range: (0.1, 2.0),
            off: None,
            smallest: 0.0,
            typical: 0.3,
            prior_scale: 0.4,
            role: Role::Shape,
        },
        Parameter {
            name: "lag_ms",
            unit: "ms",
            meaning: "pure delay of tubing and amplifier",
            range: (0.0, 20.0),
            off: Some(0.0),
            smallest: 0.0,
            typical: 3.0,
            prior_scale: 3.0,
            role: Role::Shape,
        },
    ],
    signature: "underdamped: overshoot after the upstroke, a brief drop after the first peak, undershoot after the fall; \
                overdamped: all corners late and round against the volume",
    marks: &[
        Mark {
            phase: Phase::IsovolumicContraction,
            signal: Signal::Pressure,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
    ],
    confused_with: &["pv_misalignment", "delayed_relaxation", "dyssynchrony"],
    separated_by: &[
        Measurement::ValveTimes.words(),
        Measurement::Qrs.words(),
        "flush test of the catheter",
        "a catheter with its sensor at the tip",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: Some(
        "correct the pressure trace for the catheter's natural frequency and damping (flush test), then run again",
    ),
    action: Action::Measurement(make),
};

/// Second-order system with unit static gain.
#[derive(Debug)]
struct Catheter {
    period_ms: f64,
    damping: f64,
    lag_ms: f64,
}

type Matrix = [[f64; 2]; 2];

/// Solution of `x' = A x` from the unit vectors after time `t`, for `A = [[0, 1], [−ω², −2ζω]]`.
fn propagator(omega: f64, zeta: f64, t: f64) -> Matrix {
    // e^{−ζωt} (c + …), where c and s/ν change from cosine to hyperbolic cosine at ζ = 1.
    let (decay, square) = (zeta * omega, (1.0 - zeta * zeta) * omega * omega);
    let nu = square.abs().sqrt();
    let (c, s_over_nu) = if nu * t < 1e-6 {
        (1.0, t)
    } else if square > 0.0 {
        ((nu * t).cos(), (nu * t).sin() / nu)
    } else {
        ((nu * t).cosh(), (nu * t).sinh() / nu)
    };
    let e = (-decay * t).exp();
    [
        [e * (c + decay * s_over_nu), e * s_over_nu],
        [-e * omega * omega * s_over_nu, e * (c - decay * s_over_nu)],
    ]
}

impl Catheter {
    /// Exact periodic response to periodic samples joined by straight lines.
    fn respond(&self, samples: &mut [f64], spacing_ms: f64) {
        let (h, omega, zeta) = (spacing_ms, TAU / self.period_ms, self.damping);
        let e = propagator(omega, zeta, h);
        // The particular solution for the ramp u + g t is y = u + g (t − 2ζ/ω), y' = g.
        let shift = 2.0 * zeta / omega;
        let step = |x: [f64; 2], u: f64, next: f64| {
            let g = (next - u) / h;
            let d = [x[0] - (u - g * shift), x[1] - g];
            [
                e[0][0] * d[0] + e[0][1] * d[1] + next - g * shift,
                e[1][0] * d[0] + e[1][1] * d[1] + g,
            ]
        };
        let n = samples.len();
        let cycle = |mut x: [f64; 2]| {
            for i in 0..n {
                x = step(x, samples[i], samples[(i + 1) % n]);
            }
            x
        };
        // The map over a cycle is affine, x = M x + c, and its linear part is the propagator over
        // the cycle.
        let constant = cycle([0.0, 0.0]);
        let m = propagator(omega, zeta, h * n as f64);
        let a = [[1.0 - m[0][0], -m[0][1]], [-m[1][0], 1.0 - m[1][1]]];
        let det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
        let mut x = [
            (a[1][1] * constant[0] - a[0][1] * constant[1]) / det,
            (a[0][0] * constant[1] - a[1][0] * constant[0]) / det,
        ];
        let first = samples[0];
        for i in 0..n {
            let next = if i + 1 < n { samples[i + 1] } else { first };
            let out = x[0];
            x = step(x, samples[i], next);
            samples[i] = out;
        }
    }
}

impl MeasurementTerm for Catheter {
    fn apply(&self, traces: &mut PeriodicTraces) {
        let spacing = traces.spacing_ms();
        if self.lag_ms != 0.0 {
            delay(&mut traces.pressure_mmhg, self.lag_ms / spacing);
        }
        // A period of less than a thousandth of the sample spacing does not filter, and its
        // exponentials would underflow.
        if self.period_ms > 1e-3 * spacing {
            self.respond(&mut traces.pressure_mmhg, spacing);
        }
    }

    /// Inverts the response harmonic by harmonic, `P_k = H* y_k (1 + λ) / (|H|² + λ)`. Where the
    /// catheter transmits little, mostly noise remains, and Tikhonov regularisation keeps it from
    /// being amplified.
    fn remove(&self, traces: &mut PeriodicTraces) {
        let samples = &mut traces.pressure_mmhg;
        let n = samples.len();
        let per_sample = TAU / n as f64;
        let mean = samples.iter().sum::<f64>() / n as f64;
        let mut restored = vec![mean; n];
        for k in 1..=n / 2 {
            // Both halves of the spectrum count, except for the harmonic that is its own mirror
            // image.
            let weight = if 2 * k == n { 1.0 } else { 2.0 } / n as f64;
            let angle = |i: usize| per_sample * ((i * k) % n) as f64;
            let (mut re, mut im) = (0.0, 0.0);
            for (i, y) in samples.iter().enumerate() {
                let (sin, cos) = angle(i).sin_cos();
                re += weight * y * cos;
                im -= weight * y * sin;
            }
            // H = e^{−iωlag} / (1 − r² + 2iζr): its inverse times |H|² is its conjugate.
            let w = TAU * k as f64 / traces.cycle_length_ms;
            let r = w * self.period_ms / TAU;
            let (a, b) = (1.0 - r * r, 2.0 * self.damping * r);
            let power = 1.0 / (a * a + b * b);
            let gain = (1.0 + NOISE_SHARE) * power / (power + NOISE_SHARE);
            let (sin, cos) = (w * self.lag_ms).sin_cos();
            let (u, v) = (gain * (a * cos - b * sin), gain * (a * sin + b * cos));
            let (x, y) = (re * u - im * v, re * v + im * u);
            for (i, out) in restored.iter_mut().enumerate() {
                let (sin, cos) = angle(i).sin_cos();
                *out += x * cos - y * sin;
            }
        }
        *samples = restored;
    }
}

/// Power of the noise over that of the pressure in the inversion; no harmonic is amplified more
/// than fivefold.
const NOISE_SHARE: f64 = 0.01;

fn make(values: &[f64]) -> Result<Box<dyn MeasurementTerm>, EffectError> {
    Ok(Box::new(Catheter {
        period_ms: values[0],
        damping: values[1],
        lag_ms: values[2],
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn traces(n: usize, p: impl Fn(f64) -> f64) -> PeriodicTraces {
        let pressure_mmhg = (0..n).map(|i| p(i as f64 * 800.0 / n as f64)).collect();
        PeriodicTraces {
            cycle_length_ms: 800.0,
            pressure_mmhg,
            volume_ml: vec![0.0; n],
        }
    }

    #[test]
    fn sinusoid_has_the_gain_and_phase_of_a_second_order_system() {
        for (period_ms, damping) in [(60.0, 0.2), (60.0, 1.0), (90.0, 1.5), (30.0, 0.7)] {
            let w = 5.0 * TAU / 800.0;
            let mut t = traces(1600, |t| 50.0 + 40.0 * (w * t).cos());
            Catheter {
                period_ms,
                damping,
                lag_ms: 0.0,
            }
            .apply(&mut t);
            let ratio = w * period_ms / TAU;
            let (re, im) = (1.0 - ratio * ratio, 2.0 * damping * ratio);
            let (gain, phase) = (1.0 / re.hypot(im), -im.atan2(re));
            for (i, found) in t.pressure_mmhg.iter().enumerate() {
                let expected = 50.0 + 40.0 * gain * (w * i as f64 * 0.5 + phase).cos();
                assert!(
                    (found - expected).abs() < 0.01,
                    "{period_ms} {damping} {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn step_overshoots_by_the_closed_form() {
        // A step overshoots by e^{−πζ/√(1−ζ²)}; the square wave is long compared with the ringing.
        let mut t = traces(8000, |t| if t < 400.0 { 100.0 } else { 0.0 });
        Catheter {
            period_ms: 40.0,
            damping: 0.3,
            lag_ms: 0.0,
        }
        .apply(&mut t);
        let peak = t.pressure_mmhg.iter().copied().fold(0.0, f64::max);
        let expected = 100.0 * (1.0 + (-std::f64::consts::PI * 0.3 / (1.0f64 - 0.09).sqrt()).exp());
        assert!((peak - expected).abs() < 0.1, "{peak} {expected}");
    }

    #[test]
    fn a_lag_alone_is_a_delay_and_the_mean_stays() {
        let p = |t: f64| 60.0 + 50.0 * (TAU * t / 800.0).sin();
        let mut t = traces(800, p);
        Catheter {
            period_ms: 0.0,
            damping: 0.3,
            lag_ms: 10.0,
        }
        .apply(&mut t);
        assert!((t.pressure_mmhg[100] - p(90.0)).abs() < 1e-9);
        let mut t = traces(800, p);
        Catheter {
            period_ms: 70.0,
            damping: 0.4,
            lag_ms: 5.0,
        }
        .apply(&mut t);
        assert!((t.pressure_mmhg.iter().sum::<f64>() / 800.0 - 60.0).abs() < 1e-9);
    }

    /// A pulse with Gaussian flanks has little content above 20 Hz.
    #[test]
    fn what_the_catheter_did_is_taken_back() {
        let p = |t: f64| 8.0 + 110.0 * (-((t - 300.0) / 60.0).powi(4)).exp();
        for (period_ms, damping, lag_ms) in [(60.0, 0.25, 4.0), (70.0, 1.2, 0.0), (0.0, 0.3, 10.0)]
        {
            let mut t = traces(800, p);
            let catheter = Catheter {
                period_ms,
                damping,
                lag_ms,
            };
            catheter.apply(&mut t);
            let error = |t: &PeriodicTraces| {
                let square = |(i, found): (usize, &f64)| (found - p(i as f64)).powi(2);
                (t.pressure_mmhg.iter().enumerate().map(square).sum::<f64>() / 800.0).sqrt()
            };
            let before = error(&t);
            catheter.remove(&mut t);
            assert!(
                error(&t) < 0.12 * before && before > 2.0,
                "{period_ms} {damping} {before} {}",
                error(&t)
            );
        }
    }
}
