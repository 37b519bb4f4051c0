//! Simulation of the organ: an iteration of step 1, or the verification beat.
//!
//! Artefacts: `traces.csv` (pressures, volume, flows) and `nodal.csv` (see [`crate::nodal`]). A
//! simulation that diverges leaves its traces up to that time.

mod external;
mod finite_element;
mod late_sector;
mod potentials;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;

use cardiotwin_models::beat::{
    BeatCheck, BeatOutcome, BeatResult, BeatSettings, BeatTraces, Beats, run_beats,
};
use cardiotwin_models::calcium::{Calcium, Rice2008, Rice2008Parameters, SampledCalcium};
use cardiotwin_models::cell0d::{CalciumInput, CellError, CellParameters, CellSolverSettings};
use cardiotwin_models::circulation::{LeftHeart, StartPressure};
use cardiotwin_models::contraction::{StretchReference, Tanh, catalogue};
use cardiotwin_models::effects::{Assembled, BaseModel, EffectSetting, assemble};
use cardiotwin_models::ventricle::{ActivationSpread, GroupContraction, OneFibrePassive};
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::organ::{
    self, ActivationSpec, BeatCount, CellStretch, ContractionSpec, EffectSpec, OrganSpec,
    StretchOrigin,
};
use cardiotwin_schemas::outcome::{Check, Ending, OrganBeatResult, TaskResult};
use cardiotwin_schemas::samples::{BeatSamples, N_SAMPLES};
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Quantity, Trace};
use cardiotwin_units::{Kpa, Ml, Mmhg, MmhgSPerMl, Ms};

use crate::calcium;
use crate::cell_parameters::NamedCell;
use crate::context::Context;
use crate::error::{TaskError, chain};
use crate::finite_element::motion::Motion;
use crate::finite_element::stored::About;
use crate::nodal::{self, number};
use crate::team::Team;

/// Largest change over the last of several beats for which it counts as periodic if no tolerance is
/// given \[mL and mmHg\].
const PERIODIC_CHANGE: f64 = 0.1;

/// Takes part in a 3D beat of rank 0 of `team`.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models or does not match the
/// ventricle's file.
pub(crate) fn serve(spec: &OrganBeatSpec, about: &About, team: &Team) -> Result<(), TaskError> {
    match &spec.organ {
        OrganSpec::Reduced { .. } | OrganSpec::External(_) => Ok(()),
        OrganSpec::FiniteElement(organ) => finite_element::serve(spec, organ, about, team),
    }
}

/// Runs the simulation and checks it.
///
/// # Errors
/// [`TaskError`] when the specification is outside the range of the models or files cannot be
/// written.
pub fn run(spec: &OrganBeatSpec, context: &mut Context) -> Result<Ending, TaskError> {
    context.check_stop()?;
    match &spec.organ {
        OrganSpec::Reduced {
            passive,
            activation,
        } => {
            let Assembled {
                mut ventricle,
                mut circulation,
                ..
            } = reduced(spec, passive, activation)?;
            context.progress.report("simulating", 0.0, None, || {
                format!("{} ms cycle", spec.cycle_length_ms)
            });
            let outcome = run_beats(&mut ventricle, &mut circulation, &settings(spec));
            ending(spec, outcome, BTreeMap::new(), Seen::default(), context)
        }
        OrganSpec::FiniteElement(organ) => finite_element::run(spec, organ, context),
        OrganSpec::External(organ) => external::run(spec, organ, context),
    }
}

/// A beat of the one-fibre ventricle without artefacts, for searches that need many beats; `None`
/// if it diverges.
///
/// # Errors
/// Same as for [`run`].
pub fn reduced_beat(
    spec: &OrganBeatSpec,
    passive: &organ::OneFibrePassive,
    activation: &ActivationSpec,
) -> Result<Option<OrganBeatResult>, TaskError> {
    let Assembled {
        mut ventricle,
        mut circulation,
        ..
    } = reduced(spec, passive, activation)?;
    let settings = BeatSettings {
        record_nodes: false,
        ..settings(spec)
    };
    match run_beats(&mut ventricle, &mut circulation, &settings) {
        BeatOutcome::Finished(result) => {
            organ_beat_result(spec, &result, Seen::default()).map(Some)
        }
        BeatOutcome::Diverged { .. } => Ok(None),
    }
}

/// Writes the artefacts of a simulation and makes its result. `counters` are added to those of its
/// time steps.
fn ending(
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
                last_good_ms: t.0,
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

/// Whether the contraction model has calcium.
fn has_calcium(spec: &OrganBeatSpec) -> bool {
    match &spec.contraction {
        ContractionSpec::Tanh { .. } => false,
        ContractionSpec::Land2017Rice { .. } | ContractionSpec::Land2017Trace { .. } => true,
        ContractionSpec::Catalogue { name, parameters } => catalogue::find(name)
            .and_then(|model| model.with(parameters))
            .is_ok_and(|model| model.needs_calcium()),
    }
}

fn settings(spec: &OrganBeatSpec) -> BeatSettings {
    BeatSettings {
        cycle_length: Ms(spec.cycle_length_ms),
        beats: match spec.beats {
            BeatCount::Fixed { n } => Beats::Exactly(n as usize),
            BeatCount::Periodic { max, tolerance } => Beats::UntilPeriodic {
                limit: max as usize,
                volume: Ml(tolerance),
                pressure: Mmhg(tolerance),
            },
        },
        step: Ms(spec.time_step_ms),
        diastolic_step: Ms(spec
            .finite_element
            .map_or(0.0, |equations| equations.diastolic_step_ms)),
        shortest_step: Ms(spec.shortest_step_ms),
        record_nodes: true,
    }
}

/// One-fibre ventricle and circulation of a specification with its effects, at the beginning of the
/// beat.
///
/// # Errors
/// [`TaskError`] when parameters are outside the range of the models, or an effect is unknown or an
/// artefact of the measurement.
pub fn reduced(
    spec: &OrganBeatSpec,
    passive: &organ::OneFibrePassive,
    activation: &ActivationSpec,
) -> Result<Assembled, TaskError> {
    let effects = effects(&spec.circulation.effects)?;
    let base = BaseModel {
        heart: heart(spec),
        passive: OneFibrePassive {
            stiffness: Kpa(passive.stiffness_kpa),
            exponent: passive.exponent,
            unloaded_volume: Ml(passive.unloaded_volume_ml),
            end_diastolic_volume: Ml(passive.end_diastolic_volume_ml),
            wall_volume: Ml(passive.wall_volume_ml),
            exponent_fitted: false,
        },
        activation: ActivationSpread {
            onset: Ms(activation.onset_ms),
            spread: Ms(activation.spread_ms),
            n_groups: activation.groups as usize,
        },
        contraction: contraction(spec)?,
    };
    let mut organ = assemble(base, &effects)?;
    organ
        .ventricle
        .limit_iterations(spec.newton_iterations as usize);
    Ok(organ)
}

/// Catalogue entries of the accepted effects. Effects of the measurement are rejected, because a
/// simulation measures nothing.
fn effects(specs: &[EffectSpec]) -> Result<Vec<EffectSetting>, TaskError> {
    let setting = |spec: &EffectSpec| {
        let setting = EffectSetting::named(&spec.name, &spec.parameters)?;
        setting.require_physiology()?;
        Ok(setting)
    };
    specs.iter().map(setting).collect()
}

fn contraction(spec: &OrganBeatSpec) -> Result<GroupContraction, TaskError> {
    let cycle_length_ms = spec.cycle_length_ms;
    let contraction = match &spec.contraction {
        ContractionSpec::Tanh { parameters } => Tanh::new(*parameters)
            .map(GroupContraction::tanh)
            .map_err(TaskError::Contraction)?,
        ContractionSpec::Land2017Rice {
            parameters,
            lambda_0,
        } => land(
            NamedCell::new(cycle_length_ms, *lambda_0)
                .with(parameters)?
                .parameters(),
        )?,
        ContractionSpec::Land2017Trace {
            parameters,
            lambda_0,
            calcium,
        } => {
            let cell = NamedCell::new(cycle_length_ms, *lambda_0)
                .with(parameters)?
                .parameters();
            let samples = calcium::samples(calcium, cycle_length_ms)?;
            let sampled =
                SampledCalcium::new(Ms(calcium::INTERVAL_MS), samples).map_err(CellError::from)?;
            land(CellParameters {
                calcium: CalciumInput::Sampled(Arc::new(sampled)),
                ..cell
            })?
        }
        ContractionSpec::Catalogue { name, parameters } => of_catalogue(name, parameters)?,
    };
    Ok(contraction.with_stretch(stretch_reference(spec.cell_stretch)))
}

/// A model of the catalogue at rest. A model that needs calcium gets Rice's transient with its
/// defaults.
fn of_catalogue(
    name: &str,
    parameters: &BTreeMap<String, f64>,
) -> Result<GroupContraction, TaskError> {
    let model = catalogue::find(name)
        .and_then(|model| model.with(parameters))
        .map_err(TaskError::Contraction)?;
    let calcium: Option<Arc<dyn Calcium>> = if model.needs_calcium() {
        let rice = Rice2008::new(Rice2008Parameters::default()).map_err(CellError::Calcium)?;
        Some(Arc::new(rice))
    } else {
        None
    };
    let mut rest = vec![0.0; model.n_states()];
    model.rest(&mut rest);
    GroupContraction::new(model, calcium, rest).map_err(TaskError::Organ)
}

fn stretch_reference(stretch: CellStretch) -> StretchReference {
    match stretch.origin {
        StretchOrigin::EndDiastole => StretchReference::EndDiastole,
        StretchOrigin::Unloaded => StretchReference::Unloaded {
            slack: stretch.slack_stretch,
        },
    }
}

/// Land's model, started from the periodic state of the cell.
fn land(cell: CellParameters) -> Result<GroupContraction, TaskError> {
    let cell = cell.build()?;
    let beat = cell.solve_periodic(&CellSolverSettings::default())?;
    Ok(GroupContraction::land(&cell, &beat))
}

fn heart(spec: &OrganBeatSpec) -> LeftHeart {
    LeftHeart {
        left_atrial_pressure: Mmhg(spec.circulation.left_atrial_pressure_mmhg),
        mitral_forward: MmhgSPerMl(spec.valves.r_mv_f_mmhg_s_per_ml),
        mitral_backward: MmhgSPerMl(spec.valves.r_b_mmhg_s_per_ml),
        aortic_forward: MmhgSPerMl(spec.valves.r_av_f_mmhg_s_per_ml),
        aortic_backward: MmhgSPerMl(spec.valves.r_b_mmhg_s_per_ml),
        windkessel: spec.circulation.afterload,
        start: StartPressure::DiastolicCuff(Mmhg(
            spec.circulation.initial_windkessel_pressure_mmhg,
        )),
        cycle_length: Ms(spec.cycle_length_ms),
    }
}

/// Observations of a beat besides its traces.
#[derive(Debug, Default, Clone, Copy)]
struct Seen<'a> {
    /// Smallest stretch of any node, if the traces do not include the nodes.
    lambda_min: Option<f64>,
    /// Motion of the last beat of a finite-element ventricle.
    motion: Option<&'a Motion>,
}

fn organ_beat_result(
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

fn traces_csv(traces: &BeatTraces) -> String {
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
