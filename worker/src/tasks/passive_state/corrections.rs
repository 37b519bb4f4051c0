//! Corrections of the measured traces for artefacts of the measurement, applied before any value is
//! read from the traces.
//!
//! Artefact: `measured.csv` (`time_ms`, `pressure_mmHg`, `volume_mL`), the corrected traces.

use std::fmt::Write as _;

use cardiotwin_models::effects::{EffectSetting, PeriodicTraces, measurement};
use cardiotwin_schemas::organ::EffectSpec;
use cardiotwin_signals::Trace;
use cardiotwin_units::Mmhg;

use crate::error::TaskError;
use crate::nodal::number;

/// The change of the end-diastolic pressure is averaged over this time before and after time zero
/// \[ms\].
const END_DIASTOLE_MS: f64 = 10.0;

/// Corrects both traces and returns the change of the end-diastolic pressure.
///
/// # Errors
/// [`TaskError::Effect`] for an effect that is unknown or not an artefact of the measurement.
pub fn apply(
    corrections: &[EffectSpec],
    cycle_ms: f64,
    pressure: &mut Option<Trace>,
    volume: &mut Option<Trace>,
) -> Result<Mmhg, TaskError> {
    if corrections.is_empty() {
        return Ok(Mmhg(0.0));
    }
    let named = corrections
        .iter()
        .map(|spec| EffectSetting::named(&spec.name, &spec.parameters));
    let artefacts = measurement(&named.collect::<Result<Vec<_>, _>>()?)?;
    let n = cycle_ms.round() as usize;
    let grid: Vec<f64> = (0..n).map(|i| cycle_ms * i as f64 / n as f64).collect();
    let sampled = |trace: &Option<Trace>| match trace {
        Some(trace) => grid.iter().map(|t| periodic(trace, *t, cycle_ms)).collect(),
        None => vec![0.0; n],
    };
    let before = sampled(pressure);
    let mut traces = PeriodicTraces {
        cycle_length_ms: cycle_ms,
        pressure_mmhg: before.clone(),
        volume_ml: sampled(volume),
    };
    artefacts.remove(&mut traces);
    let replaced = |trace: &Trace, values: Vec<f64>| {
        Trace::new(trace.quantity(), trace.time_ms().to_vec(), values)
            .map_err(TaskError::SimulatedTrace)
    };
    if let Some(trace) = pressure {
        *trace = replaced(trace, traces.pressures_at(trace.time_ms()))?;
    }
    if let Some(trace) = volume {
        *trace = replaced(trace, traces.volumes_at(trace.time_ms()))?;
    }
    let near = |i: &usize| grid[*i].min(cycle_ms - grid[*i]) <= END_DIASTOLE_MS;
    let chosen: Vec<usize> = (0..n).filter(near).collect();
    let sum: f64 = chosen
        .iter()
        .map(|i| traces.pressure_mmhg[*i] - before[*i])
        .sum();
    Ok(Mmhg(sum / chosen.len().max(1) as f64))
}

/// Value of a trace continued periodically. Between its last sample and the first sample of the
/// next beat it is linear.
fn periodic(trace: &Trace, time_ms: f64, cycle_ms: f64) -> f64 {
    let end = trace.end_ms();
    if time_ms <= end {
        return trace.at(time_ms);
    }
    let (first, last) = (trace.values()[0], trace.at(end));
    last + (first - last) * (time_ms - end) / (cycle_ms + trace.time_ms()[0] - end)
}

/// Describes the corrections, for the result's remarks.
pub fn remark(corrections: &[EffectSpec]) -> Option<String> {
    let told = corrections.iter().map(|spec| {
        let values: Vec<String> = spec
            .parameters
            .iter()
            .map(|(name, value)| format!("{name} = {value:.4}"))
            .collect();
        format!("{} ({})", spec.name, values.join(", "))
    });
    let told: Vec<String> = told.collect();
    (!told.is_empty()).then(|| format!("measured traces were corrected for {}", told.join(" and ")))
}

/// The corrected traces as CSV, with one column per trace.
pub fn csv(pressure: &Option<Trace>, volume: &Option<Trace>) -> String {
    let traces: Vec<&Trace> = pressure.iter().chain(volume).collect();
    let mut text = "time_ms".to_owned();
    traces
        .iter()
        .for_each(|trace| text.push_str(&format!(",{}", trace.quantity().column())));
    text.push('\n');
    for (i, time) in traces
        .first()
        .map_or(&[][..], |trace| trace.time_ms())
        .iter()
        .enumerate()
    {
        let _ = write!(text, "{}", number(*time));
        for trace in &traces {
            let _ = write!(text, ",{}", number(trace.values()[i]));
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardiotwin_signals::Quantity;

    fn spec(name: &str, parameter: &str, value: f64) -> EffectSpec {
        EffectSpec {
            name: name.into(),
            parameters: [(parameter.to_owned(), value)].into(),
        }
    }

    #[test]
    fn offset_and_delay_are_taken_back_and_end_diastole_moves_along() {
        let wave = |t: f64| 60.0 + 50.0 * (std::f64::consts::TAU * t / 800.0).sin();
        let trace = |quantity, of: &dyn Fn(f64) -> f64| {
            Some(
                Trace::uniform(quantity, 1.0, (0..800).map(|i| of(f64::from(i))).collect())
                    .unwrap(),
            )
        };
        let mut pressure = trace(Quantity::Pressure, &|t| wave(t) - 7.0);
        let mut volume = trace(Quantity::Volume, &|t| wave(t - 20.0));
        let list = [
            spec("pressure_offset", "offset_mmHg", -7.0),
            spec("pv_misalignment", "volume_delay_ms", 20.0),
        ];
        let moved = apply(&list, 800.0, &mut pressure, &mut volume).unwrap();
        assert!((moved.0 - 7.0).abs() < 1e-9);
        for trace in [&pressure, &volume] {
            let trace = trace.as_ref().unwrap();
            let worst = (0..800)
                .map(|i| (trace.values()[i] - wave(i as f64)).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1e-9, "{worst}");
        }
        assert!(csv(&pressure, &volume).starts_with("time_ms,pressure_mmHg,volume_mL\n0,60,60\n"));
        assert!(remark(&list).unwrap().contains("offset_mmHg = -7.0000"));
    }

    #[test]
    fn an_effect_of_the_heart_is_no_correction() {
        let refused = apply(
            &[spec("atrial_kick", "amplitude_mmHg", 8.0)],
            800.0,
            &mut None,
            &mut None,
        )
        .unwrap_err();
        assert!(crate::error::chain(&refused).contains("list it under `effects`"));
    }
}
