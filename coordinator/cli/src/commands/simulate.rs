//! `cardiotwin simulate`: one simulation of a patient's organ, outside any run.

use std::collections::BTreeMap;
use std::path::PathBuf;

use cardiotwin_engine::find_worker;
use cardiotwin_input::{self as input, nearest, value_from_text};
use cardiotwin_report::results::tables::biomarkers;
use cardiotwin_schemas::organ::{
    BeatCount, CELL_PARAMETERS, ClosedLoopSpec, ContractionSpec, LoopFilling, OrganSpec,
};
use cardiotwin_schemas::outcome::{Ending, OrganBeatResult, PassiveStateResult, TaskResult};
use cardiotwin_schemas::task::{OrganBeatSpec, TaskSpec};
use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::Value;

use crate::commands::predict::circuit::{Ventricles, beginning_at};
use crate::commands::predict::law_file::LawKnowledgeFile;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::OfCohort;
use crate::table::{self, Columns};
use crate::talk::{Talk, Tone, count};
use crate::ventricle::{
    AskedFor, CirculationKind, PERIODIC, PERIODIC_IN_3D, Ventricle, ask_worker, describe,
    unexpected,
};
use crate::vtu::announcement;

/// Simulate a patient's organ once and print its traces; files are written only with --out
#[derive(Debug, Args)]
#[command(
    after_help = "Without --as, parameters are those of step 1's best iteration, or its first guess if \
                  there is no run. The output says which.\n\
                  Without --out, traces go to stdout as CSV and biomarkers to stderr."
)]
pub struct SimulateArgs {
    /// Name of the patient
    patient: String,
    /// Override a parameter by its name, or a setting by its dotted key (may be given several
    /// times)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Number of beats, or `periodic` [default: the setting solver.beats]
    #[arg(long, value_name = "N|periodic", value_parser = beats)]
    beats: Option<BeatCount>,
    /// Circulation: `open`, an atrium at constant pressure and a Windkessel, or `closed`, a loop through
    /// body, right heart and lungs to an atrium that contracts (not for external solvers; periodic
    /// unless --beats is given)
    #[arg(long, value_enum, default_value_t = CirculationKind::Open)]
    circulation: CirculationKind,
    /// Parameters to simulate with: those of the twin, of step 2's cell as in the verification beat, or
    /// of step 1's Tanh model [default: step1]
    #[arg(
        long = "as",
        id = "as",
        value_name = "twin|step1|step2",
        value_enum,
        hide_possible_values = true
    )]
    of_step: Option<Of>,
    /// The same as --as step2
    #[arg(long, conflicts_with = "as")]
    cell: bool,
    /// Use a contraction model of the catalogue instead of Tanh, for example bestel-clement-sorine or
    /// tor-ord-land; the answer to an unknown name has all of them
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["cell", "as"])]
    contraction: Option<String>,
    /// Write traces.csv, nodal.csv, spec.json and outcome.json into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a VTU file for ParaView at this interval of simulated time, in ms, into OUT/vtu (3D
    /// ventricle only)
    #[arg(long, value_name = "MS", requires = "out")]
    vtu_every: Option<f64>,
    /// Print one JSON object with specification, biomarkers, checks and traces instead of CSV
    #[arg(long)]
    json: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    #[command(flatten)]
    of: OfCohort,
}

/// Stroke volume over end-diastolic volume at the start of a loop, if no stroke volume is measured.
const EJECTION_FRACTION: f64 = 0.6;

/// Closes the circulation. A 3D ventricle starts from the periodic beat in its law, whose loop has the blood
/// with which it fills to the same end-diastolic volume.
fn close(spec: &mut OrganBeatSpec, passive: &PassiveStateResult) -> Result<(), CliError> {
    let (end_diastolic_volume_ml, filling) = match &spec.organ {
        OrganSpec::Reduced { passive, .. } => (passive.end_diastolic_volume_ml, None),
        OrganSpec::FiniteElement(organ) => {
            let volume_ml = organ.figures.end_diastolic_volume_ml;
            (
                volume_ml,
                Some(LoopFilling::EndDiastolicVolume { volume_ml }),
            )
        }
        OrganSpec::External(_) => {
            let message = "--circulation closed: the loop does not surround the ventricle of an external \
                           solver; add `--set solver.fidelity=reduced`";
            return Err(CliError::Usage(message.to_owned()));
        }
    };
    let measured = passive.measured.sv_ml;
    spec.circulation.closed = Some(ClosedLoopSpec {
        stroke_volume_ml: measured.unwrap_or(EJECTION_FRACTION * end_diastolic_volume_ml),
        venous_share: None,
        rest: None,
        filling,
        contents: None,
    });
    Ok(())
}

/// Origin of the simulated parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
enum Of {
    /// The twin: the best of step 3.
    Twin,
    /// Step 1's Tanh model.
    Step1,
    /// Step 2's cell with step 1's valves.
    Step2,
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
    simulated_as: Of,
    /// Origin of the parameters in words.
    parameters: &'a str,
    specification: &'a OrganBeatSpec,
    result: &'a OrganBeatResult,
    /// One array per column.
    traces: serde_json::Map<String, Value>,
}

/// Simulates the beats and prints traces, biomarkers and checks.
///
/// # Errors
/// [`CliError::Simulation`] if the simulation diverges, [`CliError::Input`] for invalid input,
/// [`CliError::Usage`] for an unknown parameter, [`CliError::Worker`] if the worker cannot be run.
pub async fn execute(args: &SimulateArgs, talk: &Talk) -> Result<Exit, CliError> {
    let (settings, parameters): (Vec<String>, Vec<String>) = args
        .set
        .iter()
        .cloned()
        .partition(|set| set.split('=').next().is_some_and(|key| key.contains('.')));
    let worker = find_worker(args.worker.as_deref())?;
    let ventricle =
        Ventricle::of(&args.of.folders(), &args.patient, settings, &worker, talk).await?;
    let beats = args.beats.unwrap_or(match args.circulation {
        CirculationKind::Open => BeatCount::Fixed {
            n: ventricle.plan.settings.solver.beats,
        },
        CirculationKind::Closed => match ventricle.passive.organ {
            OrganSpec::FiniteElement(_) => PERIODIC_IN_3D,
            OrganSpec::Reduced { .. } | OrganSpec::External(_) => PERIODIC,
        },
    });
    let simulated_as = match (args.of_step, args.cell) {
        (Some(of_step), _) => of_step,
        (None, true) => Of::Step2,
        (None, false) => Of::Step1,
    };
    let (mut spec, mut origin) = match simulated_as {
        Of::Step1 => (ventricle.beat_of_step1(beats), ventricle.origin_of_step1()),
        Of::Step2 => {
            let option = if args.cell { "--cell" } else { "--as step2" };
            let origin = "step 2's cell with step 1's valves, as in the verification beat";
            (ventricle.beat_of_step2(option, beats)?, origin.to_owned())
        }
        Of::Twin => {
            let beat = ventricle.beat_of_twin("--as twin", beats)?;
            (beat, ventricle.origin_of_twin().to_owned())
        }
    };
    if let Some(name) = &args.contraction {
        spec.contraction = ContractionSpec::Catalogue {
            name: name.clone(),
            parameters: BTreeMap::new(),
        };
        origin = format!("{name} at its defaults, with step 1's valves");
    }
    if !parameters.is_empty() {
        origin.push_str(&format!(", with {}", parameters.join(", ")));
    }
    if args.circulation == CirculationKind::Closed {
        close(&mut spec, &ventricle.passive)?;
    }
    let mut spec = with_parameters(spec, &parameters).map_err(CliError::Usage)?;
    let searches_in_law =
        spec.circulation.closed.is_some() && matches!(spec.organ, OrganSpec::FiniteElement(_));
    if searches_in_law && let Some(law) = LawKnowledgeFile::of(&ventricle)? {
        let in_law = Ventricles::only(LawKnowledgeFile::asked(Some(&law)), &worker);
        spec = beginning_at(&spec, &in_law.periodic_state(&spec)?);
    }
    let scratch =
        tempfile::tempdir().map_err(CliError::file("create a folder in", std::env::temp_dir()))?;
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| scratch.path().join("beat"));
    let every_ms = args.vtu_every.unwrap_or(0.0);
    if let Some(said) = announcement(&ventricle.plan, every_ms) {
        talk.say(&said);
    }
    let outcome = ask_worker(
        &worker,
        &TaskSpec::OrganBeat(Box::new(spec.clone())),
        &out,
        every_ms,
        AskedFor::TheOrgan,
    )?;
    let traces = outcome
        .artefacts
        .iter()
        .find(|a| a.name == "traces")
        .map(|a| out.join(&a.file));
    let result = match outcome.ending {
        Ending::Succeeded { result } => match *result {
            TaskResult::OrganBeat(result) => result,
            _ => return Err(unexpected(&worker)),
        },
        other => {
            return Err(CliError::Simulation {
                message: describe(&other),
            });
        }
    };
    let traces = traces.ok_or_else(|| unexpected(&worker))?;
    let text = std::fs::read_to_string(&traces).map_err(CliError::file("read", &traces))?;
    let screen = format!(
        "simulated: {origin}\n{}",
        screen(&result, &ventricle.passive, talk)
    );
    if args.json {
        let (patient, traces) = (args.patient.as_str(), columns(&text));
        let schema_version = cardiotwin_schemas::formats::SIMULATION.version;
        talk.json(&Answer {
            schema_version,
            patient,
            simulated_as,
            parameters: &origin,
            specification: &spec,
            result: &result,
            traces,
        })?;
    } else if args.out.is_some() {
        talk.data(&screen)?;
        talk.data(&format!("traces: {}\n", traces.display()))?;
    } else {
        talk.say(screen.trim_end());
        talk.data(&text)?;
    }
    Ok(if result.failed_check().is_some() {
        Exit::Problems
    } else {
        Exit::Ok
    })
}

/// Sets each `name=value` at every place of the specification with a number of that name.
fn with_parameters(spec: OrganBeatSpec, assignments: &[String]) -> Result<OrganBeatSpec, String> {
    let mut value = serde_json::to_value(&spec).map_err(|error| error.to_string())?;
    for assignment in assignments {
        let (name, text) = assignment
            .split_once('=')
            .ok_or_else(|| format!("--set {assignment}: expected KEY=VALUE"))?;
        let number = match value_from_text(text.trim()).value {
            input::Tree::Float(number) => number,
            input::Tree::Integer(number) => number as f64,
            other => {
                return Err(format!(
                    "--set {name}: expected a number, found {}",
                    other.describe()
                ));
            }
        };
        let mut known = Vec::new();
        if !replace(&mut value, name.trim(), number, &mut known) {
            // A parameter at its default value is absent from the specification. The worker knows
            // the names of the catalogue's models.
            let is_absent = match &spec.contraction {
                ContractionSpec::Tanh { .. } => false,
                ContractionSpec::Land2017Rice { .. } | ContractionSpec::Land2017Trace { .. } => {
                    CELL_PARAMETERS.contains(&name.trim())
                }
                ContractionSpec::Catalogue { .. } => true,
            };
            if is_absent {
                value["contraction"]["parameters"][name.trim()] = number.into();
                continue;
            }
            let meant = nearest(name, known.iter().map(String::as_str))
                .map(|meant| format!("; did you mean `{meant}`?"));
            return Err(format!(
                "--set {name}: unknown parameter{}",
                meant.unwrap_or_default()
            ));
        }
    }
    serde_json::from_value(value).map_err(|error| format!("--set: {error}"))
}

/// Replaces all numbers called `name` and collects the names of all numbers in `known`. Returns
/// whether any was replaced.
fn replace(value: &mut Value, name: &str, number: f64, known: &mut Vec<String>) -> bool {
    let mut found = false;
    if let Value::Object(map) = value {
        for (key, inner) in map.iter_mut() {
            if inner.is_number() {
                known.push(key.clone());
                if key == name {
                    // A count stays an integer, because the specification could not be read again
                    // otherwise.
                    *inner = if inner.is_u64() && number.fract() == 0.0 {
                        (number as u64).into()
                    } else {
                        number.into()
                    };
                    found = true;
                }
            }
            found |= replace(inner, name, number, known);
        }
    }
    found
}

/// Table of simulated and measured biomarkers, followed by the checks and remarks.
fn screen(result: &OrganBeatResult, passive: &PassiveStateResult, talk: &Talk) -> String {
    let beat = ("simulated", "simulated", Some(&result.biomarkers));
    let table = biomarkers::compared(&passive.measured, &[beat]).without_empty_rows();
    let mut checks = Columns::new(talk, &["CHECK", "HOLDS", "FOUND", "EXPECTED"]);
    for check in &result.checks {
        let holds = if check.passed {
            ("yes".to_owned(), Some(Tone::Good))
        } else {
            ("NO".to_owned(), Some(Tone::Bad))
        };
        checks.toned([
            (check.name.clone(), None),
            holds,
            (check.found.clone(), None),
            (check.expected.clone(), None),
        ]);
    }
    let periodic = if result.periodic { ", periodic" } else { "" };
    let mut text = format!(
        "{}\n{}{}{periodic}\n",
        table::text(&table, talk),
        checks.text(),
        count(result.beats as usize, "beat")
    );
    for remark in &result.remarks {
        text.push_str(&format!("remark: {remark}\n"));
    }
    text
}

/// Columns of a CSV file; a cell that is not a number becomes null.
fn columns(text: &str) -> serde_json::Map<String, Value> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let mut columns = vec![Vec::new(); names.len()];
    for line in lines {
        for (column, cell) in columns.iter_mut().zip(line.split(',')) {
            column.push(cell.parse::<f64>().map_or(Value::Null, Value::from));
        }
    }
    names
        .into_iter()
        .map(str::to_owned)
        .zip(columns.into_iter().map(Value::Array))
        .collect()
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
        let set = [
            "Smax_ref_kPa=120".to_owned(),
            "groups=8".to_owned(),
            "left_atrial_pressure_mmHg=5.5".to_owned(),
        ];
        let changed = with_parameters(spec(), &set).unwrap();
        assert_eq!(changed.circulation.left_atrial_pressure_mmhg, 5.5);
        let ContractionSpec::Tanh { parameters } = changed.contraction else {
            panic!()
        };
        assert_eq!(parameters.smax_ref_kpa, 120.0);
    }

    #[test]
    fn a_loop_has_the_measured_output_or_that_of_a_usual_ejection_fraction() {
        let passive = |sv: serde_json::Value| -> PassiveStateResult {
            let spec = serde_json::to_value(spec()).unwrap();
            serde_json::from_value(serde_json::json!({
                "organ": spec["organ"], "circulation": spec["circulation"], "measured": {"SV_mL": sv},
                "time_points": {}, "estimates": [], "diastasis_volume_error_mL": null, "remarks": []
            }))
            .unwrap()
        };
        let closed = |sv| {
            let mut spec = spec();
            close(&mut spec, &passive(sv)).unwrap();
            spec.circulation.closed.unwrap().stroke_volume_ml
        };
        assert_eq!(closed(serde_json::json!(81.0)), 81.0);
        assert_eq!(closed(serde_json::Value::Null), 72.0);
    }

    #[test]
    fn an_unknown_parameter_or_a_text_is_refused() {
        let error = with_parameters(spec(), &["Smax_ref=120".to_owned()]).unwrap_err();
        assert!(error.contains("did you mean `Smax_ref_kPa`?"), "{error}");
        assert!(
            with_parameters(spec(), &["Smax_ref_kPa=high".to_owned()])
                .unwrap_err()
                .contains("expected a number")
        );
        assert!(
            with_parameters(spec(), &["groups=2.5".to_owned()]).is_err(),
            "a count is a count"
        );
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
        assert_eq!(
            Value::Object(columns),
            serde_json::json!({"time_ms": [0.0, 1.0], "V": [1.5, null]})
        );
    }
}
