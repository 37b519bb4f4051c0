//! Pressure and volume of one beat on common times.

use crate::cycle::{Continuation, Cycle};
use crate::pressure_volume_loop::stroke_work_mmhg_ml;
use crate::resample::{ResampleError, STEP, resample};
use crate::{BeatBiomarkers, NoiseWindows, Quantity, Trace, noise_windows};
use cardiotwin_units::Ms;

/// Reasons why two traces do not make a beat.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BeatError {
    /// A trace of another quantity.
    #[error("found a {found} trace, expected a {expected} trace")]
    Quantity {
        /// Quantity of the trace that is needed.
        expected: Quantity,
        /// Quantity of the trace that was given.
        found: Quantity,
    },
    /// A trace cannot be brought to the common step.
    #[error(transparent)]
    Resample(#[from] ResampleError),
    /// Pressure and volume of a single beat do not begin and end together.
    #[error(
        "pressure lasts from {pressure_ms:?} ms and volume from {volume_ms:?} ms: a single beat needs both over the same time"
    )]
    Times {
        /// First and last time of the pressure \[ms\].
        pressure_ms: [f64; 2],
        /// First and last time of the volume \[ms\].
        volume_ms: [f64; 2],
    },
    /// Volume does not fall.
    #[error("volume does not fall: the beat has no ejection")]
    NoEjection,
    /// Pressure has no steepest rise before and fall after its peak.
    #[error("pressure has no pulse: no rates before and after a peak")]
    NoPressurePulse,
}

/// Times of systole in one cycle \[ms\], in this order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystolicTimes {
    /// Foot of the upstroke of pressure: the last time before the steepest rise at which the slope is below a tenth of
    /// the steepest.
    pub pressure_rises_ms: f64,
    /// Steepest rise of pressure.
    pub steepest_rise_ms: f64,
    /// Beginning of ejection, t4 of the biomarkers.
    pub ejection_begins_ms: f64,
    /// End of ejection, t5 of the biomarkers.
    pub ejection_ends_ms: f64,
    /// Steepest fall of pressure.
    pub steepest_fall_ms: f64,
}

/// Share of the steepest rise below which the upstroke has not begun.
const FOOT: f64 = 0.1;

/// Pressure and volume of one beat, both every millisecond.
#[derive(Debug, Clone, PartialEq)]
pub struct Beat {
    time_ms: Vec<f64>,
    pressure_mmhg: Vec<f64>,
    volume_ml: Vec<f64>,
    continuation: Continuation,
    end_diastolic_volume_ml: f64,
    smallest_volume_ml: f64,
    times: SystolicTimes,
}

impl Beat {
    /// A beat of its two traces, after both were resampled to 1 ms.
    ///
    /// - `pressure` in mmHg, `volume` in mL, on one clock
    ///
    /// # Errors
    /// [`BeatError`] when a trace holds another quantity, cannot be resampled, or has no pulse or ejection.
    pub fn of(
        pressure: &Trace,
        volume: &Trace,
        continuation: Continuation,
    ) -> Result<Self, BeatError> {
        Self::over(pressure, volume, continuation, NoiseWindows::default())
    }

    /// A beat of noisy traces, both smoothed over the windows that their noise asks for ([`crate::noise_windows::of`]).
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn over(
        pressure: &Trace,
        volume: &Trace,
        continuation: Continuation,
        windows: NoiseWindows,
    ) -> Result<Self, BeatError> {
        for (trace, expected) in [(pressure, Quantity::Pressure), (volume, Quantity::Volume)] {
            let found = trace.quantity();
            if found != expected {
                return Err(BeatError::Quantity { expected, found });
            }
        }
        let at_step = |trace: &Trace, window: Option<f64>| {
            let trace = resample(trace, continuation, STEP)?;
            let Some(window) = window else {
                return Ok(trace);
            };
            let values = noise_windows::smoothed(&trace, continuation, Ms(window));
            Trace::new(trace.quantity(), trace.time_ms().to_vec(), values)
                .map_err(ResampleError::from)
        };
        let pressure = at_step(pressure, windows.pressure_ms)?;
        let volume = at_step(volume, windows.volume_ms)?;
        let span = |trace: &Trace| [trace.time_ms()[0], trace.end_ms()];
        if pressure.n_samples() != volume.n_samples() || span(&pressure) != span(&volume) {
            return Err(BeatError::Times {
                pressure_ms: span(&pressure),
                volume_ms: span(&volume),
            });
        }
        let v = Cycle::new(volume.time_ms(), volume.values(), continuation);
        let lowest = v.argmin();
        let smallest_volume_ml = v.value(lowest);
        // A simulated beat may end fuller than it began: the fullest time before ejection counts.
        let end_diastolic_volume_ml = (v.lowest(lowest)..=lowest)
            .map(|i| v.value(i))
            .fold(smallest_volume_ml, f64::max);
        if end_diastolic_volume_ml <= smallest_volume_ml {
            return Err(BeatError::NoEjection);
        }
        let times = systolic_times(&pressure, &volume, continuation)?;
        Ok(Self {
            time_ms: volume.time_ms().to_vec(),
            pressure_mmhg: pressure.values().to_vec(),
            volume_ml: volume.values().to_vec(),
            continuation,
            end_diastolic_volume_ml,
            smallest_volume_ml,
            times,
        })
    }

    /// Largest volume before ejection \[mL\].
    #[must_use]
    pub fn end_diastolic_volume_ml(&self) -> f64 {
        self.end_diastolic_volume_ml
    }

    /// Smallest volume \[mL\].
    #[must_use]
    pub fn smallest_volume_ml(&self) -> f64 {
        self.smallest_volume_ml
    }

    /// Stroke volume \[mL\]: end-diastolic less smallest volume, positive.
    #[must_use]
    pub fn stroke_volume_ml(&self) -> f64 {
        self.end_diastolic_volume_ml - self.smallest_volume_ml
    }

    /// Ejection fraction, dimensionless.
    #[must_use]
    pub fn ejection_fraction(&self) -> f64 {
        self.stroke_volume_ml() / self.end_diastolic_volume_ml
    }

    /// Stroke work \[mmHg mL\]: the area of the loop, closed from its last to its first sample.
    #[must_use]
    pub fn stroke_work_mmhg_ml(&self) -> f64 {
        stroke_work_mmhg_ml(&self.volume_ml, &self.pressure_mmhg).unwrap_or(f64::NAN)
    }

    /// Times of systole.
    #[must_use]
    pub fn systolic_times(&self) -> SystolicTimes {
        self.times
    }

    /// Pressure as a cycle \[mmHg\].
    pub(crate) fn pressure(&self) -> Cycle<'_> {
        Cycle::new(&self.time_ms, &self.pressure_mmhg, self.continuation)
    }

    /// Volume as a cycle \[mL\].
    pub(crate) fn volume(&self) -> Cycle<'_> {
        Cycle::new(&self.time_ms, &self.volume_ml, self.continuation)
    }
}

/// Times of systole, those of pressure moved by whole cycles to the ejection they belong to.
fn systolic_times(
    pressure: &Trace,
    volume: &Trace,
    continuation: Continuation,
) -> Result<SystolicTimes, BeatError> {
    let markers = BeatBiomarkers::of_samples(Some(pressure), Some(volume), continuation).map_err(
        // Both quantities were looked at before.
        |_| BeatError::NoPressurePulse,
    )?;
    let (Some(begins), Some(ends)) = (markers.time_points.t4_ms, markers.time_points.t5_ms) else {
        return Err(BeatError::NoEjection);
    };
    let (Some(rise), Some(fall)) = (markers.t_dpdt_max_ms, markers.t_dpdt_min_ms) else {
        return Err(BeatError::NoPressurePulse);
    };
    let middle = 0.5 * (begins + ends);
    let moved = continuation.cycle_length_ms().map_or(0.0, |cycle| {
        cycle * ((middle - 0.5 * (rise + fall)) / cycle).round()
    });
    let p = Cycle::new(pressure.time_ms(), pressure.values(), continuation);
    let foot = foot(&p, rise).ok_or(BeatError::NoPressurePulse)?;
    Ok(SystolicTimes {
        pressure_rises_ms: foot + moved,
        steepest_rise_ms: rise + moved,
        ejection_begins_ms: begins,
        ejection_ends_ms: ends,
        steepest_fall_ms: fall + moved,
    })
}

/// Time of the foot before the steepest rise; a single beat's first time where it begins later.
fn foot(p: &Cycle, steepest_rise_ms: f64) -> Option<f64> {
    let steepest = p.nearest(steepest_rise_ms);
    let least = FOOT * p.slope(steepest)?;
    let mut foot = steepest;
    while foot > p.lowest(steepest) && p.slope(foot).is_none_or(|slope| slope >= least) {
        foot -= 1;
    }
    Some(p.time(foot))
}

#[cfg(test)]
mod tests {
    use super::super::model_heart::Heart;
    use super::*;

    #[test]
    fn systole_is_in_order_wherever_the_cycle_begins() {
        let (pressure, volume) = Heart::default().traces();
        let periodic = Continuation::periodic(Ms(800.0));
        let plain = Beat::of(&pressure, &volume, periodic).unwrap();
        let times = plain.systolic_times();
        assert!(times.steepest_rise_ms < times.ejection_ends_ms, "{times:?}");
        assert!(
            times.ejection_begins_ms < times.ejection_ends_ms,
            "{times:?}"
        );
        assert!(
            times.ejection_ends_ms < times.steepest_fall_ms + 10.0,
            "{times:?}"
        );
        for shift in [150, 300, 600] {
            let turned = |trace: &Trace| {
                let mut values = trace.values().to_vec();
                values.rotate_left(shift);
                Trace::uniform(trace.quantity(), 1.0, values).unwrap()
            };
            let beat = Beat::of(&turned(&pressure), &turned(&volume), periodic).unwrap();
            let other = beat.systolic_times();
            for (a, b) in [
                (times.pressure_rises_ms, other.pressure_rises_ms),
                (times.steepest_rise_ms, other.steepest_rise_ms),
                (times.ejection_begins_ms, other.ejection_begins_ms),
                (times.steepest_fall_ms, other.steepest_fall_ms),
            ] {
                let (from_end, to_end) = (times.ejection_ends_ms - a, other.ejection_ends_ms - b);
                assert!(
                    (from_end - to_end).abs() < 1e-6,
                    "{shift}: {times:?} {other:?}"
                );
            }
            assert_eq!(beat.stroke_volume_ml(), plain.stroke_volume_ml());
        }
    }

    #[test]
    fn traces_that_make_no_beat_say_why() {
        let (pressure, volume) = Heart::default().traces();
        let periodic = Continuation::periodic(Ms(800.0));
        assert!(matches!(
            Beat::of(&volume, &volume, periodic),
            Err(BeatError::Quantity {
                expected: Quantity::Pressure,
                ..
            })
        ));
        let flat = Trace::uniform(Quantity::Volume, 1.0, vec![80.0; 800]).unwrap();
        assert_eq!(
            Beat::of(&pressure, &flat, periodic),
            Err(BeatError::NoEjection)
        );
        let short = Trace::uniform(Quantity::Volume, 1.0, volume.values()[..700].to_vec()).unwrap();
        assert!(matches!(
            Beat::of(&pressure, &short, Continuation::Single),
            Err(BeatError::Times { .. })
        ));
    }
}
