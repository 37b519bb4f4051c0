//! A patient of the bundled cohort as tasks, and a direct implementation of step 1's loop, for
//! tests and the `step1_seven` example.
#![allow(dead_code, missing_docs)]

pub mod vtk_reader;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_calibrate::fixed_point::{self, Decision, History, Outcome};
use cardiotwin_schemas::filling::FlowMeasurements;
use cardiotwin_schemas::finite_element::FiniteElementSettings;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::organ::{
    BeatCount, CellStretch, ContractionSpec, OrganSpec, Step1Parameters,
};
use cardiotwin_schemas::outcome::{
    CellFitResult, Ending, OrganBeatResult, PassiveStateResult, TargetsResult, TaskResult,
};
use cardiotwin_schemas::patient::PatientFile;
use cardiotwin_schemas::settings::{
    ActivationSettings, CellFitSettings, SolverSettings, StartMode, Step1Settings, Update,
};
use cardiotwin_schemas::task::{
    CellFitSpec, InputFile, OrganBeatSpec, PassiveStateSpec, TargetsSpec, TaskSpec,
};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::run_task;

pub const PATIENTS: [&str; 7] = [
    "01-CoA", "02-CoA", "03-CoA", "04-CoA", "05-CoA", "06-CoA", "07-CoA",
];

pub fn patient_folder(id: &str) -> PathBuf {
    // Programs of dev/ include this file, and lie deeper.
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let mut folders = above.map(|folder| folder.join("examples/coa-seven/patients"));
    let patients = folders.find(|folder| folder.is_dir());
    patients.expect("the bundled cohort").join(id)
}

/// A file as input of a task, with the hash of its present content.
pub fn input(name: &str, path: &Path) -> InputFile {
    let sha256 = sha256_hex(
        &std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())),
    );
    InputFile {
        name: name.to_owned(),
        path: path.to_owned(),
        sha256,
    }
}

/// Specification of step 0 for a patient of the cohort.
pub fn step0(id: &str) -> PassiveStateSpec {
    let folder = patient_folder(id);
    let text = std::fs::read_to_string(folder.join("patient.toml")).unwrap();
    let file: PatientFile = toml::from_str(&text).unwrap();
    let measured = &file.measured;
    PassiveStateSpec {
        cycle_length_ms: file.cycle_length_ms,
        pressure: measured
            .pressure
            .as_ref()
            .map(|name| input("pressure", &folder.join(name))),
        volume: measured
            .volume
            .as_ref()
            .map(|name| input("volume", &folder.join(name))),
        biomarkers: measured.biomarkers.unwrap_or_default(),
        end_diastolic_pressure_mmhg: measured.end_diastolic_pressure_mmhg,
        end_diastolic_volume_ml: measured.end_diastolic_volume_ml,
        diastasis_time_ms: measured.diastasis.as_ref().map(|image| image.time_ms),
        diastasis_volume_ml: measured.diastasis.as_ref().map(|image| image.volume_ml),
        aortic_systolic_mmhg: measured
            .aortic_pressure
            .as_ref()
            .map(|aorta| aorta.systolic_mmhg),
        aortic_diastolic_mmhg: measured
            .aortic_pressure
            .as_ref()
            .map(|aorta| aorta.diastolic_mmhg),
        wall_volume_ml: file.anatomy.wall_volume_ml,
        passive_exponent: None,
        afterload: file.afterload,
        left_atrial_pressure_mmhg: file
            .preload
            .as_ref()
            .map(|preload| preload.left_atrial_pressure_mmhg),
        flows: FlowMeasurements {
            forward_stroke_volume: measured.forward_stroke_volume.clone(),
            ..FlowMeasurements::default()
        },
        start: StartMode::EndDiastole,
        activation: ActivationSettings::default(),
        biomarker_factors: BTreeMap::new(),
        passive_law: None,
        corrections: Vec::new(),
        finite_element: None,
        own_mesh: None,
        guccione_c_kpa: None,
    }
}

/// Runs a task that must succeed and returns its result.
pub fn succeed(task: &TaskSpec, context: &mut Context) -> TaskResult {
    match run_task(task, context) {
        Ending::Succeeded { result } => *result,
        ending => panic!("{}: {ending:?}", task.kind()),
    }
}

pub fn passive_state(spec: &PassiveStateSpec, context: &mut Context) -> PassiveStateResult {
    match succeed(&TaskSpec::PassiveState(Box::new(spec.clone())), context) {
        TaskResult::PassiveState(result) => result,
        other => panic!("{other:?}"),
    }
}

/// Specification of a patient's beat with any contraction model.
pub fn beat_spec(
    cycle_length_ms: f64,
    state: &PassiveStateResult,
    parameters: &Step1Parameters,
    contraction: ContractionSpec,
) -> OrganBeatSpec {
    OrganBeatSpec {
        cycle_length_ms,
        time_step_ms: 1.0,
        shortest_step_ms: SolverSettings::default().shortest_step_ms,
        newton_iterations: match state.organ {
            OrganSpec::Reduced { .. } | OrganSpec::External(_) => {
                SolverSettings::default().newton_iterations
            }
            OrganSpec::FiniteElement(_) => FiniteElementSettings::default().newton_iterations,
        },
        organ: state.organ.clone(),
        circulation: state.circulation.clone(),
        valves: parameters.valves,
        contraction,
        cell_stretch: CellStretch::default(),
        beats: BeatCount::Fixed { n: 1 },
        measured_end_diastolic_volume_ml: state.measured.edv_ml,
        noise_windows: state.noise_windows,
        finite_element: match state.organ {
            OrganSpec::Reduced { .. } | OrganSpec::External(_) => None,
            OrganSpec::FiniteElement(_) => Some(FiniteElementSettings::default().equations()),
        },
    }
}

/// One iteration of step 1.
pub struct Iteration {
    pub parameters: Step1Parameters,
    /// Result of the simulation, or the reason of its failure.
    pub result: Result<OrganBeatResult, String>,
    pub cost: f64,
}

/// Settings of the fixed-point update.
pub fn fixed_point_settings(settings: &Step1Settings) -> Step1Settings {
    Step1Settings {
        update: Update::FixedPoint,
        ..settings.clone()
    }
}

/// Runs step 1. Returns its iterations, the best of them, and how it ended.
pub fn step1(
    cycle_length_ms: f64,
    state: &PassiveStateResult,
    settings: &Step1Settings,
    context: &mut Context,
) -> (Vec<Iteration>, Option<usize>, String) {
    let measured = &state.measured;
    let mut history = History::new(settings.start());
    let mut iterations = Vec::new();
    loop {
        let decision =
            fixed_point::decide(&fixed_point_settings(settings), measured, &history).unwrap();
        let parameters = match decision {
            Decision::Ended {
                quality,
                because,
                best,
            } => {
                return (iterations, best, format!("{quality:?} ({because:?})"));
            }
            Decision::Next { parameters, .. } => parameters,
        };
        let spec = beat_spec(
            cycle_length_ms,
            state,
            &parameters,
            ContractionSpec::Tanh {
                parameters: parameters.tanh,
            },
        );
        let result = match run_task(&TaskSpec::OrganBeat(Box::new(spec)), context) {
            Ending::Succeeded { result } => match *result {
                TaskResult::OrganBeat(result) => match result.failed_check() {
                    None => Ok(result),
                    Some(check) => Err(format!(
                        "{}: {} (expected {})",
                        check.name, check.found, check.expected
                    )),
                },
                other => panic!("{other:?}"),
            },
            ending => Err(format!("{ending:?}")),
        };
        let (outcome, cost) = match &result {
            Ok(result) => (
                Outcome::of(&result.biomarkers, true),
                fixed_point::Cost::of(measured, &result.biomarkers).total,
            ),
            Err(_) => (Outcome::Failed, f64::NAN),
        };
        history.push(parameters, outcome);
        iterations.push(Iteration {
            parameters,
            result,
            cost,
        });
    }
}

/// Targets from the last beat in `directory`.
pub fn targets(directory: &Path, context: &mut Context) -> TargetsResult {
    let nodal = input("nodal", &directory.join("nodal.csv"));
    match succeed(&TaskSpec::Targets(TargetsSpec { nodal }), context) {
        TaskResult::Targets(result) => result,
        other => panic!("{other:?}"),
    }
}

pub fn cell_fit_spec(
    cycle_length_ms: f64,
    targets: &TargetsResult,
    settings: CellFitSettings,
) -> CellFitSpec {
    CellFitSpec {
        cycle_length_ms,
        lambda_0: targets.lambda_0,
        lambda_max: targets.lambda_max,
        targets: targets.targets,
        seed: settings.seed,
        settings,
        fixed: BTreeMap::new(),
        calcium: None,
    }
}

/// The fitted cell as contraction model of the verification beat.
pub fn fitted_contraction(fit: &CellFitResult) -> ContractionSpec {
    let parameters = fit
        .parameters
        .iter()
        .map(|parameter| (parameter.name.clone(), parameter.value));
    ContractionSpec::Land2017Rice {
        parameters: parameters.collect(),
        lambda_0: fit.lambda_0,
    }
}
