//! `cardiotwin export`: tables and traces for other programs, models in openCARP's formats, and an
//! RO-Crate.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use clap::Args;
use serde::Serialize;

use crate::cli::access;
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::Place;
use crate::cli::store::open;
use crate::cli::talk::{Talk, count};
use crate::discovery;
use crate::engine::find_worker;
use crate::export::ro_crate::{self, CrateFile, CrateOptions};
use crate::export::{Exported, export};
use crate::report::{Pages, write_report};
use crate::results::PatientView;
use crate::results::folder::WholeFolder;

/// Export the paper's tables as CSV and JSON, all traces as tidy CSV, models for openCARP, and an
/// RO-Crate
#[derive(Debug, Args)]
#[command(
    after_help = "--opencarp writes for each patient, into OUT/opencarp/PATIENT: tanh.par and \
                  land17.par (active stress of step 1 and step 2), calcium.csv, and in 3D \
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
    /// Path of the worker's executable [default: cardiotwin-worker beside this program]
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
    let beats = [
        best,
        patient.verification.as_ref(),
        PatientView(patient).step3_beat(),
    ];
    let specs: Vec<PathBuf> = beats
        .into_iter()
        .flatten()
        .map(|task| task.directory.join("spec.json"))
        .collect();
    if specs.is_empty() {
        return Ok(Vec::new());
    }
    let output = Command::new(worker)
        .arg("opencarp")
        .args(&specs)
        .arg("--out")
        .arg(out)
        .stdin(Stdio::null())
        .output()
        .map_err(CliError::file("start", worker))?;
    if !output.status.success() {
        let message = format!(
            "{}, {}",
            output.status,
            String::from_utf8_lossy(&output.stderr).trim()
        );
        return Err(CliError::Worker {
            worker: worker.to_owned(),
            message,
        });
    }
    Ok(String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(PathBuf::from)
        .collect())
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
