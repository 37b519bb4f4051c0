//! Measurements besides pressure and volume of one steady beat: further traces, times of valves, the
//! width of QRS, and beats under changed load.

use crate::measured_error::{MeasuredError, positive};
use crate::uncertain::Uncertain;
use cardiotwin_vocabulary::measurements::FurtherQuantity;
use serde::{Deserialize, Serialize};

/// A further trace over the cycle, on the clock of pressure and volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FurtherTrace {
    /// Quantity that was measured.
    pub quantity: FurtherQuantity,
    /// Times of the samples \[ms\], increasing, within one cycle.
    pub time_ms: Vec<f64>,
    /// Values of the samples, in the unit of the quantity.
    pub value: Vec<f64>,
    /// Rms of the noise, in the unit of the quantity.
    pub rms: f64,
    /// Correlation time of the noise \[ms\].
    pub correlation_ms: f64,
    /// Delay of the trace against the heart \[ms\], as of a wedge pressure; zero for a sensor in
    /// place.
    pub delay: Uncertain,
}

/// Times of the valves, by heart sounds or by echo, on the clock of the traces \[ms\].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ValveTimes {
    /// Time at which the aortic valve opens.
    pub aortic_opening: Option<Uncertain>,
    /// Time at which the aortic valve closes (second heart sound).
    pub aortic_closure: Option<Uncertain>,
    /// Time at which the mitral valve opens.
    pub mitral_opening: Option<Uncertain>,
    /// Time at which the mitral valve closes (first heart sound).
    pub mitral_closure: Option<Uncertain>,
}

impl ValveTimes {
    /// Names of the times.
    pub const NAMES: [&str; 4] = [
        "aortic_opening",
        "aortic_closure",
        "mitral_opening",
        "mitral_closure",
    ];

    /// The times in the order of [`Self::NAMES`].
    #[must_use]
    pub fn all(&self) -> [Option<Uncertain>; 4] {
        [
            self.aortic_opening,
            self.aortic_closure,
            self.mitral_opening,
            self.mitral_closure,
        ]
    }

    /// The times in the order of [`Self::NAMES`], to be changed.
    pub fn all_mut(&mut self) -> [&mut Option<Uncertain>; 4] {
        [
            &mut self.aortic_opening,
            &mut self.aortic_closure,
            &mut self.mitral_opening,
            &mut self.mitral_closure,
        ]
    }
}

/// A steady beat of the same heart under another load, such as a lower filling pressure while the
/// caval veins are partly occluded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoadedBeat {
    /// Length of its cardiac cycle \[ms\].
    pub cycle_ms: f64,
    /// Times of the pressure samples \[ms\], increasing, within its cycle.
    pub pressure_time_ms: Vec<f64>,
    /// Cavity pressure of each sample \[mmHg\].
    pub pressure_mmhg: Vec<f64>,
    /// Times of the volume frames \[ms\], increasing, within its cycle.
    pub frame_time_ms: Vec<f64>,
    /// Volume of each frame \[mL\].
    pub frame_volume_ml: Vec<f64>,
}

/// Traces besides pressure and volume of the steady beat.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Further {
    /// Further traces of the steady beat, at most one of each quantity.
    #[serde(default)]
    pub traces: Vec<FurtherTrace>,
    /// Beats under changed load.
    #[serde(default)]
    pub loaded: Vec<LoadedBeat>,
}

/// Smallest number of samples of a further trace in a cycle.
const SAMPLES: usize = 12;

impl Further {
    /// Whether a quantity was measured.
    #[must_use]
    pub fn has(&self, quantity: FurtherQuantity) -> bool {
        self.traces.iter().any(|trace| trace.quantity == quantity)
    }

    /// Checks lengths, times and values of the traces.
    ///
    /// # Errors
    /// [`MeasuredError`] for the first invalid item.
    pub fn validate(&self, cycle_ms: f64) -> Result<(), MeasuredError> {
        for trace in &self.traces {
            let name = trace.quantity.name();
            check_trace(name, &trace.time_ms, &trace.value, SAMPLES, cycle_ms)?;
            positive("the rms of the noise of a further trace", trace.rms)?;
            positive(
                "the correlation time of the noise of a further trace in ms",
                trace.correlation_ms,
            )?;
        }
        Ok(())
    }
}

/// Checks lengths, times and values of a trace.
///
/// # Errors
/// [`MeasuredError`] for the first invalid item.
pub(crate) fn check_trace(
    trace: &'static str,
    times: &[f64],
    values: &[f64],
    expected: usize,
    cycle_ms: f64,
) -> Result<(), MeasuredError> {
    if times.len() != values.len() {
        return Err(MeasuredError::Length {
            trace,
            n_times: times.len(),
            n_values: values.len(),
        });
    }
    if times.len() < expected {
        return Err(MeasuredError::TooFew {
            trace,
            found: times.len(),
            expected,
        });
    }
    for (i, t) in times.iter().enumerate() {
        let increases = i == 0 || *t > times[i - 1];
        if !(increases && *t >= 0.0 && *t <= cycle_ms + 1e-6) {
            return Err(MeasuredError::Time {
                trace,
                sample: i + 1,
                time_ms: *t,
                cycle_ms,
            });
        }
    }
    if let Some(value) = values.iter().find(|v| !v.is_finite()) {
        return Err(MeasuredError::Value {
            name: trace,
            value: *value,
            expected: "finite values",
        });
    }
    Ok(())
}
