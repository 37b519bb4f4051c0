//! Benchmarks: median times of the kernels that dominate a personalisation or a fit to traces, and
//! a comparison of step 2's strategies.

mod cell;
mod strategies;
mod triad;
mod ventricle;

pub use cell::{CellTiming, cell};
pub use strategies::{Case, Comparison, Row, cases, strategies};
pub use triad::triad_gb_per_s;
pub use ventricle::{
    BenchError, Element, NsPerTet, OfRank, Ranks, SecondsPerPhase, Shortcut, Shortcuts,
    VentricleBench, VentricleTiming, follow, shortcuts, text_of, ventricle,
};

use std::time::{Duration, Instant};

use cardiotwin_models::beat::{BeatOutcome, BeatSettings, run_beats};
use cardiotwin_models::effects::Assembled;
use cardiotwin_models::periodic::{FitSubject, Orbit, PeriodicSettings, find};
use cardiotwin_schemas::organ::ContractionSpec;
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_units::{Ml, Ms};
use serde::Serialize;

use cardiotwin_worker::average_ventricle::{CYCLE_MS, average_ventricle};
use cardiotwin_worker::error::TaskError;
use cardiotwin_worker::tasks::organ_beat;

/// Time spent on uncounted repetitions before a measurement.
const WARM_UP: Duration = Duration::from_millis(300);
/// Time over which repetitions are counted.
const MEASURED: Duration = Duration::from_secs(2);
/// Parameters of a cell that ejects from [`average_ventricle`]; the others have their defaults.
const EJECTING_CELL: [(&str, f64); 2] = [("Ca50_ref_uM", 0.5), ("Smax_ref_kPa", 200.0)];

/// One beat of the reduced ventricle with Tanh at 1 ms steps, set-up included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BeatTiming {
    /// Median without nodal traces.
    pub ms_per_beat: f64,
    /// Median with nodal traces recorded.
    pub ms_per_beat_with_nodes: f64,
    /// Median of a beat with the cell of Land and Rice at 2 ms steps, as step 3's search and the
    /// organ's sensitivity analysis ask for it: with the cell's own periodic beat and biomarkers.
    pub ms_per_beat_of_a_cell: f64,
    /// Number of time steps in a beat.
    pub steps: usize,
    /// Evaluations of the wall for each of these steps.
    pub evaluations_per_step: f64,
    /// Number of activation groups.
    pub groups: u32,
    /// Counted repetitions of the beat without nodal traces.
    pub repetitions: usize,
}

/// The periodic beat of the base model at 2 ms steps, set-up included.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PeriodicTiming {
    /// Median time of a search that starts without a known orbit.
    pub ms_alone: f64,
    /// Number of beats in such a search.
    pub beats_alone: usize,
    /// Median time of a search that starts from the orbit of neighbouring parameters, where one of
    /// the fourteen values differs by a thousandth.
    pub ms_near_another: f64,
    /// Number of time steps in a beat.
    pub steps: usize,
    /// Number of activation groups.
    pub groups: usize,
    /// Counted repetitions of the search from a neighbouring orbit.
    pub repetitions: usize,
}

/// Times a beat of an average ventricle.
///
/// # Errors
/// Never for the built-in parameters.
pub fn beat() -> Result<BeatTiming, TaskError> {
    let (spec, passive, activation) = average_ventricle();
    let organ = organ_beat::ReducedOrgan::one_fibre(passive, activation);
    let (mut steps, mut evaluations) = (0, 0);
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
            } = organ_beat::reduced(&spec, &organ)?;
            if let BeatOutcome::Finished(result) =
                run_beats(&mut ventricle, &mut circulation, &settings)
            {
                steps = result.work.n_steps;
                evaluations = result.work.n_iterations;
            }
            Ok(())
        })
    };
    let (without, repetitions) = run(false)?;
    let (with, _) = run(true)?;
    let of_a_cell = OrganBeatSpec {
        time_step_ms: 2.0,
        contraction: ContractionSpec::Land2017Rice {
            parameters: EJECTING_CELL
                .map(|(name, value)| (name.to_owned(), value))
                .into(),
            lambda_0: 1.1,
        },
        ..spec.clone()
    };
    let (cell, _) = median_seconds(|| organ_beat::reduced_beat(&of_a_cell, &organ).map(|_| ()))?;
    let groups = activation.groups;
    Ok(BeatTiming {
        ms_per_beat: 1e3 * without,
        ms_per_beat_with_nodes: 1e3 * with,
        ms_per_beat_of_a_cell: 1e3 * cell,
        steps,
        evaluations_per_step: evaluations as f64 / steps.max(1) as f64,
        groups,
        repetitions,
    })
}

/// Times periodic beats of the average base model with the settings of a fit.
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
    // A Jacobian perturbs one parameter after the other; so does this.
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

/// Median time of a call in seconds, and the number of counted calls.
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

/// Model name of the processor, or the architecture where `/proc/cpuinfo` gives none.
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
