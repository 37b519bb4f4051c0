//! Medians of the kernels that decide how long a personalisation or a fit to traces takes, and the strategies of step 2 side by side.

mod cell;
mod strategies;
mod triad;
mod ventricle;

pub use cell::{CellTiming, cell};
pub use strategies::{Case, Comparison, Row, cases, strategies};
pub use triad::triad_gb_per_s;
pub use ventricle::{
    BeatBiomarkers, BenchError, Element, NsPerTet, OfRank, Ranks, SecondsPerPhase, Shortcut,
    Shortcuts, VentricleBench, VentricleTiming, follow, shortcuts, text_of, ventricle,
};

use std::time::{Duration, Instant};

use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_beats};
use cardiotwin_models::effects::Assembled;
use cardiotwin_models::periodic::{FitSubject, Orbit, PeriodicSettings, find};
use cardiotwin_schemas::biomarkers::NoiseWindows;
use cardiotwin_schemas::organ::{
    ActivationSpec, BeatCount, CellStretch, CirculationSpec, ContractionSpec, OneFibrePassive,
    OrganSpec, TanhParameters, ValveParameters, WindkesselParameters,
};
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_units::{Ml, Ms};
use serde::Serialize;

use cardiotwin_worker::error::TaskError;
use cardiotwin_worker::tasks::organ_beat;

/// Repetitions that are not counted.
const WARM_UP: Duration = Duration::from_millis(300);
/// How long repetitions are counted.
const MEASURED: Duration = Duration::from_secs(2);
/// Cycle length of all kernels.
const CYCLE_MS: f64 = 800.0;

/// One beat of the reduced ventricle with Tanh at 1 ms steps, set-up included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BeatTiming {
    /// Median without nodal traces.
    pub ms_per_beat: f64,
    /// Median with nodal traces recorded.
    pub ms_per_beat_with_nodes: f64,
    /// Steps of a beat.
    pub steps: usize,
    /// Activation groups.
    pub groups: u32,
    /// Counted repetitions of the first.
    pub repetitions: usize,
}

/// The periodic beat of the base model at 2 ms steps, set-up included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PeriodicTiming {
    /// Median from nothing.
    pub ms_alone: f64,
    /// Beats that this takes.
    pub beats_alone: usize,
    /// Median from the orbit of neighbouring parameters, one of the fourteen moved by a thousandth.
    pub ms_near_another: f64,
    /// Steps of a beat.
    pub steps: usize,
    /// Activation groups.
    pub groups: usize,
    /// Counted repetitions of the last.
    pub repetitions: usize,
}

/// Times a beat of an average ventricle.
///
/// # Errors
/// Never for the built-in parameters.
pub fn beat() -> Result<BeatTiming, TaskError> {
    let (spec, passive, activation) = average_ventricle();
    let mut steps = 0;
    let mut run = |record_nodes: bool| -> Result<(f64, usize), TaskError> {
        let settings = BeatSettings {
            record_nodes,
            ..BeatSettings::one_beat(Ms(CYCLE_MS))
        };
        median_seconds(|| {
            let Assembled {
                mut ventricle,
                mut circulation,
                ..
            } = organ_beat::reduced(&spec, &passive, &activation)?;
            if let BeatOutcome::Finished(result) =
                run_beats(&mut ventricle, &mut circulation, &settings)
            {
                steps = result.work.n_steps;
            }
            Ok(())
        })
    };
    let (without, repetitions) = run(false)?;
    let (with, _) = run(true)?;
    let groups = activation.groups;
    Ok(BeatTiming {
        ms_per_beat: 1e3 * without,
        ms_per_beat_with_nodes: 1e3 * with,
        steps,
        groups,
        repetitions,
    })
}

/// Times periodic beats of the average base model as a fit asks for them.
///
/// # Errors
/// Never for the built-in parameters.
pub fn periodic() -> Result<PeriodicTiming, TaskError> {
    let cycle = Ms(CYCLE_MS);
    let subject = FitSubject::new(cycle, Ml(97.5));
    let settings = PeriodicSettings::with_step(cycle, Ms(2.0));
    let values = FitSubject::typical();
    let run = |values: &[f64], near: Option<&Orbit>| {
        let mut model = subject.model(values, &[])?;
        find(&mut model, cycle, &settings, near).map_err(TaskError::Organ)
    };
    let first = run(&values, None)?;
    let (alone, _) = median_seconds(|| run(&values, None).map(|_| ()))?;
    // One parameter after the other moved by a thousandth, as for a Jacobian.
    let mut idx = 0;
    let (near, repetitions) = median_seconds(|| {
        let mut moved = values;
        moved[idx] *= 1.001;
        idx = (idx + 1) % moved.len();
        run(&moved, Some(&first.orbit)).map(|_| ())
    })?;
    Ok(PeriodicTiming {
        ms_alone: 1e3 * alone,
        beats_alone: first.n_beats,
        ms_near_another: 1e3 * near,
        steps: settings.steps,
        groups: subject.n_groups,
        repetitions,
    })
}

/// Median seconds of a call and the number of calls that were counted.
fn median_seconds(
    mut work: impl FnMut() -> Result<(), TaskError>,
) -> Result<(f64, usize), TaskError> {
    let begin = Instant::now();
    while begin.elapsed() < WARM_UP {
        work()?;
    }
    let mut seconds = Vec::new();
    let begin = Instant::now();
    while begin.elapsed() < MEASURED {
        let call = Instant::now();
        work()?;
        seconds.push(call.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    Ok((seconds[seconds.len() / 2], seconds.len()))
}

/// A ventricle in the middle of the bundled cohort.
fn average_ventricle() -> (OrganBeatSpec, OneFibrePassive, ActivationSpec) {
    let passive = OneFibrePassive {
        wall_volume_ml: 97.5,
        unloaded_volume_ml: 71.0,
        end_diastolic_volume_ml: 130.0,
        end_diastolic_pressure_mmhg: 9.0,
        stiffness_kpa: 0.3,
        exponent: 9.24,
    };
    let afterload = WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: 0.055,
        peripheral_resistance_mmhg_s_per_ml: 0.85,
        compliance_ml_per_mmhg: 1.5,
    };
    let activation = ActivationSpec {
        spread_ms: 40.0,
        groups: 16,
        onset_ms: 0.0,
    };
    let spec = OrganBeatSpec {
        cycle_length_ms: CYCLE_MS,
        time_step_ms: 1.0,
        shortest_step_ms: 1.0 / 64.0,
        newton_iterations: 60,
        organ: OrganSpec::Reduced {
            passive,
            activation,
        },
        circulation: CirculationSpec {
            afterload,
            initial_windkessel_pressure_mmhg: 70.0,
            left_atrial_pressure_mmhg: 7.0,
            effects: Vec::new(),
        },
        valves: ValveParameters::default(),
        contraction: ContractionSpec::Tanh {
            parameters: TanhParameters::default(),
        },
        cell_stretch: CellStretch::default(),
        beats: BeatCount::Fixed { n: 1 },
        measured_end_diastolic_volume_ml: None,
        noise_windows: NoiseWindows::default(),
        finite_element: None,
    };
    (spec, passive, activation)
}

/// The processor as it calls itself.
#[must_use]
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(
        || std::env::consts::ARCH.to_owned(),
        |(_, name)| name.trim().to_owned(),
    )
}
