//! Measured data of a patient: traces, statements on their noise, and scalars measured besides
//! them.

use crate::further::{Further, LoadedBeat, ValveTimes, check_trace};
use crate::measured_error::positive;

pub use crate::measured_error::MeasuredError;
pub use crate::uncertain::Uncertain;
use cardiotwin_vocabulary::trace_noise::Noise;
use serde::{Deserialize, Serialize};

/// Standard deviation of the logarithm of a stated noise level or correlation time.
pub const STATED_NOISE_SD: f64 = 0.1;

/// Blood pressures by an arm cuff, which is independent of the catheter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cuff {
    /// Systolic pressure of the arm \[mmHg\].
    pub systolic: Uncertain,
    /// Diastolic pressure of the arm \[mmHg\].
    pub diastolic: Uncertain,
}

/// Volume from a 3D whole-heart image at a time in the cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WholeHeart {
    /// Time in the cycle \[ms\].
    pub time_ms: f64,
    /// Cavity volume at this time \[mL\].
    pub volume: Uncertain,
}

/// Scalars measured besides the traces.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SideData {
    /// Pressures by an arm cuff.
    pub cuff: Option<Cuff>,
    /// Net forward stroke volume from flow imaging \[mL\].
    pub forward_stroke_volume: Option<Uncertain>,
    /// Volume from a whole-heart image.
    pub whole_heart: Option<WholeHeart>,
    /// Times of the valves by heart sounds or echo.
    #[serde(default)]
    pub valve_times: ValveTimes,
    /// Duration of QRS in the electrocardiogram \[ms\].
    #[serde(default)]
    pub qrs_ms: Option<Uncertain>,
}

impl SideData {
    /// Number of scalars that were measured, two of them by a cuff.
    #[must_use]
    pub fn len(&self) -> usize {
        2 * usize::from(self.cuff.is_some())
            + usize::from(self.forward_stroke_volume.is_some())
            + usize::from(self.whole_heart.is_some())
            + self.valve_times.all().iter().flatten().count()
            + usize::from(self.qrs_ms.is_some())
    }

    /// Whether there are no scalars.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Loads stated in the patient file. They are fitted nevertheless, but within their uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct GivenLoads {
    /// Filling pressure, as the pressure of the left atrium \[mmHg\].
    pub left_atrial_pressure: Option<Uncertain>,
    /// Characteristic resistance R1 of the aorta \[mmHg·s/mL\].
    pub characteristic_resistance: Option<Uncertain>,
    /// Peripheral resistance R2 \[mmHg·s/mL\].
    pub peripheral_resistance: Option<Uncertain>,
    /// Arterial compliance C \[mL/mmHg\].
    pub compliance: Option<Uncertain>,
}

/// One patient's data: a steady beat of pressure and volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Length of the cardiac cycle \[ms\].
    pub cycle_ms: f64,
    /// Times of the pressure samples \[ms\], increasing, within one cycle.
    pub pressure_time_ms: Vec<f64>,
    /// Cavity pressure of each sample \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Times of the volume frames \[ms\], increasing, within one cycle.
    pub frame_time_ms: Vec<f64>,
    /// Volume of each frame \[mL\], as segmented. It must not come from an interpolated trace.
    pub frame_volume_ml: Vec<f64>,
    /// Noise levels that the patient file states. They are themselves uncertain
    /// ([`STATED_NOISE_SD`]).
    pub noise: Noise,
    /// Scalars measured besides the traces.
    pub side: SideData,
    /// Volume of the ventricle's wall \[mL\].
    pub wall_volume: Uncertain,
    /// Loads that the patient file states.
    #[serde(default)]
    pub given: GivenLoads,
    /// Further traces, and beats under changed load.
    #[serde(default)]
    pub further: Further,
}

/// Smallest number of pressure samples in a cycle.
const PRESSURE_SAMPLES: usize = 100;
/// Smallest number of volume frames in a cycle.
const FRAMES: usize = 12;

impl Measured {
    /// Checks lengths, times and values.
    ///
    /// # Errors
    /// [`MeasuredError`] for the first invalid item.
    pub fn validate(&self) -> Result<(), MeasuredError> {
        positive("the cycle length in ms", self.cycle_ms)?;
        let traces = [
            (
                "pressure trace",
                &self.pressure_time_ms,
                &self.pressure_mmhg,
                PRESSURE_SAMPLES,
            ),
            (
                "volume trace",
                &self.frame_time_ms,
                &self.frame_volume_ml,
                FRAMES,
            ),
        ];
        for (trace, times, values, expected) in traces {
            check_trace(trace, times, values, expected, self.cycle_ms)?;
        }
        if let Some(value) = self.frame_volume_ml.iter().find(|v| **v <= 0.0) {
            return Err(MeasuredError::Value {
                name: "a volume frame",
                value: *value,
                expected: "above 0 mL",
            });
        }
        let noise = [
            (
                "the stated rms of the pressure noise in mmHg",
                self.noise.pressure_rms_mmhg,
            ),
            (
                "the stated correlation time of the pressure noise in ms",
                self.noise.pressure_correlation_ms,
            ),
            (
                "the stated rms of the volume noise in mL",
                self.noise.volume_rms_ml,
            ),
        ];
        for (name, value) in noise {
            value.map_or(Ok(()), |value| positive(name, value))?;
        }
        let mut scalars = vec![("the wall volume in mL", self.wall_volume)];
        if let Some(cuff) = self.side.cuff {
            scalars.extend([
                ("the systolic cuff pressure", cuff.systolic),
                ("the diastolic cuff pressure", cuff.diastolic),
            ]);
        }
        scalars.extend(
            self.side
                .forward_stroke_volume
                .map(|v| ("the forward stroke volume in mL", v)),
        );
        scalars.extend(
            self.side
                .whole_heart
                .map(|w| ("the whole-heart volume in mL", w.volume)),
        );
        scalars.extend(
            self.side
                .qrs_ms
                .map(|qrs| ("the duration of QRS in ms", qrs)),
        );
        for time in self.side.valve_times.all().into_iter().flatten() {
            positive("the standard deviation of a valve's time in ms", time.sd)?;
        }
        for (name, scalar) in scalars {
            positive(name, scalar.value)?;
            positive(name, scalar.sd)?;
        }
        self.further.validate(self.cycle_ms)?;
        self.further
            .loaded
            .iter()
            .try_for_each(|beat| self.under_load(beat).validate())
    }

    /// The traces of a beat under changed load, with the noise of these.
    #[must_use]
    pub fn under_load(&self, beat: &LoadedBeat) -> Self {
        Self {
            cycle_ms: beat.cycle_ms,
            pressure_time_ms: beat.pressure_time_ms.clone(),
            pressure_mmhg: beat.pressure_mmhg.clone(),
            frame_time_ms: beat.frame_time_ms.clone(),
            frame_volume_ml: beat.frame_volume_ml.clone(),
            noise: self.noise.clone(),
            side: SideData::default(),
            wall_volume: self.wall_volume,
            given: GivenLoads::default(),
            further: Further::default(),
        }
    }
}
