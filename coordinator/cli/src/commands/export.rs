//! `cardiotwin export`: tables and traces for other programs, models in openCARP's formats, and an
//! RO-Crate.

use std::path::{Path, PathBuf};
use std::process::Command;

use cardiotwin_engine::find_worker;
use cardiotwin_report::export::ro_crate::{self, CrateFile, CrateOptions};
use cardiotwin_report::export::{Exported, export};
use cardiotwin_report::html::{Pages, write_report};
use cardiotwin_report::results::PatientView;
use cardiotwin_report::results::folder::WholeFolder;
use cardiotwin_schemas::organ_law::LawTeacher;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_sweep::discovery;
use clap::Args;
use serde::Serialize;

use crate::access;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::store::open;
use crate::talk::{Talk, count};
use crate::ventricle::stdout_of;

/// Export the paper's tables as CSV and JSON, all traces as tidy CSV, models for openCARP, and an
/// RO-Crate
#[derive(Debug, Args)]
#[command(
    after_help = "--opencarp writes for each patient, into OUT/opencarp/PATIENT: tanh.par and \
                  land17.par (active stress of step 1 and of the twin), calcium.csv, and in 3D \
                  heart.pts, .elem, .lon, .surf and activation.dat.\n\
                  --ro-crate writes OUT/ro-crate: tables, traces, report, each patient's record and \
                  parameters, and the programs that computed them. Inputs are identified by their \
                  hashes; --with-inputs copies them, too."
)]
pub struct ExportArgs {
    #[command(flatten)]
    place: Place,
    /// Folder to write into [default: export in the run's folder]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write tables and traces as Parquet files, too
    #[arg(long)]
    parquet: bool,
    /// Write personalised models, meshes and activation times in openCARP's formats, too
    #[arg(long)]
    opencarp: bool,
    /// Write what the 3D beats of all patients taught about the organ's law into FILE, too: the start
    /// of further patients (`cardiotwin run --law FILE`)
    #[arg(long, value_name = "FILE")]
    law: Option<PathBuf>,
    /// Write a crate of the whole run, too (RO-Crate 1.1, Process Run Crate 0.5)
    #[arg(long)]
    ro_crate: bool,
    /// With --ro-crate, include the measured traces themselves, not only their hashes
    #[arg(long, requires = "ro_crate")]
    with_inputs: bool,
    /// With --ro-crate, address of the crate's licence
    #[arg(long, value_name = "URL", requires = "ro_crate")]
    license: Option<String>,
    /// With --ro-crate, name of the crate's author
    #[arg(long, value_name = "NAME", requires = "ro_crate")]
    author: Option<String>,
    /// Print one JSON object instead of a list of files
    #[arg(long)]
    json: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
}

#[derive(Serialize)]
struct Answer<'a> {
    schema_version: u32,
    files: &'a [PathBuf],
    problems: &'a [String],
}

/// Writes the files and prints their paths. Traces that could not be read make the exit code 1.
///
/// # Errors
/// Errors of the store, the export and the worker.
pub async fn execute(args: &ExportArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    access::as_of_run(&folders.run);
    folders.refuse_sweep("`cardiotwin sweep report DIR` writes its tables")?;
    let record = open(&folders).await?.record().await?;
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| folders.run.join("export"));
    let Exported {
        mut files,
        mut problems,
    } = export(&record, &out, args.parquet).map_err(CliError::Export)?;
    let mut parts: Vec<Part> = files.iter().map(|file| Part::table(file)).collect();
    if args.opencarp {
        let worker = find_worker(args.worker.as_deref())?;
        for patient in &record.patients {
            let id = &patient.plan.id;
            let written = opencarp(patient, &worker, &out.join("opencarp").join(id.as_str()))?;
            if written.is_empty() {
                problems.push(format!("{id}: no simulation of step 1 has finished"));
            }
            parts.extend(written.iter().map(|file| Part::model(file, id.as_str())));
            files.extend(written);
        }
    }
    if let Some(file) = &args.law {
        let worker = find_worker(args.worker.as_deref())?;
        match learned_law(&record, &worker, file)? {
            Some(said) => {
                talk.say(&said);
                files.push(file.clone());
            }
            None => problems.push(
                "no 3D beat has samples of the organ's law, so that no law was written".to_owned(),
            ),
        }
    }
    if args.ro_crate {
        let place = out.join("ro-crate");
        problems.extend(crate_of(
            args,
            &record,
            &parts,
            folders.cohort.as_deref(),
            &place,
            talk,
        )?);
        files.push(place.join(ro_crate::METADATA));
    }
    if args.json {
        talk.json(&Answer {
            schema_version: cardiotwin_schemas::formats::EXPORT.version,
            files: &files,
            problems: &problems,
        })?;
    } else {
        files
            .iter()
            .try_for_each(|file| talk.data(&format!("{}\n", file.display())))?;
    }
    problems
        .iter()
        .for_each(|problem| talk.say(&format!("warning: {problem}")));
    Ok(if problems.is_empty() {
        Exit::Ok
    } else {
        Exit::Problems
    })
}

/// Has the worker, which can read meshes, write a patient's openCARP files; returns no paths if no
/// beat was simulated.
fn opencarp(patient: &PatientRecord, worker: &Path, out: &Path) -> Result<Vec<PathBuf>, CliError> {
    let best = PatientView(patient)
        .best_iteration()
        .and_then(|iteration| iteration.run.as_ref());
    // One beat of each model: a second cell would have the first one's files.
    let specs: Vec<PathBuf> = [best, patient.twin()]
        .into_iter()
        .flatten()
        .map(|task| task.directory.join("spec.json"))
        .collect();
    if specs.is_empty() {
        return Ok(Vec::new());
    }
    let mut command = Command::new(worker);
    command.arg("opencarp").args(&specs).arg("--out").arg(out);
    let stdout = stdout_of(worker, &mut command)?;
    Ok(String::from_utf8_lossy(&stdout)
        .lines()
        .map(PathBuf::from)
        .collect())
}

/// Has the worker learn a law from all 3D beats of the run; returns a sentence about it, or `None`
/// if there is no such beat. Patients are in the order of their names, so that runs of the same
/// cohort write the same law.
fn learned_law(run: &RunRecord, worker: &Path, file: &Path) -> Result<Option<String>, CliError> {
    let mut patients: Vec<&PatientRecord> = run.patients.iter().collect();
    patients.sort_by(|a, b| a.plan.id.cmp(&b.plan.id));
    let of_patient = |patient: &PatientRecord| -> Vec<(String, PathBuf)> {
        let of_step1 = patient.iterations.iter().filter_map(|i| i.run.as_ref());
        let of_step3 = patient
            .step3_iterations
            .iter()
            .filter_map(|i| i.run.as_ref());
        of_step1
            .chain(&patient.verification)
            .chain(of_step3)
            .filter(|run| run.result.law.is_some())
            .map(|run| (patient.plan.id.0.clone(), run.directory.clone()))
            .collect()
    };
    let beats: Vec<(String, PathBuf)> = patients.into_iter().flat_map(of_patient).collect();
    if beats.is_empty() {
        return Ok(None);
    }
    // Laws of different starts cannot be combined; a run has one.
    let start = run
        .patients
        .iter()
        .find_map(|patient| patient.plan.law.as_ref());
    let mut command = Command::new(worker);
    command.arg("learn").arg("--out").arg(file);
    if let Some(start) = start {
        command.arg("--law").arg(&start.path);
    }
    for (patient, directory) in &beats {
        command.arg("--beat").arg(patient).arg(directory);
    }
    let stdout = stdout_of(worker, &mut command)?;
    let organs: Vec<LawTeacher> =
        serde_json::from_slice(&stdout).map_err(|error| CliError::Worker {
            worker: worker.to_owned(),
            message: error.to_string(),
        })?;
    let mean = |error: fn(&LawTeacher) -> f64| {
        organs.iter().map(error).sum::<f64>() / organs.len().max(1) as f64
    };
    Ok(Some(format!(
        "{} taught the organ's law with {}: mean error of its pressure before a patient's first beat \
         {:.1} mmHg, {:.1} mmHg without them",
        count(organs.len(), "heart"),
        count(beats.len(), "beat"),
        mean(|organ| organ.pressure_error_after_mmhg),
        mean(|organ| organ.pressure_error_before_mmhg),
    )))
}

/// An exported file and its entry in the crate.
struct Part {
    from: PathBuf,
    to: CrateFile,
}

impl Part {
    fn of(file: &Path, folder: &str, sentence: &str) -> Self {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let to = CrateFile {
            path: format!("{folder}/{name}"),
            name: sentence.to_owned(),
        };
        Self {
            from: file.to_owned(),
            to,
        }
    }

    fn table(file: &Path) -> Self {
        let is_traces = file.file_stem().is_some_and(|stem| stem == "traces");
        let sentence = if is_traces {
            "All traces, one value per row"
        } else {
            "A table of the paper, for this cohort"
        };
        Self::of(file, "tables", sentence)
    }

    fn model(file: &Path, patient: &str) -> Self {
        Self::of(
            file,
            &format!("patients/{patient}/opencarp"),
            "A personalised model in openCARP's formats",
        )
    }
}

/// Writes the crate as a whole in the place of an earlier one. Returns its problems.
fn crate_of(
    args: &ExportArgs,
    record: &RunRecord,
    parts: &[Part],
    cohort: Option<&Path>,
    place: &Path,
    talk: &Talk,
) -> Result<Vec<String>, CliError> {
    let folder = WholeFolder::begin(place).map_err(CliError::Export)?;
    let mut files = Vec::with_capacity(parts.len() + 1);
    for Part { from, to } in parts {
        let content = std::fs::read(from).map_err(CliError::file("read", from))?;
        folder.write(&to.path, &content).map_err(CliError::Export)?;
        files.push(to.clone());
    }
    let cases = discovery::beside(cohort);
    let report = write_report(
        record,
        cases.as_ref(),
        Pages::All,
        &folder.path().join("report.html"),
    )
    .map_err(CliError::Report)?;
    for page in std::iter::once(&report.main).chain(&report.patients) {
        let path = page
            .strip_prefix(folder.path())
            .unwrap_or(page)
            .to_string_lossy()
            .into_owned();
        files.push(CrateFile {
            path,
            name: "The report".to_owned(),
        });
    }
    let options = CrateOptions {
        license: args.license.clone(),
        author: args.author.clone(),
        with_inputs: args.with_inputs,
    };
    let problems =
        ro_crate::complete(record, &folder, files, &options).map_err(CliError::Export)?;
    folder.publish().map_err(CliError::Export)?;
    let open = record
        .patients
        .iter()
        .filter(|p| p.verification.is_none())
        .count();
    if open > 0 {
        talk.say(&format!(
            "{} of the crate not fully personalised, as their records state",
            count(open, "patient")
        ));
    }
    Ok(problems)
}
