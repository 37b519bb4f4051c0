//! A beat by an external solver: parameters are written, a command runs, and its results are read
//! and checked like those of our own solvers.
//!
//! The command runs in the folder `external` of the attempt. The artefacts `traces.csv` and
//! `nodal.csv` have the format of our own solvers; the solver's output is in `external.log` in that
//! folder.

mod law;
mod outflow;
mod parameters;
mod process;
mod results;

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::ExitStatus;

use cardiotwin_models::beat::{BeatCheck, BeatResult, BeatTraces, BeatWork};
use cardiotwin_schemas::external::{ExternalOrgan, ExternalParameters, expand};
use cardiotwin_schemas::failure::{Failure, FailureClass};
use cardiotwin_schemas::organ::ContractionSpec;
use cardiotwin_schemas::outcome::{Ending, TaskResult};
use cardiotwin_schemas::task::OrganBeatSpec;

use super::result::{Seen, organ_beat_result, traces_csv};
use crate::context::Context;
use crate::error::TaskError;
use crate::files::write_synced;
use crate::inputs::read_verified;
use crate::nodal;
use crate::opencarp;
use results::Unusable;

/// Folder of the attempt in which the solver runs.
const FOLDER: &str = "external";
/// File with the solver's output.
const LOG: &str = "external.log";
/// Volume that must flow through a valve for it to count as opened \[mL\].
const MOVED_ML: f64 = 0.5;

/// Runs the solver and checks its results.
///
/// # Errors
/// [`TaskError`] when the solver cannot be started, or files cannot be read or written.
pub(super) fn run(
    spec: &OrganBeatSpec,
    organ: &ExternalOrgan,
    context: &mut Context,
) -> Result<Ending, TaskError> {
    let folder = context.artefacts.directory().join(FOLDER);
    // Without an attempt's own directory, an earlier simulation may have left files here.
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).map_err(|source| TaskError::Write {
        file: folder.clone(),
        source,
    })?;
    let folder = folder.canonicalize().map_err(|source| TaskError::Write {
        file: folder,
        source,
    })?;
    let handed = parameters::of(spec, organ);
    prepare(spec, organ, &handed, &folder)?;
    let command = command(organ, &folder, context.threads)?;
    let log = folder.join(LOG);
    context
        .progress
        .report("external solver", 0.0, None, || command.join(" "));
    let status = process::run(&command, &folder, &log, context)?;
    if let Some(failure) = failure_of(status, organ, &log) {
        return Ok(failure);
    }
    match answer(spec, organ, &folder, context)? {
        Ok(ending) => Ok(ending),
        Err(Unusable::Form(message)) => {
            let remedy = "correct solver.external.results, or what the solver writes".to_owned();
            let message = with_last_words(&message, &log);
            Ok(Ending::Failed {
                failure: Failure {
                    class: FailureClass::Input,
                    message,
                    remedy: Some(remedy),
                    cause: None,
                },
            })
        }
        Err(Unusable::Diverged {
            last_good_ms,
            reason,
            traces,
        }) => {
            if !traces.time_ms.is_empty() {
                context
                    .artefacts
                    .write("traces", "traces.csv", &traces_csv(&traces))?;
            }
            Ok(Ending::Diverged {
                last_good_ms,
                reason: with_last_words(&reason, &log),
            })
        }
    }
}

/// Writes parameters, calcium, and the files made from templates.
fn prepare(
    spec: &OrganBeatSpec,
    organ: &ExternalOrgan,
    handed: &ExternalParameters,
    folder: &Path,
) -> Result<(), TaskError> {
    let settings = &organ.settings;
    let write = |name: &str, text: &[u8]| {
        let file = folder.join(name);
        write_synced(&file, text).map_err(|source| TaskError::Write { file, source })
    };
    write(
        settings.parameters.file(),
        parameters::text(handed, settings.parameters).as_bytes(),
    )?;
    if let ContractionSpec::Land2017Trace { calcium, .. } = &spec.contraction {
        write(parameters::CALCIUM_FILE, &read_verified(calcium)?)?;
    }
    // All files that the command reads must be the planned ones.
    let mut contents = BTreeMap::new();
    for file in &organ.files {
        contents.insert(file.name.as_str(), (&file.path, read_verified(file)?));
    }
    let mut values = parameters::by_name(handed);
    match opencarp::plugin(&spec.contraction) {
        Ok(plugin) => {
            values.insert("openCARP.plugin".to_owned(), plugin.name.to_owned());
            values.insert("openCARP.plug_param".to_owned(), plugin.parameters);
        }
        // Another solver may have the model.
        Err(TaskError::NoPlugin { .. }) => {}
        Err(error) => return Err(error),
    }
    for (made, template) in &settings.templates {
        // Models have different parameters, so that a template may have a variant for a model.
        let twin = format!("{template}@{}", handed.contraction.model);
        let content = contents
            .get(twin.as_str())
            .or_else(|| contents.get(template.as_str()));
        let (path, bytes) = content.ok_or_else(|| {
            TaskError::External(format!(
                "templates.{made}: `{template}` is no name of solver.external.files"
            ))
        })?;
        let text = expand(&String::from_utf8_lossy(bytes), |name| {
            values.get(name).cloned()
        })
        .map_err(|error| {
            let known: Vec<&str> = values.keys().map(String::as_str).collect();
            TaskError::External(format!(
                "{}: {error}; there is {}",
                path.display(),
                known.join(", ")
            ))
        })?;
        write(made, text.as_bytes())?;
    }
    Ok(())
}

fn command(organ: &ExternalOrgan, folder: &Path, threads: u32) -> Result<Vec<String>, TaskError> {
    let value = |name: &str| match name {
        "parameters" => Some(
            folder
                .join(organ.settings.parameters.file())
                .display()
                .to_string(),
        ),
        "out" => Some(folder.display().to_string()),
        "threads" => Some(threads.to_string()),
        name => organ
            .files
            .iter()
            .find(|file| file.name == name)
            .map(|file| file.path.display().to_string()),
    };
    let expanded = organ.settings.command.iter().map(|word| {
        expand(word, value)
            .map_err(|error| TaskError::External(format!("command, `{word}`: {error}")))
    });
    expanded.collect()
}

fn with_last_words(message: &str, log: &Path) -> String {
    match process::last_line(log) {
        Some(line) => format!(
            "{message}; its last words: {line} (all of them: {})",
            log.display()
        ),
        None => message.to_owned(),
    }
}

/// The ending for an unsuccessful exit status.
fn failure_of(status: ExitStatus, organ: &ExternalOrgan, log: &Path) -> Option<Ending> {
    if status.success() {
        return None;
    }
    let (class, what) = match (status.code(), status.signal()) {
        (Some(code), _) => (
            organ.settings.exit_codes.class_of(code),
            format!("the external solver ended with exit code {code}"),
        ),
        (None, signal) => {
            let signal = signal.unwrap_or_default();
            (
                FailureClass::Site,
                format!("the external solver was killed by signal {signal}"),
            )
        }
    };
    let remedy = match class {
        FailureClass::Input => "correct what the solver names, then run again",
        FailureClass::Site => "mend what stopped it, then retry",
        FailureClass::Numerics => {
            "rerun from step1 with damping or bounds; another class: solver.external.exit_codes"
        }
        FailureClass::Bug => "ask whoever keeps the solver",
    };
    let (message, remedy) = (with_last_words(&what, log), Some(remedy.to_owned()));
    Some(Ending::Failed {
        failure: Failure {
            class,
            message,
            remedy,
            cause: None,
        },
    })
}

/// Converts the results to the form of our own solvers.
fn answer(
    spec: &OrganBeatSpec,
    organ: &ExternalOrgan,
    folder: &Path,
    context: &mut Context,
) -> Result<Result<Ending, Unusable>, TaskError> {
    let results = &organ.settings.results;
    let mut traces = match results::traces(folder, results, spec.cycle_length_ms) {
        Ok(traces) => traces,
        Err(unusable) => return Ok(Err(unusable)),
    };
    let estimated = outflow::fill(&mut traces, &spec.circulation);
    let (time_ms, nodes, has_calcium) =
        match results::nodes(folder, results, organ.activation.onset_ms) {
            Ok(nodes) => nodes,
            Err(unusable) => return Ok(Err(unusable)),
        };
    context
        .artefacts
        .write("traces", "traces.csv", &traces_csv(&traces))?;
    context.artefacts.write(
        "nodal",
        "nodal.csv",
        &nodal::to_csv(&time_ms, &nodes, has_calcium),
    )?;
    let law = law::samples(&traces, &time_ms, &nodes, spec.cycle_length_ms);
    let lambda_min = nodes.lambda.iter().copied().fold(f64::INFINITY, f64::min);
    let last = traces.volume_ml.len() - 1;
    let result = BeatResult {
        n_beats: 1,
        volume_change_ml: traces.volume_ml[last] - traces.volume_ml[0],
        pressure_change_mmhg: (traces.pressure_mmhg[last] - traces.pressure_mmhg[0]).abs(),
        periodic: None,
        checks: checks(&traces),
        work: BeatWork::default(),
        traces,
    };
    let mut result = organ_beat_result(
        spec,
        &result,
        Seen {
            lambda_min: Some(lambda_min),
            motion: None,
            law: law.as_ref(),
            closed: None,
        },
    )?;
    result.remarks.extend(estimated);
    // These counters count time steps of our own solvers.
    result
        .counters
        .retain(|name, _| name.ends_with("mL") || name.ends_with("mmHg"));
    Ok(Ok(Ending::Succeeded {
        result: Box::new(TaskResult::OrganBeat(result)),
    }))
}

/// Conditions of a successful beat (SPEC section 5) that pressure and volume can show. The action
/// of the valves is inferred from the volume.
fn checks(traces: &BeatTraces) -> Vec<BeatCheck> {
    let largest = |volume: &[f64]| volume.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = traces
        .volume_ml
        .iter()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let smallest = traces.volume_ml.iter().position(|v| *v <= low).unwrap_or(0);
    let ejected = largest(&traces.volume_ml[..=smallest]) - low;
    let filled = largest(&traces.volume_ml[smallest..]) - low;
    let valve = |name: &str, moved: f64, expected: &str| {
        BeatCheck::new(name, moved > MOVED_ML, moved, expected)
    };
    let mut checks = vec![
        valve(
            "aortic_valve_opened_and_closed",
            ejected,
            "more than 0.5 mL ejected",
        ),
        valve(
            "mitral_valve_opened_and_closed",
            filled,
            "more than 0.5 mL filled",
        ),
    ];
    checks.extend(traces.plausible());
    checks
}
