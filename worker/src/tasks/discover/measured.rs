//! A patient's data in the form that the search takes. Data without a stated uncertainty get a
//! usual one.

use cardiotwin_discover::measured::{Cuff, GivenLoads, Measured, SideData, Uncertain, WholeHeart};
use cardiotwin_discover::usual;
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::discover::DiscoverSpec;
use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Quantity, Trace, resample};
use cardiotwin_units::Ms;

use super::further;
use super::samples::frames;
use crate::error::TaskError;
use crate::inputs::{read_trace, within_cycle};

/// Relative standard deviation of a wall volume.
const WALL_SD: f64 = 0.05;
/// Ratio of wall volume to largest volume if the wall volume is not stated; 0.7 to 0.8 in a normal
/// left ventricle.
const WALL_SHARE: f64 = 0.75;
/// Relative standard deviation of a wall volume from this ratio.
const WALL_SHARE_SD: f64 = 0.2;

/// Relative standard deviation of a filling pressure, about two mmHg.
const FILLING_PRESSURE_SD: f64 = 0.25;
/// Relative standard deviations of a Windkessel that was determined beforehand, similar to those of
/// the human record (docs/afterload.md).
const CHARACTERISTIC_RESISTANCE_SD: f64 = 0.3;
const PERIPHERAL_RESISTANCE_SD: f64 = 0.1;
const COMPLIANCE_SD: f64 = 0.15;

/// Measured data of a patient.
pub struct Patient {
    /// Data for the search.
    pub data: Measured,
    /// Pressure trace of the file.
    pub pressure: Trace,
    /// Volume trace, with one sample per frame.
    pub volume: Trace,
}

/// Reads the traces and collects the side data.
///
/// # Errors
/// [`TaskError`] when a file is not the planned one or holds no usable trace.
pub fn read(spec: &DiscoverSpec) -> Result<Patient, TaskError> {
    let pressure = within_cycle(
        read_trace(&spec.pressure, Quantity::Pressure)?,
        spec.cycle_length_ms,
    )?;
    let volume = within_cycle(
        read_trace(&spec.volume, Quantity::Volume)?,
        spec.cycle_length_ms,
    )?;
    let volume = frames(volume, spec.noise.volume_frames)?;
    let uncertain = |value: f64, sd: Option<f64>, usual: f64| Uncertain {
        value,
        sd: sd.unwrap_or(usual),
    };
    let largest = volume.values().iter().copied().fold(f64::MIN, f64::max);
    let wall_volume = match spec.wall_volume_ml {
        Some(value) => Uncertain {
            value,
            sd: WALL_SD * value,
        },
        None => Uncertain {
            value: WALL_SHARE * largest,
            sd: WALL_SHARE * WALL_SHARE_SD * largest,
        },
    };
    let data = Measured {
        cycle_ms: spec.cycle_length_ms,
        pressure_time_ms: pressure.time_ms().to_vec(),
        pressure_mmhg: pressure.values().to_vec(),
        frame_time_ms: volume.time_ms().to_vec(),
        frame_volume_ml: volume.values().to_vec(),
        noise: spec.noise.stated(),
        side: SideData {
            cuff: spec.aortic_pressure.as_ref().map(|cuff| Cuff {
                systolic: uncertain(cuff.systolic_mmhg, cuff.sd_mmhg, usual::CUFF_SD_MMHG),
                diastolic: uncertain(cuff.diastolic_mmhg, cuff.sd_mmhg, usual::CUFF_SD_MMHG),
            }),
            forward_stroke_volume: spec.forward_stroke_volume.as_ref().map(|flow| {
                uncertain(
                    flow.volume_ml,
                    flow.sd_ml,
                    usual::STROKE_VOLUME_SD * flow.volume_ml,
                )
            }),
            whole_heart: spec.diastasis.as_ref().map(|image| WholeHeart {
                time_ms: image.time_ms,
                volume: uncertain(
                    image.volume_ml,
                    image.sd_ml,
                    usual::IMAGE_SD * image.volume_ml,
                ),
            }),
            valve_times: further::valve_times(spec),
            qrs_ms: further::qrs(spec),
        },
        wall_volume,
        given: given_loads(spec),
        further: further::read(spec)?,
    };
    data.validate()
        .map_err(|error| TaskError::Discover(error.into()))?;
    Ok(Patient {
        data,
        pressure,
        volume,
    })
}

/// Loads of the patient file, with the usual uncertainty of such measurements.
fn given_loads(spec: &DiscoverSpec) -> GivenLoads {
    let around = |value: f64, share: f64| {
        Some(Uncertain {
            value,
            sd: share * value,
        })
    };
    let load = spec.afterload.as_ref();
    GivenLoads {
        left_atrial_pressure: spec
            .left_atrial_pressure_mmhg
            .and_then(|value| around(value, FILLING_PRESSURE_SD)),
        characteristic_resistance: load.and_then(|load| {
            around(
                load.characteristic_resistance_mmhg_s_per_ml,
                CHARACTERISTIC_RESISTANCE_SD,
            )
        }),
        peripheral_resistance: load.and_then(|load| {
            around(
                load.peripheral_resistance_mmhg_s_per_ml,
                PERIPHERAL_RESISTANCE_SD,
            )
        }),
        compliance: load.and_then(|load| around(load.compliance_ml_per_mmhg, COMPLIANCE_SD)),
    }
}

impl Patient {
    /// Biomarkers of the data, or of a beat at the sample times of the data.
    ///
    /// # Errors
    /// [`TaskError`] when the traces have no biomarkers.
    pub fn biomarkers(
        &self,
        pressure: Vec<f64>,
        volume: Vec<f64>,
    ) -> Result<Biomarkers, TaskError> {
        let periodic = Continuation::periodic(Ms(self.data.cycle_ms));
        let like = |of: &Trace, values: Vec<f64>| -> Result<Trace, TaskError> {
            let trace = Trace::new(of.quantity(), of.time_ms().to_vec(), values)
                .map_err(TaskError::SimulatedTrace)?;
            Ok(resample(&trace, periodic, STEP)?)
        };
        let (pressure, volume) = (like(&self.pressure, pressure)?, like(&self.volume, volume)?);
        Ok(BeatBiomarkers::of_samples(Some(&pressure), Some(&volume), periodic)?.values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_the_next_beat_are_left_out_and_interpolated_frames_are_thinned() {
        let volume =
            Trace::uniform(Quantity::Volume, 1.0, (0..=800).map(f64::from).collect()).unwrap();
        let within = within_cycle(volume, 800.0).unwrap();
        assert_eq!(within.n_samples(), 800);
        let few = frames(within.clone(), Some(32)).unwrap();
        assert_eq!(
            (few.n_samples(), few.time_ms()[1], few.values()[31]),
            (32, 25.0, 775.0)
        );
        assert_eq!(frames(few.clone(), Some(40)).unwrap(), few);
        assert_eq!(frames(few.clone(), None).unwrap(), few);
    }
}
