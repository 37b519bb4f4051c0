//! Artefacts and result of a simulated beat.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use cardiotwin_models::beat::{BeatCheck, BeatOutcome, BeatResult, BeatTraces};
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ_law::LawSamples;
use cardiotwin_schemas::outcome::{Check, Ending, LoopState, OrganBeatResult, TaskResult};
use cardiotwin_schemas::samples::{BeatSamples, N_SAMPLES};
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Quantity, Trace};
use cardiotwin_units::{Ml, Ms};

use super::models::has_calcium;
use crate::context::Context;
use crate::error::{TaskError, chain};
use crate::finite_element::motion::Motion;
use crate::nodal::{self, number};

/// Largest change over the last of several beats for which it counts as periodic if no tolerance is
/// given \[mL and mmHg\].
const PERIODIC_CHANGE: f64 = 0.1;

/// Observations of a beat besides its traces.
#[derive(Debug, Default, Clone)]
pub(super) struct Seen<'a> {
    /// Smallest stretch of any node, if the traces do not include the nodes.
    pub(super) lambda_min: Option<f64>,
    /// Motion of the last beat of a finite-element ventricle.
    pub(super) motion: Option<&'a Motion>,
    /// Samples from which the organ's law is learned.
    pub(super) law: Option<&'a LawSamples>,
    /// State of a closed loop.
    pub(super) closed: Option<LoopState>,
}

/// Writes the artefacts of a simulation and makes its result. `counters` are added to those of its
/// time steps.
pub(super) fn ending(
    spec: &OrganBeatSpec,
    outcome: BeatOutcome,
    mut counters: BTreeMap<String, f64>,
    seen: Seen<'_>,
    context: &mut Context,
) -> Result<Ending, TaskError> {
    match outcome {
        BeatOutcome::Diverged {
            t, reason, traces, ..
        } => {
            context
                .artefacts
                .write("traces", "traces.csv", &traces_csv(&traces))?;
            Ok(Ending::Diverged {
                // A sum of steps has digits without a meaning.
                last_good_ms: (t.0 * 1e3).round() / 1e3,
                reason: chain(&reason),
            })
        }
        BeatOutcome::Finished(result) => {
            context
                .artefacts
                .write("traces", "traces.csv", &traces_csv(&result.traces))?;
            if let Some(nodes) = &result.traces.nodes {
                let text = nodal::to_csv(&result.traces.time_ms, nodes, has_calcium(spec));
                context.artefacts.write("nodal", "nodal.csv", &text)?;
            }
            let mut result = organ_beat_result(spec, &result, seen)?;
            counters.append(&mut result.counters);
            result.counters = counters;
            Ok(Ending::Succeeded {
                result: Box::new(TaskResult::OrganBeat(result)),
            })
        }
    }
}

pub(super) fn organ_beat_result(
    spec: &OrganBeatSpec,
    result: &BeatResult,
    seen: Seen<'_>,
) -> Result<OrganBeatResult, TaskError> {
    let traces = &result.traces;
    let small_change = result
        .volume_change_ml
        .abs()
        .max(result.pressure_change_mmhg)
        <= PERIODIC_CHANGE;
    // A single beat never counts as periodic, because its end is not compared with the end of an
    // earlier beat.
    let periodic = result.n_beats > 1 && result.periodic.unwrap_or(small_change);
    let [pressure, volume] = signals(traces, periodic)?;
    let continuation = continuation(periodic, spec.cycle_length_ms);
    let windows = spec.noise_windows;
    let mut read = BeatBiomarkers::over(Some(&pressure), Some(&volume), continuation, windows)?;
    if let (Some(measured), false) = (spec.measured_end_diastolic_volume_ml, periodic) {
        read = read.with_gap_to(Ml(measured));
    }
    let lambda = traces.nodes.iter().flat_map(|nodes| &nodes.lambda);
    let counters = BTreeMap::from([
        ("time_steps".to_owned(), result.work.n_steps as f64),
        ("cut_steps".to_owned(), result.work.n_cut as f64),
        (
            "newton_iterations".to_owned(),
            result.work.n_iterations as f64,
        ),
        ("volume_change_mL".to_owned(), result.volume_change_ml),
        (
            "pressure_change_mmHg".to_owned(),
            result.pressure_change_mmhg,
        ),
    ]);
    Ok(OrganBeatResult {
        biomarkers: read.values,
        time_points: read.time_points,
        samples: BeatSamples {
            pressure_mmhg: samples(&pressure, spec.cycle_length_ms),
            volume_ml: samples(&volume, spec.cycle_length_ms),
        },
        checks: result.checks.iter().map(check).collect(),
        beats: result.n_beats as u32,
        periodic,
        remarks: read.remarks(),
        motion: seen
            .motion
            .and_then(|motion| motion.measures(&read.time_points, traces)),
        law: seen.law.cloned(),
        closed_loop: seen.closed,
        lambda_min: seen
            .lambda_min
            .unwrap_or_else(|| lambda.copied().fold(f64::INFINITY, f64::min)),
        counters,
    })
}

/// Biomarkers of simulated traces, resampled like measured ones. Traces wrap around only if a cycle
/// length is given.
pub fn simulated_biomarkers(
    traces: &BeatTraces,
    cycle_length_ms: Option<f64>,
) -> Result<Biomarkers, TaskError> {
    let [pressure, volume] = signals(traces, cycle_length_ms.is_some())?;
    let continuation = continuation(
        cycle_length_ms.is_some(),
        cycle_length_ms.unwrap_or_default(),
    );
    Ok(BeatBiomarkers::of(Some(&pressure), Some(&volume), continuation)?.values)
}

fn continuation(periodic: bool, cycle_length_ms: f64) -> Continuation {
    if periodic {
        Continuation::periodic(Ms(cycle_length_ms))
    } else {
        Continuation::Single
    }
}

/// Pressure and volume of a beat as signals.
fn signals(traces: &BeatTraces, periodic: bool) -> Result<[Trace; 2], TaskError> {
    // The last sample of a periodic beat is the first sample of the next.
    let n = traces.time_ms.len() - usize::from(periodic);
    let trace = |quantity, values: &[f64]| {
        Trace::new(quantity, traces.time_ms[..n].to_vec(), values[..n].to_vec())
    };
    let pressure =
        trace(Quantity::Pressure, &traces.pressure_mmhg).map_err(TaskError::SimulatedTrace)?;
    let volume = trace(Quantity::Volume, &traces.volume_ml).map_err(TaskError::SimulatedTrace)?;
    Ok([pressure, volume])
}

/// A trace at the times of [`BeatSamples`].
pub(crate) fn samples(trace: &Trace, cycle_length_ms: f64) -> Vec<f64> {
    (0..N_SAMPLES)
        .map(|k| trace.at(k as f64 * cycle_length_ms / N_SAMPLES as f64))
        .collect()
}

/// Formats a check for people: `volume_balance_ml` becomes `volume balance`, and its value gets the
/// unit.
fn check(check: &BeatCheck) -> Check {
    let (name, unit) = match check.name.rsplit_once('_') {
        Some((name, "ml")) => (name, " mL"),
        Some((name, "mmhg")) => (name, " mmHg"),
        _ => (check.name.as_str(), ""),
    };
    Check {
        name: name.replace('_', " "),
        passed: check.passed,
        found: format!("{}{unit}", number((check.value * 1e4).round() / 1e4)),
        expected: check.expected.clone(),
    }
}

pub(super) fn traces_csv(traces: &BeatTraces) -> String {
    let mut text =
        "time_ms,pressure_mmHg,volume_mL,aortic_pressure_mmHg,aortic_flow_mL_per_s,mitral_flow_mL_per_s\n".to_owned();
    for (idx, time) in traces.time_ms.iter().enumerate() {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{}",
            number(*time),
            number(traces.pressure_mmhg[idx]),
            number(traces.volume_ml[idx]),
            number(traces.aortic_pressure_mmhg[idx]),
            number(traces.aortic_flow_ml_per_s[idx]),
            number(traces.mitral_flow_ml_per_s[idx]),
        );
    }
    text
}
