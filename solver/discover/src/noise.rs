//! Noise of the traces: its level according to the data, and its covariance.
//!
//! Pressure noise of an averaged beat is coloured: an Ornstein–Uhlenbeck process with rms σ and
//! correlation time τ. Its spectrum above about 60 Hz, where a ventricle has no signal, shows σ²/τ
//! without any model.

use crate::measured::{Measured, STATED_NOISE_SD};
use crate::usual;
use nalgebra::DMatrix;
use std::f64::consts::TAU;

pub use crate::signal::{Signal, Whitener};

/// Noise of a volume frame if the file states none \[mL\].
const USUAL_VOLUME_RMS_ML: f64 = 2.5;
/// Frequency band in which the pressure contains only noise \[Hz\].
const NOISE_BAND_HZ: (f64, f64) = (70.0, 400.0);
/// Largest logarithm of observed over stated noise power at which the observation is used. Beyond
/// it the stated value is kept, because a smoothed or interpolated trace shows less noise than its
/// actual uncertainty.
const BELIEVABLE_LOG_RATIO: f64 = 0.9;

/// Noise levels of the fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseLevels {
    /// Rms of the pressure noise \[mmHg\].
    pub pressure_rms_mmhg: f64,
    /// Correlation time of the pressure noise \[ms\].
    pub pressure_correlation_ms: f64,
    /// Rms of the noise of a volume frame \[mL\].
    pub volume_rms_ml: f64,
    /// Noise power in the pressure's high band over the stated power; `None` if it was not used.
    pub seen_over_stated: Option<f64>,
}

impl NoiseLevels {
    /// Combines stated levels with the pressure's high band. If σ²/τ is observed and both stated
    /// values are equally uncertain, the most probable correction is +2/5 of the log ratio to σ and
    /// −1/5 to τ.
    #[must_use]
    pub fn of(measured: &Measured) -> Self {
        let volume_rms_ml = measured.noise.volume_rms_ml.unwrap_or(USUAL_VOLUME_RMS_ML);
        let tau = measured
            .noise
            .pressure_correlation_ms
            .unwrap_or(usual::CORRELATION_MS);
        let seen = high_band_power(measured, tau);
        let (mut rms, mut correlation) = (measured.noise.pressure_rms_mmhg.unwrap_or(1.0), tau);
        let mut seen_over_stated = None;
        match (seen, measured.noise.pressure_rms_mmhg) {
            (Some(variance), None) => rms = variance.sqrt().max(0.05),
            (Some(variance), Some(stated)) => {
                let log_ratio = (variance / (stated * stated)).ln();
                if log_ratio.abs() <= BELIEVABLE_LOG_RATIO {
                    rms = stated * (0.4 * log_ratio).exp();
                    correlation = tau * (-0.2 * log_ratio).exp();
                    seen_over_stated = Some(log_ratio.exp());
                }
            }
            (None, _) => {}
        }
        Self {
            pressure_rms_mmhg: rms,
            pressure_correlation_ms: correlation,
            volume_rms_ml,
            seen_over_stated,
        }
    }
}

/// Variance of an Ornstein–Uhlenbeck process with correlation time `tau_ms` and the power observed
/// in the noise band; `None` if the samples are not on a sufficiently fine uniform grid.
fn high_band_power(measured: &Measured, tau_ms: f64) -> Option<f64> {
    let (time, p) = (&measured.pressure_time_ms[..], &measured.pressure_mmhg[..]);
    let n = p.len();
    let step = (time[n - 1] - time[0]) / (n - 1) as f64;
    let uniform = time
        .windows(2)
        .all(|w| (w[1] - w[0] - step).abs() < 0.01 * step);
    if !uniform || step > 1.3 {
        return None;
    }
    // The jump from the last sample to the first would leak into all frequencies.
    let slope = (p[n - 1] - p[0]) / (n - 1) as f64;
    let flat: Vec<f64> = p
        .iter()
        .enumerate()
        .map(|(i, x)| x - p[0] - slope * i as f64)
        .collect();
    let rho = (-step / tau_ms).exp();
    let length_s = n as f64 * step * 1e-3;
    let top = NOISE_BAND_HZ.1.min(0.45e3 / step);
    let (first, last) = (
        (NOISE_BAND_HZ.0 * length_s).ceil() as usize,
        (top * length_s) as usize,
    );
    let mut ratio = 0.0;
    for k in first..=last {
        let w = TAU * k as f64 / n as f64;
        // Goertzel's recurrence.
        let coefficient = 2.0 * w.cos();
        let (mut s1, mut s2) = (0.0, 0.0);
        for x in &flat {
            (s1, s2) = (x + coefficient * s1 - s2, s1);
        }
        let power = (s1 * s1 + s2 * s2 - coefficient * s1 * s2) / n as f64;
        ratio += power * (1.0 - 2.0 * rho * w.cos() + rho * rho) / (1.0 - rho * rho);
    }
    (last > first + 20).then(|| ratio / (last - first + 1) as f64)
}

/// Errors of data and model that mean nothing is missing, and what is known of the noise.
///
/// They are part of the covariance, so that neither a timing error of one or two milliseconds nor a
/// smooth bend of half a mmHg is mistaken for an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorModel {
    /// Standard deviation of the logarithm of a stated noise level.
    pub stated_noise: f64,
    /// Correlation of neighbouring frames, because one segmentation helps the next.
    pub frame_correlation: f64,
    /// Standard deviation of the timing error \[ms\], correlated over
    /// [`Self::timing_correlation_ms`].
    pub timing_ms: f64,
    /// Correlation time of the timing error \[ms\].
    pub timing_correlation_ms: f64,
    /// Standard deviation of the smooth pressure error \[mmHg\].
    pub pressure_mmhg: f64,
    /// Correlation time of the smooth pressure error \[ms\].
    pub pressure_correlation_ms: f64,
    /// Standard deviation of the smooth volume error \[mL\].
    pub volume_ml: f64,
    /// Correlation time of the smooth volume error \[ms\].
    pub volume_correlation_ms: f64,
    /// Standard deviation of the offset of the whole pressure trace \[mmHg\], typical of any
    /// catheter.
    pub offset_mmhg: f64,
    /// Standard deviation of the shift of all frames against the pressure \[ms\], typical of any
    /// trigger.
    pub shift_ms: f64,
    /// Standard deviation of the common factor of all frames, minus one.
    pub scale: f64,
    /// Factor of the smooth errors of further traces and of beats under changed load
    /// ([`crate::channel`]).
    pub further: f64,
    /// Errors of the nameless competitors.
    pub competitors: CompetitorErrors,
}

/// Standard deviations of the errors by which the nameless competitors explain a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompetitorErrors {
    /// Logarithm of each factor of the activation.
    pub activation: f64,
    /// Smooth error of pressure \[mmHg\].
    pub pressure_mmhg: f64,
    /// Smooth error of volume \[mL\].
    pub volume_ml: f64,
    /// Factor of the smooth errors of further traces and of beats under changed load.
    pub further: f64,
}

impl Default for CompetitorErrors {
    fn default() -> Self {
        Self {
            activation: 0.15,
            pressure_mmhg: 2.0,
            volume_ml: 3.0,
            further: 3.0,
        }
    }
}

impl Default for ErrorModel {
    fn default() -> Self {
        Self {
            stated_noise: STATED_NOISE_SD,
            frame_correlation: 0.2,
            timing_ms: 0.5,
            timing_correlation_ms: 15.0,
            pressure_mmhg: 0.3,
            pressure_correlation_ms: 40.0,
            volume_ml: 0.5,
            volume_correlation_ms: 60.0,
            // Half of the values that deserve a name (notes of the catalogue: 2 mmHg, 8 ms, 4 %).
            offset_mmhg: 1.0,
            shift_ms: 4.0,
            scale: 0.02,
            further: 1.0,
            competitors: CompetitorErrors::default(),
        }
    }
}

impl ErrorModel {
    /// The same with the smooth errors of the nameless competitor.
    #[must_use]
    pub fn with_smooth_errors(&self) -> Self {
        Self {
            pressure_mmhg: self.competitors.pressure_mmhg,
            volume_ml: self.competitors.volume_ml,
            further: self.further * self.competitors.further,
            ..*self
        }
    }

    /// Degrees of freedom of the prior knowledge of a stated noise level.
    #[must_use]
    pub fn stated_degrees(&self) -> f64 {
        0.5 / (self.stated_noise * self.stated_noise)
    }
}

/// Width of a pressure bin \[ms\].
pub const BIN_MS: f64 = 4.0;

/// Indices of the samples in each bin of a cycle; empty bins are left out.
pub(crate) fn bins(time_ms: &[f64], cycle_ms: f64) -> Vec<Vec<usize>> {
    let n_bins = (cycle_ms / BIN_MS).floor() as usize;
    let width = cycle_ms / n_bins as f64;
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); n_bins];
    for (i, t) in time_ms.iter().enumerate() {
        members[((t / width) as usize).min(n_bins - 1)].push(i);
    }
    members.retain(|m| !m.is_empty());
    members
}

/// Mean of the values of each bin.
pub(crate) fn means(members: &[Vec<usize>], values: &[f64]) -> Vec<f64> {
    let mean = |m: &Vec<usize>| m.iter().map(|i| values[*i]).sum::<f64>() / m.len() as f64;
    members.iter().map(mean).collect()
}

/// Correlation of the means of two bins under an Ornstein–Uhlenbeck process.
///
/// - `dt_ms`: distance of the bins' centres
pub(crate) fn correlation(
    [a, b]: [&[usize]; 2],
    time_ms: &[f64],
    dt_ms: f64,
    correlation_ms: f64,
) -> f64 {
    // Distant bins use their centres; the mean over the samples differs by a thousandth.
    if dt_ms > 6.0 * correlation_ms {
        return (-dt_ms / correlation_ms).exp();
    }
    let mut sum = 0.0;
    for i in a {
        for j in b {
            sum += (-(time_ms[*i] - time_ms[*j]).abs() / correlation_ms).exp();
        }
    }
    sum / (a.len() * b.len()) as f64
}

/// Bins of the pressure with coloured noise and model discrepancy.
#[must_use]
pub fn pressure_signal(
    measured: &Measured,
    levels: &NoiseLevels,
    error_model: &ErrorModel,
) -> Signal {
    let members = bins(&measured.pressure_time_ms, measured.cycle_ms);
    let time = means(&members, &measured.pressure_time_ms);
    let value = means(&members, &measured.pressure_mmhg);
    let slope = slopes(&time, &value, 10.0);
    let (rms, tau) = (levels.pressure_rms_mmhg, levels.pressure_correlation_ms);
    let n = members.len();
    let mut covariance = DMatrix::zeros(n, n);
    for i in 0..n {
        for j in 0..=i {
            let dt = time[i] - time[j];
            let both = [&members[i][..], &members[j][..]];
            let noise = correlation(both, &measured.pressure_time_ms, dt, tau);
            let timing = error_model.timing_ms.powi(2)
                * slope[i]
                * slope[j]
                * bell(dt, error_model.timing_correlation_ms);
            let smooth =
                error_model.pressure_mmhg.powi(2) * bell(dt, error_model.pressure_correlation_ms);
            let c = rms * rms * noise + timing + smooth + error_model.offset_mmhg.powi(2);
            covariance[(i, j)] = c;
            covariance[(j, i)] = c;
        }
    }
    Signal::new(time, value, rms, covariance, 0.0)
}

/// Half-width of the interval of the straight line that gives the slope of the frames \[ms\].
pub(crate) const VOLUME_SLOPE_MS: f64 = 45.0;

/// Volume frames with weakly correlated noise and model discrepancy.
#[must_use]
pub fn volume_signal(
    measured: &Measured,
    levels: &NoiseLevels,
    error_model: &ErrorModel,
) -> Signal {
    let time = measured.frame_time_ms.clone();
    let value = measured.frame_volume_ml.clone();
    let slope = slopes(&time, &value, VOLUME_SLOPE_MS);
    let n = time.len();
    let rms = levels.volume_rms_ml;
    let covariance = DMatrix::from_fn(n, n, |i, j| {
        let dt = time[i] - time[j];
        let noise = rms
            * rms
            * error_model
                .frame_correlation
                .powi((i as i32 - j as i32).abs());
        let timing = error_model.timing_ms.powi(2)
            * slope[i]
            * slope[j]
            * bell(dt, error_model.timing_correlation_ms);
        // Slopes of the data may replace slopes of the model here. An error of the data is not
        // correlated with its own slope, so that a shift biases no fit to one side.
        let shift = error_model.shift_ms.powi(2) * slope[i] * slope[j];
        noise
            + timing
            + shift
            + error_model.volume_ml.powi(2) * bell(dt, error_model.volume_correlation_ms)
    });
    Signal::new(time, value, rms, covariance, error_model.scale)
}

pub(crate) fn bell(dt: f64, length: f64) -> f64 {
    (-0.5 * (dt / length).powi(2)).exp()
}

/// Slope at each time from a straight line through the data within `half_width_ms`.
#[must_use]
pub fn slopes(time: &[f64], value: &[f64], half_width_ms: f64) -> Vec<f64> {
    time.iter()
        .map(|t0| {
            let near = || {
                time.iter()
                    .zip(value)
                    .filter(|(t, _)| (*t - t0).abs() <= half_width_ms)
            };
            let n = near().count().max(1) as f64;
            let (mean_t, mean_v) = near().fold((0.0, 0.0), |(a, b), (t, v)| (a + t / n, b + v / n));
            let (cross, square) = near().fold((0.0, 0.0), |(a, b), (t, v)| {
                (
                    a + (t - mean_t) * (v - mean_v),
                    b + (t - mean_t) * (t - mean_t),
                )
            });
            if square > 0.0 { cross / square } else { 0.0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::{SideData, Uncertain};
    use crate::random::standard_normal;
    use cardiotwin_vocabulary::trace_noise::Noise;
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    const CYCLE: usize = 900;

    fn none() -> ErrorModel {
        ErrorModel {
            timing_ms: 0.0,
            pressure_mmhg: 0.0,
            volume_ml: 0.0,
            offset_mmhg: 0.0,
            shift_ms: 0.0,
            scale: 0.0,
            ..ErrorModel::default()
        }
    }

    /// Constant pressure of 50 mmHg and volume of 100 mL, with noise alone.
    fn noise_only(rms: f64, tau: f64, stated_rms: f64, seed: u64) -> Measured {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut normal = || standard_normal(&mut random);
        let rho = (-1.0 / tau).exp();
        let mut state = rms * normal();
        let pressure_mmhg = (0..CYCLE)
            .map(|_| {
                let now = state;
                state = rho * state + rms * (1.0 - rho * rho).sqrt() * normal();
                50.0 + now
            })
            .collect();
        let correlation = ErrorModel::default().frame_correlation;
        let mut frame = 2.5 * normal();
        let frame_volume_ml = (0..30)
            .map(|_| {
                let now = frame;
                frame = correlation * frame + 2.5 * (1.0 - correlation.powi(2)).sqrt() * normal();
                100.0 + now
            })
            .collect();
        Measured {
            cycle_ms: CYCLE as f64,
            pressure_time_ms: (0..CYCLE).map(|i| i as f64).collect(),
            pressure_mmhg,
            frame_time_ms: (0..30).map(|i| 30.0 * f64::from(i)).collect(),
            frame_volume_ml,
            noise: Noise {
                pressure_rms_mmhg: Some(stated_rms),
                pressure_correlation_ms: Some(tau),
                volume_rms_ml: Some(2.5),
                ..Noise::default()
            },
            side: SideData::default(),
            wall_volume: Uncertain {
                value: 120.0,
                sd: 6.0,
            },
            given: Default::default(),
            further: Default::default(),
        }
    }

    /// Whitened noise has variance one and uncorrelated neighbours, over 20 draws of 225 bins and
    /// 30 frames.
    #[test]
    fn coloured_noise_is_white_after_whitening() {
        let (mut square, mut product, mut n) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for seed in 0..20 {
            let measured = noise_only(1.3, 11.0, 1.3, seed);
            let levels = NoiseLevels {
                pressure_rms_mmhg: 1.3,
                pressure_correlation_ms: 11.0,
                volume_rms_ml: 2.5,
                seen_over_stated: None,
            };
            let signals = [
                (pressure_signal(&measured, &levels, &none()), 50.0),
                (volume_signal(&measured, &levels, &none()), 100.0),
            ];
            for (which, (signal, mean)) in signals.iter().enumerate() {
                let residual: Vec<f64> = signal.value.iter().map(|v| v - mean).collect();
                let white = signal
                    .whitener(&vec![*mean; residual.len()])
                    .whiten(&residual);
                square[which] += white.iter().map(|w| w * w).sum::<f64>();
                product[which] += white.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
                n[which] += white.len() as f64;
            }
        }
        for which in 0..2 {
            // Four standard errors.
            let tolerance = 4.0 * (2.0 / n[which]).sqrt();
            assert!(
                (square[which] / n[which] - 1.0).abs() < tolerance,
                "{which} {}",
                square[which] / n[which]
            );
            assert!(
                (product[which] / n[which]).abs() < tolerance,
                "{which} {}",
                product[which] / n[which]
            );
        }
    }

    #[test]
    fn a_level_stated_too_low_is_raised_by_what_the_high_band_shows() {
        let levels = NoiseLevels::of(&noise_only(1.2, 10.0, 1.0, 3));
        let seen = levels.seen_over_stated.unwrap();
        assert!((seen / 1.44).ln().abs() < 0.2, "{seen}");
        assert!(
            levels.pressure_rms_mmhg > 1.08 && levels.pressure_rms_mmhg < 1.24,
            "{levels:?}"
        );
    }

    #[test]
    fn a_smoothed_trace_keeps_its_stated_uncertainty() {
        let mut measured = noise_only(1.0, 10.0, 1.0, 4);
        measured
            .pressure_mmhg
            .iter_mut()
            .for_each(|p| *p = 50.0 + 0.01 * (*p - 50.0));
        let levels = NoiseLevels::of(&measured);
        assert_eq!(
            (levels.pressure_rms_mmhg, levels.seen_over_stated),
            (1.0, None)
        );
    }

    #[test]
    fn a_part_has_its_own_covariance() {
        let measured = noise_only(1.0, 10.0, 1.0, 5);
        let signal = volume_signal(&measured, &NoiseLevels::of(&measured), &none());
        let part = signal.subset(&[0, 10, 20]);
        let white = part.whitener(&[100.0; 3]).whiten(&[2.5, 2.5, 2.5]);
        assert!(white.iter().all(|w| (w - 1.0).abs() < 1e-3), "{white:?}");
    }

    /// Misfit of a constant volume.
    fn misfit_of_constant(signal: &Signal, volume_ml: f64) -> f64 {
        let residual: Vec<f64> = signal.value.iter().map(|v| v - volume_ml).collect();
        let white = signal
            .whitener(&vec![volume_ml; residual.len()])
            .whiten(&residual);
        white.iter().map(|w| w * w).sum()
    }

    /// Constant volume with the smallest misfit \[mL\], by golden section search.
    fn best_constant(signal: &Signal, (mut low, mut high): (f64, f64)) -> f64 {
        let ratio = 0.5 * (5.0f64.sqrt() - 1.0);
        while high - low > 1e-7 * high {
            let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
            if misfit_of_constant(signal, a) < misfit_of_constant(signal, b) {
                high = b;
            } else {
                low = a;
            }
        }
        0.5 * (low + high)
    }

    /// Peelle's pertinent puzzle: for 1.5 and 1.0, each known to 10 % and both to 20 % in common,
    /// the fit is their weighted mean 1.154. With the measured values in the common term it is
    /// 0.882, below both.
    #[test]
    fn peelles_two_measurements_are_fitted_between_them() {
        let own = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![0.0225, 0.01]));
        let data = || (vec![0.0, 1.0], vec![1.5, 1.0]);
        let (time, value) = data();
        let puzzle = Signal::new(time, value, 0.1, own.clone(), 0.2);
        let best = best_constant(&puzzle, (0.2, 3.0));
        assert!((best - 1.153_846).abs() < 1e-4, "{best}");
        let (time, value) = data();
        let common = DMatrix::from_fn(2, 2, |i, j| 0.04 * value[i] * value[j]);
        let naive = Signal::new(time, value, 0.1, own + common, 0.0);
        let best = best_constant(&naive, (0.2, 3.0));
        assert!((best - 0.882_353).abs() < 1e-4, "{best}");
    }

    #[test]
    fn the_common_factor_is_a_rank_one_term_of_the_covariance() {
        let measured = noise_only(1.3, 11.0, 1.3, 6);
        let only_factor = ErrorModel {
            scale: 0.02,
            ..none()
        };
        let signal = volume_signal(&measured, &NoiseLevels::of(&measured), &only_factor);
        let model: Vec<f64> = (0..signal.len()).map(|i| 80.0 + i as f64).collect();
        let residual: Vec<f64> = (0..signal.len()).map(|i| (i as f64).sin() + 1.0).collect();
        let n = signal.len();
        let whole = &signal.covariance + DMatrix::from_fn(n, n, |i, j| 4e-4 * model[i] * model[j]);
        let r = nalgebra::DVector::from_vec(residual.clone());
        let factor = whole.cholesky().unwrap();
        let whitener = signal.whitener(&model);
        let square: f64 = whitener.whiten(&residual).iter().map(|w| w * w).sum();
        assert!((square / r.dot(&factor.solve(&r)) - 1.0).abs() < 1e-9);
        let log_determinant = signal.log_determinant + whitener.factor_log_determinant();
        assert!((log_determinant - factor.ln_determinant()).abs() < 1e-9);
        let all: Vec<usize> = (0..n).collect();
        let whole = factor.l() * factor.l().transpose();
        assert!((signal.mean_sd(&all, &model) * n as f64 / whole.sum().sqrt() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_common_volume_factor_does_not_pull_the_fit_below_the_data() {
        let only_factor = ErrorModel {
            scale: 0.02,
            ..none()
        };
        let mut ratio = 0.0;
        for seed in 0..20 {
            let measured = noise_only(1.3, 11.0, 1.3, seed);
            let levels = NoiseLevels::of(&measured);
            let without = best_constant(&volume_signal(&measured, &levels, &none()), (50.0, 150.0));
            let with = best_constant(
                &volume_signal(&measured, &levels, &only_factor),
                (50.0, 150.0),
            );
            ratio += with / without / 20.0;
        }
        assert!((ratio - 1.0).abs() < 1e-5, "{ratio}");
    }
}
