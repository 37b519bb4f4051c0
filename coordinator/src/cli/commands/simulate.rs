//! `cardiotwin simulate`: one simulation of a patient's organ, outside of any run.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, PassiveStateResult, TaskOutcome, TaskResult};
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::CalciumSource;
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use clap::Args;
use serde::Serialize;
use serde_json::Value;

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::{Folders, OfCohort};
use crate::cli::problems;
use crate::cli::store::stored_overrides;
use crate::cli::table::{Columns, optional, percent};
use crate::cli::talk::{Talk, Tone, count};
use crate::cli::vtu::announcement;
use crate::engine::{Reader, StoreError, contraction, find_worker};
use crate::input::{self, Options, Report, nearest, value_from_text};
use crate::results::{Biomarker, PatientView};

/// Most beats until a periodic simulation gives up, and what it calls periodic (mmHg and mL).
const PERIODIC: BeatCount = BeatCount::Periodic { max: 100, tolerance: 0.05 };

/// One simulation of a patient's organ: traces out, nothing stored unless --out says where
#[derive(Debug, Args)]
#[command(
    after_help = "Parameters are those of the run's best iteration where there is a run, else step 1's first guess.\n\
                        Without --out, traces go to stdout as CSV and biomarkers to stderr."
)]
pub struct SimulateArgs {
    /// Whom
    patient: String,
    /// A parameter by its name, or a setting by its dotted key (may be given several times)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Number of beats, or `periodic` [default: the setting solver.beats]
    #[arg(long, value_name = "N|periodic", value_parser = beats)]
    beats: Option<BeatCount>,
    /// The fitted cell model of step 2 instead of Tanh, as in the verification beat
    #[arg(long)]
    cell: bool,
    /// Write traces.csv, nodal.csv, spec.json and outcome.json into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a series of VTU files for ParaView each so many simulated ms, into OUT/vtu (3D ventricle only)
    #[arg(long, value_name = "MS", requires = "out")]
    vtu_every: Option<f64>,
    /// One JSON object instead of CSV: specification, biomarkers, checks, traces
    #[arg(long)]
    json: bool,
    /// The worker's executable [default: cardiotwin-worker beside this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    #[command(flatten)]
    of: OfCohort,
}

fn beats(text: &str) -> Result<BeatCount, String> {
    match text {
        "periodic" => Ok(PERIODIC),
        _ => match text.parse() {
            Ok(n) if n > 0 => Ok(BeatCount::Fixed { n }),
            _ => Err("expected a number of 1 or more, or `periodic`".to_owned()),
        },
    }
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    patient: &'a str,
    specification: &'a OrganBeatSpec,
    result: &'a OrganBeatResult,
    /// Column by column.
    traces: serde_json::Map<String, Value>,
}

/// Simulates.
///
/// # Errors
/// [`CliError::Simulation`] where it diverged, [`CliError::Input`] for wrong input, [`CliError::Worker`].
pub async fn execute(args: &SimulateArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let (settings, parameters): (Vec<String>, Vec<String>) =
        args.set.iter().cloned().partition(|set| set.split('=').next().is_some_and(|key| key.contains('.')));
    let record = stored(&folders, &args.patient).await?;
    let overrides = stored_overrides(&folders.run, &args.patient).await?;
    let options = Options { only: vec![args.patient.clone()], set: settings, overrides, meshes: true };
    let plan = plan(&folders, &options, record.as_ref(), talk)?;
    let worker = find_worker(args.worker.as_deref())?;
    let scratch = tempfile::tempdir().map_err(CliError::file("make a folder in", std::env::temp_dir()))?;
    let passive = passive_state(&plan, record.as_ref(), &worker, scratch.path())?;
    let beats = args.beats.unwrap_or(BeatCount::Fixed { n: plan.settings.solver.beats });
    let spec = specification(args, &plan, &passive, record.as_ref(), beats)?;
    let spec = with_parameters(spec, &parameters).map_err(CliError::Usage)?;
    let out = args.out.clone().unwrap_or_else(|| scratch.path().join("beat"));
    let every_ms = args.vtu_every.unwrap_or(0.0);
    if let Some(said) = announcement(&plan, every_ms) {
        talk.say(&said);
    }
    let outcome = ask_worker(&worker, &TaskSpec::OrganBeat(Box::new(spec.clone())), &out, every_ms)?;
    let traces = outcome.artefacts.iter().find(|a| a.name == "traces").map(|a| out.join(&a.file));
    let result = match outcome.ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::OrganBeat(result) => result,
            _ => return Err(unexpected(&worker)),
        },
        other => return Err(CliError::Simulation { message: describe(&other) }),
    };
    let traces = traces.ok_or_else(|| unexpected(&worker))?;
    let text = std::fs::read_to_string(&traces).map_err(CliError::file("read", &traces))?;
    let screen = screen(&result, &passive, talk);
    if args.json {
        let (patient, traces) = (args.patient.as_str(), columns(&text));
        let schema_version = cardiotwin_schemas::SCHEMA_VERSION;
        talk.json(&Answer { schema_version, patient, specification: &spec, result: &result, traces })?;
    } else if args.out.is_some() {
        talk.data(&screen)?;
        talk.data(&format!("traces: {}\n", traces.display()))?;
    } else {
        talk.say(screen.trim_end());
        talk.data(&text)?;
    }
    Ok(if result.failed_check().is_some() { Exit::Problems } else { Exit::Ok })
}

/// What a run knows of the patient, where there is one.
async fn stored(folders: &Folders, patient: &str) -> Result<Option<PatientRecord>, CliError> {
    let reader = match Reader::open(&folders.run).await {
        Ok(reader) => reader,
        Err(StoreError::Missing { .. }) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    match reader.patient_record(&PatientId::from(patient)).await {
        Ok(record) => Ok(Some(record)),
        Err(StoreError::NoPatient { .. }) if folders.cohort.is_some() => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The patient as the files have it, or, where only a run was named, as the run has it.
fn plan(
    folders: &Folders,
    options: &Options,
    record: Option<&PatientRecord>,
    talk: &Talk,
) -> Result<ResolvedPatient, CliError> {
    let Some(cohort) = &folders.cohort else {
        return match record {
            Some(record) if options.set.is_empty() => Ok(record.plan.clone()),
            _ => Err(CliError::Usage("settings need the cohort: name it with --cohort".to_owned())),
        };
    };
    let mut report = Report::default();
    let plan = input::load(cohort, options, &mut report).and_then(|cohort| cohort.plans().pop());
    let said = problems::text(&report, talk.colour_err);
    if !said.is_empty() {
        talk.say(said.trim_end());
    }
    plan.filter(|_| report.n_errors() == 0).ok_or_else(|| CliError::Input { errors: count(report.n_errors(), "error") })
}

/// The run's passive state where it is that of these inputs, else made now.
fn passive_state(
    plan: &ResolvedPatient,
    record: Option<&PatientRecord>,
    worker: &Path,
    scratch: &Path,
) -> Result<PassiveStateResult, CliError> {
    let task = TaskSpec::PassiveState(Box::new(plan.step0_spec()));
    if let Some(step0) = record.and_then(|record| record.step0.as_ref()).filter(|step0| step0.key == task.key()) {
        return Ok(step0.result.clone());
    }
    match ask_worker(worker, &task, &scratch.join("passive-state"), 0.0)?.ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::PassiveState(result) => Ok(result),
            _ => Err(unexpected(worker)),
        },
        other => Err(CliError::Simulation { message: format!("passive state: {}", describe(&other)) }),
    }
}

fn specification(
    args: &SimulateArgs,
    plan: &ResolvedPatient,
    passive: &PassiveStateResult,
    record: Option<&PatientRecord>,
    beats: BeatCount,
) -> Result<OrganBeatSpec, CliError> {
    let best = record.and_then(|record| PatientView(record).best_iteration()).map(|iteration| iteration.parameters);
    let (tanh, valves) = best.map_or((plan.settings.step1.initial, plan.settings.step1.valves), |p| (p.tanh, p.valves));
    let contraction = if args.cell {
        let fit = record.and_then(|record| record.cell_fit.as_ref()).ok_or_else(|| {
            CliError::Usage(format!("--cell: step 2 of {} is not done; `cardiotwin run` does it", args.patient))
        })?;
        let fixed = plan.settings.step2.calcium == CalciumSource::MedianTrace;
        contraction(plan, &fit.result, plan.calcium.clone().filter(|_| fixed))
    } else {
        ContractionSpec::Tanh { parameters: tanh }
    };
    Ok(plan.beat_spec(passive, contraction, valves, beats))
}

/// Puts `name=value` wherever the specification has a leaf of this name.
fn with_parameters(spec: OrganBeatSpec, assignments: &[String]) -> Result<OrganBeatSpec, String> {
    let mut value = serde_json::to_value(&spec).map_err(|error| error.to_string())?;
    for assignment in assignments {
        let (name, text) =
            assignment.split_once('=').ok_or_else(|| format!("--set {assignment}: expected KEY=VALUE"))?;
        let number = match value_from_text(text.trim()).value {
            input::Tree::Float(number) => number,
            input::Tree::Integer(number) => number as f64,
            other => return Err(format!("--set {name}: expected a number, found {}", other.describe())),
        };
        let mut known = Vec::new();
        if !replace(&mut value, name.trim(), number, &mut known) {
            // A cell parameter that is at its default does not stand in the specification.
            let cell = !matches!(spec.contraction, ContractionSpec::Tanh { .. });
            if cell && cardiotwin_schemas::organ::CELL_PARAMETERS.contains(&name.trim()) {
                value["contraction"]["parameters"][name.trim()] = number.into();
                continue;
            }
            let meant =
                nearest(name, known.iter().map(String::as_str)).map(|meant| format!("; did you mean `{meant}`?"));
            return Err(format!("--set {name}: no such parameter{}", meant.unwrap_or_default()));
        }
    }
    serde_json::from_value(value).map_err(|error| format!("--set: {error}"))
}

/// Replaces numbers called `name`; collects the names of all numbers on the way.
fn replace(value: &mut Value, name: &str, number: f64, known: &mut Vec<String>) -> bool {
    let mut found = false;
    if let Value::Object(map) = value {
        for (key, inner) in map.iter_mut() {
            if inner.is_number() {
                known.push(key.clone());
                if key == name {
                    // Counts stay counts, so that the specification can be read again.
                    *inner =
                        if inner.is_u64() && number.fract() == 0.0 { (number as u64).into() } else { number.into() };
                    found = true;
                }
            }
            found |= replace(inner, name, number, known);
        }
    }
    found
}

fn ask_worker(worker: &Path, task: &TaskSpec, out: &Path, vtu_every_ms: f64) -> Result<TaskOutcome, CliError> {
    let said = |message: String| CliError::Worker { worker: worker.to_owned(), message };
    std::fs::create_dir_all(out).map_err(CliError::file("make", out))?;
    let spec = out.join("spec.json");
    let text = serde_json::to_string_pretty(task).map_err(|error| said(error.to_string()))?;
    std::fs::write(&spec, text).map_err(CliError::file("write", &spec))?;
    let output = Command::new(worker)
        .args(["simulate".as_ref(), spec.as_os_str(), "--out".as_ref(), out.as_os_str()])
        .args(["--vtu-every", &vtu_every_ms.to_string()])
        .stdin(Stdio::null())
        .output()
        .map_err(CliError::file("start", worker))?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        return Err(said(format!("{}, {}", output.status, words.trim())));
    }
    let outcome = out.join("outcome.json");
    std::fs::write(&outcome, &output.stdout).map_err(CliError::file("write", &outcome))?;
    serde_json::from_slice(&output.stdout).map_err(|error| said(format!("an answer that is no outcome: {error}")))
}

fn unexpected(worker: &Path) -> CliError {
    CliError::Worker {
        worker: worker.to_owned(),
        message: "an outcome of another task, or without its files".to_owned(),
    }
}

fn describe(ending: &Ending) -> String {
    match ending {
        Ending::Diverged { last_good_ms, reason } => format!("diverged after {last_good_ms} ms: {reason}"),
        Ending::Failed { failure } => format!("failed [{}]: {}", failure.class.as_str(), failure.message),
        Ending::Cancelled => "stopped".to_owned(),
        Ending::Succeeded { .. } => "succeeded".to_owned(),
    }
}

/// Biomarkers beside the measured ones, then the checks.
fn screen(result: &OrganBeatResult, passive: &PassiveStateResult, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["BIOMARKER", ">MEASURED", ">SIMULATED", ">DIFFERENCE"]);
    for biomarker in Biomarker::ALL {
        let (measured, simulated) = (biomarker.of(&passive.measured), biomarker.of(&result.biomarkers));
        if measured.or(simulated).is_some() {
            let difference =
                measured.zip(simulated).and_then(|(m, s)| crate::results::comparison::relative_difference(s, m));
            table.row([biomarker.key().to_owned(), optional(measured), optional(simulated), percent(difference)]);
        }
    }
    let mut checks = Columns::new(talk, &["CHECK", "HOLDS", "FOUND", "EXPECTED"]);
    for check in &result.checks {
        let holds =
            if check.passed { ("yes".to_owned(), Some(Tone::Good)) } else { ("NO".to_owned(), Some(Tone::Bad)) };
        checks.toned([(check.name.clone(), None), holds, (check.found.clone(), None), (check.expected.clone(), None)]);
    }
    let periodic = if result.periodic { ", periodic" } else { "" };
    let mut text = format!("{}\n{}{}{periodic}\n", table.text(), checks.text(), count(result.beats as usize, "beat"));
    for remark in &result.remarks {
        text.push_str(&format!("remark: {remark}\n"));
    }
    text
}

/// A CSV file column by column; a cell that is no number is null.
fn columns(text: &str) -> serde_json::Map<String, Value> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let mut columns = vec![Vec::new(); names.len()];
    for line in lines {
        for (column, cell) in columns.iter_mut().zip(line.split(',')) {
            column.push(cell.parse::<f64>().map_or(Value::Null, Value::from));
        }
    }
    names.into_iter().map(str::to_owned).zip(columns.into_iter().map(Value::Array)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec() -> OrganBeatSpec {
        serde_json::from_value(serde_json::json!({
            "cycle_length_ms": 700.0, "time_step_ms": 1.0, "shortest_step_ms": 0.015625, "newton_iterations": 60,
            "organ": {"fidelity": "reduced",
                "passive": {"wall_volume_mL": 90.0, "unloaded_volume_mL": 60.0, "end_diastolic_volume_mL": 120.0,
                            "end_diastolic_pressure_mmHg": 9.0, "stiffness_kPa": 0.5, "exponent": 9.24},
                "activation": {"spread_ms": 40.0, "groups": 16, "onset_ms": 20.0}},
            "circulation": {"afterload": {"characteristic_resistance_mmHg_s_per_mL": 0.03,
                "peripheral_resistance_mmHg_s_per_mL": 0.9, "compliance_mL_per_mmHg": 1.2},
                "initial_windkessel_pressure_mmHg": 70.0, "left_atrial_pressure_mmHg": 7.0},
            "valves": {}, "contraction": {"model": "tanh", "parameters": {}},
            "beats": {"mode": "fixed", "n": 1}, "measured_end_diastolic_volume_mL": 120.0
        }))
        .unwrap()
    }

    #[test]
    fn parameters_are_found_by_name_wherever_they_stand() {
        let set = ["Smax_ref_kPa=120".to_owned(), "groups=8".to_owned(), "left_atrial_pressure_mmHg=5.5".to_owned()];
        let changed = with_parameters(spec(), &set).unwrap();
        assert_eq!(changed.circulation.left_atrial_pressure_mmhg, 5.5);
        let ContractionSpec::Tanh { parameters } = changed.contraction else { panic!() };
        assert_eq!(parameters.smax_ref_kpa, 120.0);
    }

    #[test]
    fn an_unknown_parameter_or_a_text_is_refused() {
        let error = with_parameters(spec(), &["Smax_ref=120".to_owned()]).unwrap_err();
        assert!(error.contains("did you mean `Smax_ref_kPa`?"), "{error}");
        assert!(with_parameters(spec(), &["Smax_ref_kPa=high".to_owned()]).unwrap_err().contains("expected a number"));
        assert!(with_parameters(spec(), &["groups=2.5".to_owned()]).is_err(), "a count is a count");
    }

    #[test]
    fn beats_are_a_number_or_periodic() {
        assert_eq!(beats("3"), Ok(BeatCount::Fixed { n: 3 }));
        assert_eq!(beats("periodic"), Ok(PERIODIC));
        assert!(beats("0").is_err() && beats("many").is_err());
    }

    #[test]
    fn traces_are_told_column_by_column() {
        let columns = columns("time_ms,V\n0,1.5\n1,\n");
        assert_eq!(Value::Object(columns), serde_json::json!({"time_ms": [0.0, 1.0], "V": [1.5, null]}));
    }
}
