//! Simulates periodic beats of finite-element ventricles with Land's cells and hidden effects, for
//! `validation --beats FILE` of `solver/discover`.
//!
//! ```text
//! finite-element-hearts FILE.jsonl [--nulls N] [--singles N] [--doubles N] [--seed N] [--jobs N] [--nodes N]
//! ```
//!
//! Each line is a beat. Cases that the file already contains are skipped, so that a stopped command
//! can be continued.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write as _};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use cardiotwin_models::effects::{self, Kind};
use cardiotwin_schemas::finite_element::FiniteElementSettings;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::{
    BeatCount, ContractionSpec, EffectSpec, ValveParameters, WindkesselParameters, cell_default,
};
use cardiotwin_schemas::outcome::{Ending, TaskResult};
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::Fidelity;
use cardiotwin_schemas::task::TaskSpec;
use cardiotwin_validation::hidden::Hidden;
use cardiotwin_validation::patient::implausible;
use cardiotwin_validation::random::Random;
use cardiotwin_validation::simulated::{self, SimulatedBeat};
use cardiotwin_validation::{Hearts, Plan, PlannedCase};
use cardiotwin_worker::context::Context;
use cardiotwin_worker::tasks::run_task;

/// Number of hearts drawn before a case is given up.
const TRIES: u64 = 12;
/// Beats until the ventricle and its Windkessel are periodic.
const BEATS: BeatCount = BeatCount::Periodic {
    max: 25,
    tolerance: 0.2,
};
/// Parameters of the cell that differ between hearts: factor of the default, and spread of the
/// logarithm. With the defaults most hearts stay below 90 mmHg.
const CELL_SPREAD: [(&str, f64, f64); 8] = [
    ("k_TRPN_per_ms", 1.0, 0.15),
    ("Ca50_ref_uM", 1.0, 0.06),
    ("k_UW_per_ms", 1.0, 0.15),
    ("k_WS_per_ms", 1.0, 0.15),
    ("Smax_ref_kPa", 1.1, 0.05),
    ("Ca_max_uM", 1.3, 0.06),
    ("tau_CR_ms", 1.2, 0.12),
    ("tau_CD_ms", 1.2, 0.12),
];

/// A heart before it is simulated.
struct Heart {
    patient: ResolvedPatient,
    cell: BTreeMap<String, f64>,
    valves: ValveParameters,
}

/// Draws a heart; its loads lie in the ranges of `cardiotwin_validation::patient::draw`.
fn draw(random: &mut Random, n_nodes: u32) -> Heart {
    let mut patient =
        ResolvedPatient::without_data(PatientId("made".to_owned()), Workflow::Personalise);
    let cycle_ms = random.between(620.0, 1180.0).round();
    let end_diastolic_ml = random.between(95.0, 175.0);
    let filling_mmhg = random.between(7.0, 13.0);
    let mean_mmhg = random.between(80.0, 106.0);
    let stroke_ml = 0.55 * end_diastolic_ml;
    let characteristic = random.between(0.03, 0.06);
    let step0 = &mut patient.step0;
    step0.cycle_length_ms = cycle_ms;
    step0.end_diastolic_volume_ml = Some(end_diastolic_ml);
    step0.end_diastolic_pressure_mmhg = Some(filling_mmhg);
    step0.left_atrial_pressure_mmhg = Some(filling_mmhg * random.between(0.95, 1.15));
    step0.wall_volume_ml = Some(end_diastolic_ml * random.between(0.75, 1.0));
    step0.aortic_systolic_mmhg = Some(mean_mmhg + 25.0);
    step0.aortic_diastolic_mmhg = Some(mean_mmhg - 15.0);
    step0.afterload = Some(WindkesselParameters {
        characteristic_resistance_mmhg_s_per_ml: characteristic,
        peripheral_resistance_mmhg_s_per_ml: mean_mmhg / (stroke_ml / cycle_ms * 1e3)
            - characteristic,
        compliance_ml_per_mmhg: random.log_between(0.9, 2.4),
    });
    let solver = &mut patient.settings.solver;
    solver.fidelity = Fidelity::FiniteElement;
    solver.activation.onset_ms = Some(random.between(8.0, 40.0));
    solver.activation.spread_ms = random.between(25.0, 55.0);
    solver.finite_element = FiniteElementSettings {
        mesh_nodes: n_nodes,
        tolerance: 1e-3,
        ..FiniteElementSettings::default()
    };
    let cell = CELL_SPREAD
        .iter()
        .filter_map(|(name, factor, spread)| {
            let default = factor * cell_default(name)?;
            Some((
                (*name).to_owned(),
                default * (spread * random.normal()).exp(),
            ))
        })
        .collect();
    let valves = ValveParameters {
        r_av_f_mmhg_s_per_ml: random.between(0.003, 0.008),
        r_mv_f_mmhg_s_per_ml: random.between(0.008, 0.02),
        ..ValveParameters::default()
    };
    Heart {
        patient,
        cell,
        valves,
    }
}

/// An effect of the heart as the catalogue has it; `None` for an artefact.
fn effect(hidden: &Hidden) -> Option<EffectSpec> {
    let declared = effects::find(hidden.effect).ok()?;
    (declared.kind == Kind::Physiology).then(|| EffectSpec {
        name: hidden.effect.to_owned(),
        parameters: (hidden.physical.iter())
            .map(|(name, value)| ((*name).to_owned(), *value))
            .collect(),
    })
}

fn simulate(case: &PlannedCase, attempt: u64, n_nodes: u32) -> Result<SimulatedBeat, String> {
    let mut heart = draw(&mut case.random(attempt), n_nodes);
    heart.patient.effects = case.hidden(attempt).iter().filter_map(effect).collect();
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let mut context = Context::plain(folder.path(), 1);
    let step0 = heart.patient.step0_spec();
    let state = match answer(&TaskSpec::PassiveState(Box::new(step0)), &mut context)? {
        TaskResult::PassiveState(state) => state,
        _ => return Err("step 0 gave another result".to_owned()),
    };
    let wall_ml = heart.patient.step0.wall_volume_ml.unwrap_or(0.0);
    let contraction = ContractionSpec::Land2017Rice {
        parameters: heart.cell.clone(),
        lambda_0: 1.0,
    };
    let spec = heart
        .patient
        .beat_spec(&state, contraction, heart.valves, BEATS);
    match answer(&TaskSpec::OrganBeat(Box::new(spec)), &mut context)? {
        TaskResult::OrganBeat(result) if result.periodic => {}
        TaskResult::OrganBeat(result) => {
            return Err(format!("not periodic after {} beats", result.beats));
        }
        _ => return Err("the beat gave another result".to_owned()),
    }
    let text =
        std::fs::read_to_string(folder.path().join("traces.csv")).map_err(|e| e.to_string())?;
    let traces = Traces::read(&text, heart.patient.step0.cycle_length_ms)?;
    Ok(SimulatedBeat {
        case: case.id.clone(),
        seed: case.seed(),
        attempt,
        forward_ml: traces.forward_ml(),
        wall_ml,
        pressure_mmhg: traces.columns[0].clone(),
        volume_ml: traces.columns[1].clone(),
        aortic_pressure_mmhg: traces.columns[2].clone(),
    })
}

fn answer(task: &TaskSpec, context: &mut Context) -> Result<TaskResult, String> {
    match run_task(task, context) {
        Ending::Succeeded { result } => Ok(*result),
        Ending::Failed { failure } => Err(failure.message),
        Ending::Diverged { reason, .. } => Err(reason),
        Ending::Cancelled => Err("cancelled".to_owned()),
    }
}

/// Traces each millisecond: pressure, volume, aortic pressure, aortic flow.
struct Traces {
    columns: [Vec<f64>; 4],
}

impl Traces {
    fn read(text: &str, cycle_ms: f64) -> Result<Self, String> {
        let rows: Vec<Vec<f64>> = (text.lines().skip(1))
            .map(|line| {
                line.split(',')
                    .map(|v| v.parse::<f64>().map_err(|e| format!("{line}: {e}")))
                    .collect()
            })
            .collect::<Result<_, _>>()?;
        let at = |column: usize, t: f64| {
            let i = rows
                .partition_point(|row| row[0] <= t)
                .clamp(1, rows.len() - 1);
            let (a, b) = (&rows[i - 1], &rows[i]);
            let share = ((t - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
            a[column] * (1.0 - share) + b[column] * share
        };
        let begin = rows.first().ok_or("no traces")?[0];
        let each_ms = |column: usize| {
            (0..cycle_ms as usize)
                .map(|t| at(column, begin + t as f64))
                .collect()
        };
        Ok(Self {
            columns: [each_ms(1), each_ms(2), each_ms(3), each_ms(4)],
        })
    }

    fn forward_ml(&self) -> f64 {
        self.columns[3].iter().sum::<f64>() * 1e-3
    }
}

/// The first plausible beat of a case.
fn make(case: &PlannedCase, n_nodes: u32) -> Option<SimulatedBeat> {
    (0..TRIES).find_map(|attempt| match simulate(case, attempt, n_nodes) {
        Ok(beat) => match implausible(&beat.beat()) {
            None => Some(beat),
            Some(why) => {
                eprintln!("{} attempt {attempt}: {why}", case.id);
                None
            }
        },
        Err(why) => {
            eprintln!("{} attempt {attempt}: {why}", case.id);
            None
        }
    })
}

fn main() -> Result<(), String> {
    let usage = "usage: finite-element-hearts FILE.jsonl [--nulls N] [--singles N] [--doubles N] [--seed N] [--jobs N] [--nodes N]";
    let mut all = std::env::args().skip(1);
    let file = all.next().ok_or(usage)?;
    let (mut sets, mut seed, mut jobs, mut n_nodes) = (Vec::new(), 1, 2, 500);
    while let Some(flag) = all.next() {
        let value: u32 = all
            .next()
            .and_then(|v| v.parse().ok())
            .ok_or(format!("{flag} needs a number"))?;
        match flag.as_str() {
            "--nulls" => sets.push((Plan::Nulls, value)),
            "--singles" => sets.push((Plan::Singles, value)),
            "--doubles" => sets.push((Plan::Doubles, value)),
            "--seed" => seed = u64::from(value),
            "--jobs" => jobs = value,
            "--nodes" => n_nodes = value,
            _ => return Err(format!("unknown argument {flag}\n{usage}")),
        }
    }
    let path = Path::new(&file);
    let text = match std::fs::read_to_string(path) {
        Err(e) if e.kind() != ErrorKind::NotFound => return Err(format!("{file}: {e}")),
        text => text.unwrap_or_default(),
    };
    let (there, whole) = simulated::parse(&text).map_err(|e| format!("{file}: {e}"))?;
    if whole < text.len() {
        // The next beat must not continue a line that was cut off.
        std::fs::write(path, &text[..whole]).map_err(|e| format!("{file}: {e}"))?;
    }
    let cases: Vec<PlannedCase> = (sets.into_iter())
        .flat_map(|(plan, n)| plan.cases(n as usize, seed, Hearts::Elastance))
        .filter(|case| there.iter().all(|beat| beat.case != case.id))
        .collect();
    let out = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(path);
    let out = Mutex::new(out.map_err(|e| format!("{file}: {e}"))?);
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
            let Some(beat) = make(case, n_nodes) else {
                eprintln!(
                    "{}: no plausible heart has {:?}; left out",
                    case.id, case.effects
                );
                continue;
            };
            let line = serde_json::to_string(&beat).expect("numbers are JSON");
            let mut out = out.lock().expect("no thread has panicked");
            writeln!(out, "{line}").expect("the file can be written");
        }
    };
    std::thread::scope(|scope| (0..jobs).for_each(|_| drop(scope.spawn(work))));
    Ok(())
}
