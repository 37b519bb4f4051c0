//! The hum of mains in a signal.

use crate::filter::{median, moving_average};
use crate::recording::Recording;

/// Frequencies of mains \[Hz\].
const MAINS_HZ: [f64; 2] = [50.0, 60.0];
/// Interval over which the hum of mains is fitted \[ms\]. The frequency of mains is within 0.2 Hz
/// of its nominal value, so that the phase drifts little.
const HUM_MS: f64 = 500.0;

/// A signal without the hum of mains: sines of 50 and 60 Hz are fitted by least squares
/// to pieces and taken out.
pub(crate) fn without_hum(recording: &Recording, signal: &[f64]) -> Vec<f64> {
    let mut out = signal.to_vec();
    // Slow deflections must not pass for hum.
    let slow = moving_average(signal, recording.samples(20.0));
    let piece = recording.samples(HUM_MS);
    for hz in MAINS_HZ {
        let turn = std::f64::consts::TAU * hz * recording.step_ms * 1e-3;
        if turn > 0.9 * std::f64::consts::PI {
            continue;
        }
        for begin in (0..signal.len()).step_by(piece) {
            let range = begin..(begin + piece).min(signal.len());
            let (mut cc, mut ss, mut cs, mut yc, mut ys) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for i in range.clone() {
                let y = out[i] - slow[i];
                if y.is_finite() {
                    let (s, c) = (turn * i as f64).sin_cos();
                    cc += c * c;
                    ss += s * s;
                    cs += c * s;
                    yc += y * c;
                    ys += y * s;
                }
            }
            let det = cc * ss - cs * cs;
            if det <= 1e-9 * cc.max(ss).powi(2) {
                continue;
            }
            let (a, b) = ((yc * ss - ys * cs) / det, (ys * cc - yc * cs) / det);
            for i in range {
                let (s, c) = (turn * i as f64).sin_cos();
                out[i] -= a * c + b * s;
            }
        }
    }
    out
}

/// Usual amplitude of the hum in a signal, in its unit; NaN without samples. Of a pressure without hum it is
/// some tenths of a mmHg, because its rises contain these frequencies too.
#[must_use]
pub fn amplitude(recording: &Recording, signal: &[f64]) -> f64 {
    let silent = without_hum(recording, signal);
    let squares: Vec<f64> = std::iter::zip(signal, &silent)
        .map(|(a, b)| (a - b).powi(2))
        .collect();
    let of_piece = |piece: &[f64]| {
        let finite = || piece.iter().filter(|square| square.is_finite());
        (2.0 * finite().sum::<f64>() / finite().count() as f64).sqrt()
    };
    median(squares.chunks(recording.samples(HUM_MS)).map(of_piece))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Channels;

    #[test]
    fn the_hum_of_a_pressure_has_its_amplitude() {
        let time_ms: Vec<f64> = (0..2500).map(|i| 4.0 * f64::from(i)).collect();
        for (hz, size) in [(50.0, 5.0), (60.0, 2.0), (50.0, 0.0)] {
            let beat = |t: f64| {
                let t = t % 900.0;
                let up = 1.0 / (1.0 + (-(t - 80.0) / 8.0).exp());
                110.0 * up / (1.0 + ((t - 350.0) / 15.0).exp()) + 6.0
            };
            let hum = |t: f64| size * (std::f64::consts::TAU * hz * 1e-3 * t).sin();
            let pressure: Vec<f64> = time_ms.iter().map(|t| beat(*t) + hum(*t)).collect();
            let channels = Channels {
                lv_pressure_mmhg: Some(pressure.clone()),
                ..Channels::default()
            };
            let recording = Recording::new(&time_ms, channels).unwrap();
            let found = amplitude(&recording, &pressure);
            assert!((found - size).abs() < 0.8, "{hz} Hz, {size}: {found}");
        }
    }
}
