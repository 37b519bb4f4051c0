//! Measurements besides pressure and volume of the steady beat, in the form that the search takes.
//! Data without a stated uncertainty get a usual one.

use cardiotwin_discover::further::{Further, FurtherTrace, LoadedBeat, ValveTimes};
use cardiotwin_discover::measured::Uncertain;
use cardiotwin_discover::usual;
use cardiotwin_schemas::discover::DiscoverSpec;
use cardiotwin_schemas::further::{FurtherTraceSpec, LoadedBeatSpec};
use cardiotwin_signals::Quantity;

use super::samples::frames;
use crate::error::TaskError;
use crate::inputs::{read_trace, within_cycle};

/// Standard deviation of the delay of a wedge pressure \[ms\], whose delays are 100 to 150 ms.
const WEDGE_DELAY_SD_MS: f64 = 15.0;

/// Reads the further traces and the beats under changed load.
///
/// # Errors
/// [`TaskError`] when a file is not the planned one or holds no usable trace.
pub fn read(spec: &DiscoverSpec) -> Result<Further, TaskError> {
    let trace = |stated: &FurtherTraceSpec| further_trace(stated, spec.cycle_length_ms);
    let loaded = |beat: &LoadedBeatSpec| loaded_beat(beat, spec.noise.volume_frames);
    Ok(Further {
        traces: spec.traces.iter().map(trace).collect::<Result<_, _>>()?,
        loaded: spec.loaded.iter().map(loaded).collect::<Result<_, _>>()?,
    })
}

fn further_trace(stated: &FurtherTraceSpec, cycle_ms: f64) -> Result<FurtherTrace, TaskError> {
    let quantity = stated.quantity;
    let trace = within_cycle(read_trace(&stated.file, quantity.into())?, cycle_ms)?;
    let positive = |value: Option<f64>| value.filter(|value| *value > 0.0);
    let delay_ms = stated.delay_ms.unwrap_or(0.0);
    let usual_delay_sd = if delay_ms > 0.0 {
        WEDGE_DELAY_SD_MS
    } else {
        0.0
    };
    Ok(FurtherTrace {
        quantity,
        time_ms: trace.time_ms().to_vec(),
        value: trace.values().to_vec(),
        rms: positive(stated.rms).unwrap_or(usual::trace_rms(quantity)),
        correlation_ms: positive(stated.correlation_ms).unwrap_or(usual::CORRELATION_MS),
        delay: Uncertain {
            value: delay_ms,
            sd: stated.delay_sd_ms.unwrap_or(usual_delay_sd),
        },
    })
}

fn loaded_beat(beat: &LoadedBeatSpec, n_frames: Option<u32>) -> Result<LoadedBeat, TaskError> {
    let cycle_ms = beat.cycle_length_ms;
    let read = |file, column| within_cycle(read_trace(file, column)?, cycle_ms);
    let pressure = read(&beat.pressure, Quantity::Pressure)?;
    let volume = frames(read(&beat.volume, Quantity::Volume)?, n_frames)?;
    Ok(LoadedBeat {
        cycle_ms,
        pressure_time_ms: pressure.time_ms().to_vec(),
        pressure_mmhg: pressure.values().to_vec(),
        frame_time_ms: volume.time_ms().to_vec(),
        frame_volume_ml: volume.values().to_vec(),
    })
}

/// Times of the valves.
pub fn valve_times(spec: &DiscoverSpec) -> ValveTimes {
    let Some(times) = &spec.valve_times else {
        return ValveTimes::default();
    };
    let sd = times
        .sd_ms
        .filter(|sd| *sd > 0.0)
        .unwrap_or(usual::VALVE_SD_MS);
    let time = |value: Option<f64>| value.map(|value| Uncertain { value, sd });
    ValveTimes {
        aortic_opening: time(times.aortic_opening_ms),
        aortic_closure: time(times.aortic_closure_ms),
        mitral_opening: time(times.mitral_opening_ms),
        mitral_closure: time(times.mitral_closure_ms),
    }
}

/// Duration of QRS.
pub fn qrs(spec: &DiscoverSpec) -> Option<Uncertain> {
    spec.qrs.as_ref().map(|qrs| Uncertain {
        value: qrs.duration_ms,
        sd: qrs.sd_ms.filter(|sd| *sd > 0.0).unwrap_or(usual::QRS_SD_MS),
    })
}
