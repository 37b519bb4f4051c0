//! `cardiotwin explain`: inputs that determine each task of a patient, and those that changed.

mod pending;
mod places;
mod reruns;

use std::collections::BTreeMap;
use std::path::PathBuf;

use cardiotwin_engine::{JobRecord, LeafChange, StepExplanation, Task};
use cardiotwin_input::{self as input, Options, Patient, Report};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::record::{PatientRecord, StallReason, Step1Quality};
use clap::Args;
use serde_json::Value;

use crate::error::CliError;
use crate::exit::Exit;
use crate::kept;
use crate::place::{Folders, OfCohort};
use crate::store::{open, stored_overrides};
use crate::table::{Columns, duration};
use crate::talk::{Talk, Tone, count};
use pending::Pending;
use places::{PlanValues, line, places};

/// Explain the state of a patient's tasks: dependencies, changed settings and files, and the layer
/// or line that sets them
#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// Name of the patient
    patient: String,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    of: OfCohort,
}

/// Prints the explanation of each step.
///
/// # Errors
/// Errors of the store.
pub async fn execute(args: &ExplainArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let reader = open(&folders).await?;
    let id = PatientId(args.patient.clone());
    let steps = reader.explain(&id).await?;
    let (jobs, why) = reader.jobs(&id).await?;
    let record = reader.patient_record(&id).await?;
    let stored_kept = kept::assignments(&folders.run).await?;
    let overrides = stored_overrides(&folders.run, &args.patient).await?;
    // The cohort is loaded to find changes and their places; `check` reports its problems.
    let load = |overrides: BTreeMap<String, Value>| {
        let options = Options {
            only: vec![args.patient.clone()],
            overrides,
            kept: stored_kept.clone(),
            ..Options::default()
        };
        input::load(folders.cohort.as_deref()?, &options, &mut Report::default())
    };
    // The same patient without what `rerun` stored for it.
    let as_written = if overrides
        .values()
        .any(|layer| layer.as_object().is_some_and(|layer| !layer.is_empty()))
    {
        load(BTreeMap::new()).and_then(|mut cohort| cohort.patients.pop())
    } else {
        None
    };
    let cohort = load(overrides);
    let plans = cohort.as_ref().map_or_else(Vec::new, input::Cohort::plans);
    let patient = cohort.and_then(|mut cohort| cohort.patients.pop());
    let pending = match &patient {
        Some(patient) => Pending::of(&record.plan, patient, &plans, &folders).await?,
        None => None,
    };
    let stored = match (&patient, &as_written) {
        (Some(with), Some(without)) => reruns::of(with, without, &folders.as_argument("--cohort ")),
        _ => Vec::new(),
    };
    if args.json {
        talk.json(&serde_json::json!({
            "steps": steps, "pending": pending, "rerun": stored, "jobs": jobs, "next_job": why,
        }))?;
        return Ok(Exit::Ok);
    }
    let status = &record.status;
    talk.data(&format!(
        "{}: {} {}\n",
        status.patient,
        status.words(),
        status.note
    ))?;
    if let Some(failure) = &record.failure {
        let remedy = failure
            .remedy
            .as_deref()
            .map(|remedy| format!("; {remedy}"))
            .unwrap_or_default();
        talk.data(&format!(
            "held by a failure [{}]: {}{remedy}\n",
            failure.class.as_str(),
            failure.message
        ))?;
    }
    talk.data(&of_stall(&record, &folders))?;
    talk.data(&of_jobs(&jobs, &why, talk))?;
    talk.data(&reruns::words(&stored))?;
    let files = pending::files(&record.plan);
    talk.data(&text(&steps, patient.as_ref(), &files, talk))?;
    if let Some(pending) = pending {
        talk.data(&pending.words())?;
    }
    Ok(Exit::Ok)
}

/// Why step 1 stalled, from which simulation the patient continued, and the commands that continue with
/// other settings; empty for a patient whose step 1 converged or has not ended.
fn of_stall(record: &PatientRecord, folders: &Folders) -> String {
    let Some(step1) = &record.step1 else {
        return String::new();
    };
    let Step1Quality::Stalled { reason } = step1.quality else {
        return String::new();
    };
    let failed = record.iterations.iter().rev().find_map(|iteration| {
        let failure = iteration.failure.as_ref()?;
        let (number, class) = (iteration.number, failure.class.as_str());
        Some(format!(
            "simulation {number} failed [{class}]: {}",
            failure.message
        ))
    });
    let why = match (reason, failed) {
        (StallReason::SimulationFailed, Some(failed)) => failed,
        _ => reason.words().to_owned(),
    };
    let change = match reason {
        StallReason::SimulationFailed | StallReason::Stagnation => {
            format!("--damping {}", 0.5 * record.plan.settings.step1.damping)
        }
        StallReason::IterationLimit => {
            let limit = record.plan.settings.step1.max_iterations;
            format!("--set step1.max_iterations={}", 2 * limit)
        }
    };
    let (id, of, run) = (
        &record.plan.id,
        folders.as_argument("--cohort "),
        folders.run_command(),
    );
    format!(
        "step 1 stalled: {why}\n  the patient continues with simulation {}; from the stored simulations, with other \
         settings: `cardiotwin rerun {id} --from step1 {change}{of}`, then {run}; also --bounds \
         NAME=LOW,HIGH, a shorter solver.time_step_ms or solver.shortest_step_ms, and on a cluster a longer \
         walltime\n",
        step1.best_iteration
    )
}

/// Table of the patient's jobs, and the consequence of the last one.
fn of_jobs(jobs: &[JobRecord], why: &str, talk: &Talk) -> String {
    if jobs.is_empty() {
        return String::new();
    }
    let mut table = Columns::new(talk, &["JOB", "STATE", ">RAN", "NODES", "WHY"]);
    for job in jobs {
        let ran = job.elapsed_s.map_or("-".to_owned(), |s| duration(s as f64));
        let nodes = if job.nodes.is_empty() {
            "-".to_owned()
        } else {
            job.nodes.clone()
        };
        table.row([
            job.id.clone(),
            job.state.to_string(),
            ran,
            nodes,
            job.why.clone(),
        ]);
    }
    let next = if why.is_empty() {
        String::new()
    } else {
        format!("retried: {why}\n")
    };
    format!("{}{next}\n", table.text())
}

/// The table of steps, followed by the values that changed.
fn text(
    steps: &[StepExplanation],
    patient: Option<&Patient>,
    files: &[(String, PathBuf)],
    talk: &Talk,
) -> String {
    let mut table = Columns::new(talk, &["STEP", "STATE", "TASK", ">TRIES", "SINCE", "WHY"]);
    let values = patient.and_then(PlanValues::of);
    let mut sections = String::new();
    for step in steps {
        let tone = match step.state {
            Task::Published { .. } => Some(Tone::Good),
            Task::Failed { .. } => Some(Tone::Bad),
            Task::Open { .. } | Task::Attempting { .. } => None,
        };
        let own = own_changes(step, values.as_ref(), patient, files);
        let mut why = match (&step.previous, own.len(), step.changes.len()) {
            (None, ..) => "-".to_owned(),
            (Some(_), 0, n) if n > 0 => "results of earlier steps changed".to_owned(),
            (Some(_), n, _) => format!("{} changed", count(n, "value")),
        };
        if !step.shared_with.is_empty() {
            let others: Vec<&str> = step.shared_with.iter().map(PatientId::as_str).collect();
            why.push_str(&format!(", shared with {}", others.join(", ")));
        }
        let row = [
            (step.step.clone(), None),
            (step.state.shown().to_owned(), tone),
            (short(step.task.as_str()).to_owned(), Some(Tone::Quiet)),
            (step.generations.to_string(), None),
            (step.since.clone(), None),
            (why, None),
        ];
        table.toned(row);
        if let (Some(previous), false) = (&step.previous, own.is_empty()) {
            sections.push_str(&format!(
                "\n{} differs from its previous task {}:\n{}",
                step.step,
                short(previous.as_str()),
                own.concat()
            ));
            let n_inner = step.changes.len() - own.len();
            if n_inner > 0 {
                sections.push_str(&format!(
                    "  {} of earlier tasks' results, which follow from the changes above or from earlier steps\n",
                    count(n_inner, "value")
                ));
            }
        }
    }
    table.text() + &sections
}

/// Lines about the changes of a step by settings and files. What earlier tasks found is no setting,
/// and its path tells a reader nothing.
///
/// - `values`: those of the plan; without them, values without a path through a list are shown
fn own_changes(
    step: &StepExplanation,
    values: Option<&PlanValues>,
    patient: Option<&Patient>,
    files: &[(String, PathBuf)],
) -> Vec<String> {
    let own = |change: &LeafChange| {
        let set_in = places(change, patient, files);
        let is_file = change.path.ends_with("sha256") && !set_in.is_empty();
        let is_set = values.map_or(!change.path.contains('['), |values| values.set(change));
        (is_file || is_set).then(|| line(change, &set_in))
    };
    step.changes.iter().filter_map(own).collect()
}

fn short(key: &str) -> &str {
    key.get(..12).unwrap_or(key)
}

#[cfg(test)]
mod tests {
    use cardiotwin_schemas::ids::TaskKey;
    use serde_json::Value;
    use std::path::Path;

    use super::*;

    #[test]
    fn a_changed_value_and_a_changed_file_say_where_they_are() {
        let plain = Talk {
            colour_out: false,
            colour_err: false,
            quiet: true,
            bars: false,
        };
        let change = |path: &str, old: Value, new: Value| LeafChange {
            path: path.into(),
            old: Some(old),
            new: Some(new),
        };
        let step = StepExplanation {
            step: "step-0".into(),
            task: TaskKey("b".repeat(64)),
            state: Task::default(),
            generations: 0,
            since: "2026-03-01T12:00:00.000Z".into(),
            previous: Some(TaskKey("a".repeat(64))),
            changes: vec![
                change("pressure.sha256", "12".into(), "34".into()),
                change("activation.spread_ms", 40.0.into(), 50.0.into()),
                change("solver.newton_iterations", 1.into(), 60.into()),
                // A measured value has this name, too, and so has a weight.
                change("twin.samples.volume_mL[3]", 80.0.into(), 81.5.into()),
                change("targets.STD50_ms", 256.0.into(), 254.9.into()),
                change("runs[0].predicted_misfit", 0.047.into(), Value::Null),
            ],
            shared_with: vec!["P9".into()],
        };
        let later = StepExplanation {
            step: "targets".into(),
            changes: vec![change("nodal.sha256", "56".into(), "78".into())],
            shared_with: Vec::new(),
            ..step.clone()
        };
        let first = StepExplanation {
            step: "step-1 iteration 1".into(),
            previous: None,
            changes: Vec::new(),
            ..later.clone()
        };
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join("patients/01-CoA");
        std::fs::create_dir_all(&own).unwrap();
        let example =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/coa-seven/patients/01-CoA");
        for file in ["patient.toml", "pressure.csv", "volume.csv"] {
            std::fs::copy(example.join(file), own.join(file)).unwrap();
        }
        let cohort = "name = 'c'\n[solver.activation]\nspread_ms = 50\n";
        std::fs::write(folder.path().join("cohort.toml"), cohort).unwrap();
        let patient = input::load(folder.path(), &Options::default(), &mut Report::default())
            .unwrap()
            .patients
            .remove(0);
        let pressure = PathBuf::from("/c/patients/P1/pressure.csv");
        let files = [("pressure".to_owned(), pressure)];
        let said = text(&[step, first, later], Some(&patient), &files, &plain);
        let root = format!("{}/", folder.path().display());
        insta::assert_snapshot!(said.replace(&root, ""));
    }
}
