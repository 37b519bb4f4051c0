//! Further traces and beats under changed load, with the covariance of their errors.
//!
//! Each has its own stated noise, and a smooth error of the model. The errors that were learnt on
//! healthy hearts belong to pressure and volume of the steady beat, and are not used here.

use crate::forward::{LoadedPrediction, Prediction};
use crate::further::{FurtherTrace, LoadedBeat};
use crate::measured::Measured;
use crate::noise::{
    ErrorModel, NoiseLevels, Signal, bell, bins, correlation, means, pressure_signal, slopes,
    volume_signal,
};
use cardiotwin_vocabulary::measurements::FurtherQuantity;
use nalgebra::DMatrix;

/// Errors by which the model misses a quantity although no effect is missing, and usual errors of
/// its calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Standard deviation of the smooth error of the model, in the unit of the quantity.
    pub smooth: f64,
    /// Correlation time of the smooth error \[ms\].
    pub smooth_ms: f64,
    /// Standard deviation of an offset of the whole trace, in the unit of the quantity.
    pub offset: f64,
    /// Standard deviation of the timing error \[ms\].
    pub timing_ms: f64,
    /// Standard deviation of a factor common to all values, minus one.
    pub factor: f64,
}

impl Tolerance {
    /// Errors of a quantity.
    ///
    /// The smooth errors are the larger ones that the base leaves in noise-free healthy hearts of two
    /// other formulations (`examples/tolerances`, seed 900). Both have an atrium whose walls are
    /// passive and whose base stays in its place; its error is taken to be four times as large. Pressure
    /// transducers are zeroed to 1 mmHg, and flow MRI has a factor of 5 % (the usual errors that
    /// `tests/validation` draws, too). A strain's factor depends on direction and layer of the wall.
    #[must_use]
    pub fn of(quantity: FurtherQuantity) -> Self {
        let (smooth, smooth_ms, offset, timing_ms, factor) = match quantity {
            FurtherQuantity::AorticPressure => (1.8, 40.0, 1.0, 2.0, 0.0),
            FurtherQuantity::AorticFlow => (11.0, 20.0, 2.0, 4.0, 0.05),
            FurtherQuantity::MitralFlow => (17.0, 35.0, 2.0, 4.0, 0.05),
            FurtherQuantity::AtrialPressure => (1.0, 100.0, 1.5, 4.0, 0.0),
            FurtherQuantity::Strain => (0.8, 100.0, 0.7, 4.0, 0.2),
        };
        Self {
            smooth,
            smooth_ms,
            offset,
            timing_ms,
            factor,
        }
    }
}

/// Smooth error of a pressure that is transmitted through the lungs \[mmHg\]: they damp it by 2 to
/// 4 mmHg (Eberli, in Cardiovascular Catheterization and Intervention, 2010, chapter 9, abstract).
const WEDGE_SMOOTH_MMHG: f64 = 3.0;
/// Error of the model's times of the valves \[ms\], in the order of
/// [`crate::further::ValveTimes::NAMES`]: root mean squares in healthy hearts of two other formulations
/// (`examples/tolerances`).
pub const VALVE_MODEL_SD_MS: [f64; 4] = [3.0, 3.0, 5.0, 5.0];
/// Spread of the duration of QRS among hearts that conduct normally \[ms\], our value: men have 74 to
/// 114 ms in a summary of Surawicz et al. 2009, J Am Coll Cardiol 53:976, which was not read itself.
pub const QRS_MODEL_SD_MS: f64 = 10.0;
/// Shortest half-width of the interval of the straight line that gives the slope of a trace \[ms\].
const SLOPE_MS: f64 = 10.0;

/// A further trace.
#[derive(Debug, Clone)]
pub struct Channel {
    /// Quantity that was measured.
    pub quantity: FurtherQuantity,
    /// Its data, at the times of the heart.
    pub signal: Signal,
}

/// White residuals with the logarithm of the determinant that common factors add to the noise.
#[derive(Debug, Clone, Default)]
pub struct WhiteWithFactor {
    /// Residuals of unit covariance.
    pub residuals: Vec<f64>,
    /// Logarithm of the determinant.
    pub log_determinant: f64,
}

impl WhiteWithFactor {
    fn add(&mut self, signal: &Signal, model: &[f64]) {
        let whitener = signal.whitener(model);
        self.residuals
            .extend(whitener.whiten(&signal.residual(model)));
        self.log_determinant += whitener.factor_log_determinant();
    }
}

impl Channel {
    /// Computes the covariance of a trace.
    ///
    /// - `factor`: of the smooth error
    #[must_use]
    pub fn new(trace: &FurtherTrace, cycle_ms: f64, factor: f64) -> Self {
        let members = bins(&trace.time_ms, cycle_ms);
        let time = means(&members, &trace.time_ms);
        let value = means(&members, &trace.value);
        let n = members.len();
        let spacing = cycle_ms / n as f64;
        let slope = slopes(&time, &value, SLOPE_MS.max(1.5 * spacing));
        let tolerance = Tolerance::of(trace.quantity);
        let smooth = if trace.delay.value > 0.0 {
            tolerance.smooth.max(WEDGE_SMOOTH_MMHG)
        } else {
            tolerance.smooth
        };
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let (i, j) = (i.max(j), i.min(j));
            let dt = time[i] - time[j];
            let both = [&members[i][..], &members[j][..]];
            let noise = correlation(both, &trace.time_ms, dt, trace.correlation_ms);
            let delay = trace.delay.sd.powi(2) + tolerance.timing_ms.powi(2);
            trace.rms.powi(2) * noise
                + delay * slope[i] * slope[j]
                + (factor * smooth).powi(2) * bell(dt, tolerance.smooth_ms)
                + tolerance.offset.powi(2)
        });
        let time = time.iter().map(|t| t - trace.delay.value).collect();
        Self {
            quantity: trace.quantity,
            signal: Signal::new(time, value, trace.rms, covariance, tolerance.factor),
        }
    }

    /// Values of a beat at the times of the data.
    #[must_use]
    pub fn model(&self, beat: &Prediction) -> Vec<f64> {
        beat.sampled(beat.further(self.quantity), &self.signal.time_ms)
    }
}

/// Pressure and volume of a beat under changed load.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// Pressure samples, averaged in bins.
    pub pressure: Signal,
    /// Volume of the frames.
    pub volume: Signal,
}

impl Loaded {
    /// Computes the covariances of a beat under changed load.
    ///
    /// The smooth errors are those of the nameless competitor: how the base misses a heart of
    /// another formulation was learnt at rest. Under a lower load it misses healthy hearts of two
    /// other formulations by 1 to 2 mmHg and 1.5 to 2.5 mL (`examples/tolerances`).
    #[must_use]
    pub fn new(
        beat: &LoadedBeat,
        measured: &Measured,
        levels: &NoiseLevels,
        error_model: &ErrorModel,
    ) -> Self {
        let competitors = error_model.competitors;
        let error_model = ErrorModel {
            pressure_mmhg: error_model.further * competitors.pressure_mmhg,
            volume_ml: error_model.further * competitors.volume_ml,
            ..*error_model
        };
        let measured = measured.under_load(beat);
        Self {
            pressure: pressure_signal(&measured, levels, &error_model),
            volume: volume_signal(&measured, levels, &error_model),
        }
    }

    /// Pressure and volume of a predicted beat at the times of the data.
    #[must_use]
    pub fn models(&self, beat: &LoadedPrediction) -> [Vec<f64>; 2] {
        [
            beat.sampled(&beat.pressure_mmhg, &self.pressure.time_ms),
            beat.sampled(&beat.volume_ml, &self.volume.time_ms),
        ]
    }
}

/// All measurements besides pressure and volume of the steady beat and scalars.
#[derive(Debug, Clone)]
pub struct FurtherData {
    /// Further traces of the steady beat.
    pub channels: Vec<Channel>,
    /// Beats under changed load.
    pub loaded: Vec<Loaded>,
}

impl FurtherData {
    /// Computes the covariances of all of them.
    #[must_use]
    pub fn new(measured: &Measured, levels: &NoiseLevels, error_model: &ErrorModel) -> Self {
        let channel =
            |trace: &FurtherTrace| Channel::new(trace, measured.cycle_ms, error_model.further);
        let loaded = |beat: &LoadedBeat| Loaded::new(beat, measured, levels, error_model);
        Self {
            channels: measured.further.traces.iter().map(channel).collect(),
            loaded: measured.further.loaded.iter().map(loaded).collect(),
        }
    }

    fn signals(&self) -> impl Iterator<Item = &Signal> {
        let of_loads = self.loaded.iter().flat_map(|l| [&l.pressure, &l.volume]);
        (self.channels.iter().map(|c| &c.signal)).chain(of_loads)
    }

    /// Number of data.
    #[must_use]
    pub fn len(&self) -> usize {
        self.signals().map(Signal::len).sum()
    }

    /// Whether there are no data.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Logarithm of the determinants of the covariances, without common factors.
    #[must_use]
    pub fn log_determinant(&self) -> f64 {
        self.signals().map(|signal| signal.log_determinant).sum()
    }

    /// White residuals of a beat, data minus model.
    ///
    /// # Panics
    /// If the prediction lacks a beat under changed load.
    #[must_use]
    pub fn white(&self, beat: &Prediction) -> WhiteWithFactor {
        let mut white = WhiteWithFactor::default();
        for channel in &self.channels {
            white.add(&channel.signal, &channel.model(beat));
        }
        for (idx, loaded) in self.loaded.iter().enumerate() {
            let [pressure, volume] = loaded.models(&beat.loaded[idx]);
            white.add(&loaded.pressure, &pressure);
            white.add(&loaded.volume, &volume);
        }
        white
    }

    /// The same measurements of a beat without noise.
    ///
    /// # Panics
    /// If the prediction lacks a beat under changed load.
    #[must_use]
    pub fn of_beat(&self, beat: &Prediction) -> Self {
        let channel = |channel: &Channel| Channel {
            quantity: channel.quantity,
            signal: channel.signal.with_values(channel.model(beat)),
        };
        let loaded = |(idx, loaded): (usize, &Loaded)| {
            let [pressure, volume] = loaded.models(&beat.loaded[idx]);
            Loaded {
                pressure: loaded.pressure.with_values(pressure),
                volume: loaded.volume.with_values(volume),
            }
        };
        Self {
            channels: self.channels.iter().map(channel).collect(),
            loaded: self.loaded.iter().enumerate().map(loaded).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measured::Uncertain;
    use std::f64::consts::TAU;

    const CYCLE_MS: f64 = 800.0;

    /// A wave of the atrium's pressure at a time of the heart.
    fn wave(t: f64) -> f64 {
        10.0 + 4.0 * (TAU * t / CYCLE_MS).sin()
    }

    fn beat() -> Prediction {
        Prediction {
            step_ms: 2.0,
            atrial_pressure_mmhg: (0..400).map(|i| wave(2.0 * f64::from(i))).collect(),
            ..Prediction::default()
        }
    }

    /// The wave with an error, as a catheter shows it that is `delay_ms` late.
    fn channel(delay_ms: f64, factor: f64, error: impl Fn(f64) -> f64) -> Channel {
        let time_ms: Vec<f64> = (0..800).map(f64::from).collect();
        let trace = FurtherTrace {
            quantity: FurtherQuantity::AtrialPressure,
            value: time_ms
                .iter()
                .map(|t| wave(t - delay_ms) + error(*t))
                .collect(),
            time_ms,
            rms: 1.0,
            correlation_ms: 10.0,
            delay: Uncertain {
                value: delay_ms,
                sd: 15.0,
            },
        };
        Channel::new(&trace, CYCLE_MS, factor)
    }

    fn misfit(channel: &Channel) -> f64 {
        let mut white = WhiteWithFactor::default();
        white.add(&channel.signal, &channel.model(&beat()));
        white.residuals.iter().map(|r| r * r).sum()
    }

    #[test]
    fn a_wedge_is_compared_at_the_time_of_the_heart() {
        assert!(misfit(&channel(120.0, 1.0, |_| 0.0)) < 0.1);
        // Unnoticed, the same delay would be a gap.
        let mut unnoticed = channel(120.0, 1.0, |_| 0.0);
        unnoticed
            .signal
            .time_ms
            .iter_mut()
            .for_each(|t| *t += 120.0);
        assert!(misfit(&unnoticed) > 2.0, "{}", misfit(&unnoticed));
    }

    #[test]
    fn an_offset_is_no_gap_and_a_wave_is_one_that_smooth_errors_hide() {
        let wave = |t: f64| 6.0 * (-((t - 300.0) / 40.0).powi(2)).exp();
        let offset = misfit(&channel(0.0, 1.0, |_| 1.5));
        let (gap, hidden) = (
            misfit(&channel(0.0, 1.0, wave)),
            misfit(&channel(0.0, 3.0, wave)),
        );
        assert!(
            offset < 2.0 && gap > 20.0 && hidden < 0.8 * gap,
            "{offset} {gap} {hidden}"
        );
    }
}
