//! The reduced twin of a new patient: what its data lack, and how much the estimates that stand for
//! them matter.

use std::path::Path;

use cardiotwin_calibrate::fixed_point::{self, Decision, History, Outcome, Quality};
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec, Step1Parameters};
use cardiotwin_schemas::outcome::{
    Ending, Estimate, OrganBeatResult, PassiveStateResult, TaskResult,
};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::task::{PassiveStateSpec, TaskSpec};
use serde::Serialize;

use crate::error::CliError;
use crate::ventricle::{AskedFor, PERIODIC, ask_worker, describe, unexpected};

/// Share by which an estimate is changed to see how much it matters.
pub const SHARE: f64 = 0.2;
/// The twin of step 1, and what an error of each estimate does to it.
#[derive(Debug, Serialize)]
pub struct Twin {
    /// Cost of the best beat: squared relative differences of the biomarkers, summed.
    pub cost: f64,
    /// Whether the cost is within the tolerance of step 1.
    pub converged: bool,
    /// Number of beats until then.
    pub beats: usize,
    /// Estimates, each with the changes that an error of it makes.
    pub estimates: Vec<Weighed>,
}

/// An estimate and what an error of it does.
#[derive(Debug, Serialize)]
pub struct Weighed {
    /// Key of the patient's file for which the estimate stands.
    pub key: String,
    /// Value in the key's unit.
    pub value: f64,
    /// Method of the estimate.
    pub method: String,
    /// Changes if the quantity is smaller by [`SHARE`]; absent where it does not act on a beat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub if_smaller: Option<Change>,
    /// Changes if it is larger by as much.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub if_larger: Option<Change>,
}

/// Relative changes of the twin's periodic state, with its muscle unchanged.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Change {
    /// Relative change of the stroke volume.
    pub stroke_volume: f64,
    /// Relative change of the largest pressure.
    pub largest_pressure: f64,
}

/// A step-0 field that an estimate fills, changed by a factor.
fn changed(
    spec: &mut PassiveStateSpec,
    step0: &PassiveStateResult,
    key: &str,
    factor: f64,
) -> bool {
    let estimate = step0.estimates.iter().find(|estimate| estimate.key == key);
    let Some(value) = estimate.map(|estimate| factor * estimate.value) else {
        return false;
    };
    let mut load = step0.circulation.afterload;
    match key {
        "anatomy.wall_volume_mL" => {
            spec.wall_volume_ml = Some(value);
            return true;
        }
        "preload.left_atrial_pressure_mmHg" => {
            spec.left_atrial_pressure_mmhg = Some(value);
            return true;
        }
        "afterload.characteristic_resistance_mmHg_s_per_mL" => {
            load.characteristic_resistance_mmhg_s_per_ml = value;
        }
        "afterload.peripheral_resistance_mmHg_s_per_mL" => {
            load.peripheral_resistance_mmhg_s_per_ml = value;
        }
        "afterload.compliance_mL_per_mmHg" => load.compliance_ml_per_mmhg = value,
        _ => return false,
    }
    spec.afterload = Some(load);
    true
}

/// Fits the reduced twin's step 1, and simulates it with each estimate changed.
///
/// # Errors
/// [`CliError::Simulation`] if the passive state or every beat of step 1 fails,
/// [`CliError::Worker`] if the worker cannot be run.
pub fn of(plan: &ResolvedPatient, worker: &Path) -> Result<Twin, CliError> {
    let scratch =
        tempfile::tempdir().map_err(CliError::file("create a folder in", std::env::temp_dir()))?;
    let lab = Lab {
        plan,
        worker,
        out: scratch.path(),
    };
    let spec = plan.step0_spec();
    let step0 = lab.passive_state(&spec)?;
    let settings = plan.settings.step1_resolved();
    let invalid = |error: fixed_point::FixedPointError| CliError::Simulation {
        message: format!("step 1: {error}"),
    };
    let mut history = History::new(settings.start());
    let fixed = BeatCount::Fixed {
        n: plan.settings.solver.beats,
    };
    let (best, quality) = loop {
        let decision =
            fixed_point::decide(&settings, &step0.measured, &history).map_err(invalid)?;
        match decision {
            Decision::Next { parameters, .. } => {
                let outcome = match lab.beat(&step0, &parameters, fixed)? {
                    Some(beat) => Outcome::of(&beat.biomarkers, beat.failed_valve().is_none()),
                    None => Outcome::Failed,
                };
                history.push(parameters, outcome);
            }
            Decision::Ended { best, quality, .. } => break (best, quality),
        }
    };
    let best = best.map(|i| history.iterations[i]);
    let Some((parameters, Outcome::Simulated(biomarkers))) =
        best.map(|best| (best.parameters, best.outcome))
    else {
        return Err(CliError::Simulation {
            message: "step 1: no beat of the reduced ventricle was whole: check the traces"
                .to_owned(),
        });
    };
    let cost = fixed_point::Cost::of(&step0.measured, &biomarkers).total;
    let base = lab.steady(&step0, &parameters)?;
    let weighed = |estimate: &Estimate| -> Result<Weighed, CliError> {
        let change = |factor: f64| -> Result<Option<Change>, CliError> {
            let mut other = spec.clone();
            if !changed(&mut other, &step0, &estimate.key, factor) {
                return Ok(None);
            }
            // A changed estimate that the passive state cannot have tells nothing.
            let Ok(step0) = lab.passive_state(&other) else {
                return Ok(None);
            };
            let there = lab.steady(&step0, &parameters)?;
            Ok(base.zip(there).map(|(a, b)| Change {
                stroke_volume: b.0 / a.0 - 1.0,
                largest_pressure: b.1 / a.1 - 1.0,
            }))
        };
        Ok(Weighed {
            key: estimate.key.clone(),
            value: estimate.value,
            method: estimate.method.clone(),
            if_smaller: change(1.0 - SHARE)?,
            if_larger: change(1.0 + SHARE)?,
        })
    };
    Ok(Twin {
        cost,
        converged: quality == Quality::Converged,
        beats: history.iterations.len(),
        estimates: step0
            .estimates
            .iter()
            .map(weighed)
            .collect::<Result<_, _>>()?,
    })
}

/// The worker, asked for one patient.
struct Lab<'a> {
    plan: &'a ResolvedPatient,
    worker: &'a Path,
    out: &'a Path,
}

impl Lab<'_> {
    fn ask(&self, task: &TaskSpec) -> Result<Ending, CliError> {
        let outcome = ask_worker(self.worker, task, self.out, 0.0, AskedFor::TheOrgan)?;
        Ok(outcome.ending)
    }

    fn passive_state(&self, spec: &PassiveStateSpec) -> Result<PassiveStateResult, CliError> {
        match self.ask(&TaskSpec::PassiveState(Box::new(spec.clone())))? {
            Ending::Succeeded { result } => match *result {
                TaskResult::PassiveState(result) => Ok(result),
                _ => Err(unexpected(self.worker)),
            },
            other => Err(CliError::Simulation {
                message: format!("passive state: {}", describe(&other)),
            }),
        }
    }

    /// A beat with these parameters; `None` if it fails.
    fn beat(
        &self,
        step0: &PassiveStateResult,
        parameters: &Step1Parameters,
        beats: BeatCount,
    ) -> Result<Option<OrganBeatResult>, CliError> {
        let muscle = ContractionSpec::Tanh {
            parameters: parameters.tanh,
        };
        let spec = self.plan.beat_spec(step0, muscle, parameters.valves, beats);
        match self.ask(&TaskSpec::OrganBeat(Box::new(spec)))? {
            Ending::Succeeded { result } => match *result {
                TaskResult::OrganBeat(result) => Ok(Some(result)),
                _ => Err(unexpected(self.worker)),
            },
            _ => Ok(None),
        }
    }

    /// Stroke volume (mL) and largest pressure (mmHg) of the periodic state; `None` if there is none.
    fn steady(
        &self,
        step0: &PassiveStateResult,
        parameters: &Step1Parameters,
    ) -> Result<Option<(f64, f64)>, CliError> {
        let beat = self.beat(step0, parameters, PERIODIC)?;
        let biomarkers = beat
            .filter(|beat| beat.periodic)
            .map(|beat| beat.biomarkers);
        Ok(biomarkers.and_then(|found| found.sv_ml.zip(found.p_max_mmhg)))
    }
}
