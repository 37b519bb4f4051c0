//! `cardiotwin prepare`: a patient's folder from continuous recordings. It replaces a folder only
//! with `--replace`.

mod drawings;

use std::path::{Path, PathBuf};

use cardiotwin_input::preparation::{self, Made, PREPARED};
use cardiotwin_input::{PREPARE_TOML, RawFolder, Report, load_alone, read_raw};
use cardiotwin_report::html::preparation::{beats_svg, preparation_page, volume_svg};
use cardiotwin_report::results::WriteError;
use cardiotwin_report::results::folder::WholeFolder;
use cardiotwin_schemas::preparation::{Preparation, StepState};
use clap::Args;

use super::init::is_untouched;
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::problems;
use crate::table::Columns;
use crate::talk::{Talk, Tone, count};

/// Number of left-out beats that the table lists; beats.csv lists all of them.
const MOST_NAMED: usize = 12;

/// Page of the preparation in the folder of its results.
pub const PAGE: &str = "prepare.html";

/// Create a patient's folder from continuous recordings: find, judge and average beats, adjust and
/// synchronise volumes
#[derive(Debug, Args)]
#[command(
    after_help = "RAW_DIR holds catheter.csv (columns time_ms or time_s, lv_pressure_mmHg, \
                  aortic_pressure_mmHg, flow_mL_per_s, ecg_mV; at least one pressure), cine.csv \
                  (time_ms, volume_mL), flow.csv, and prepare.toml, which names other files and \
                  columns, states whole-heart volume and cuff pressure, and switches or overrides \
                  each step.\n\
                  Exports of laboratories are read too: text with any separator, decimal sign and \
                  encoding, LabChart, Millar, cvi42, Segment, Excel, WFDB, EDF. The format is seen \
                  from the content, or stated as format = \"labchart\" in prepare.toml.\n\
                  docs/prepare.md has the details. RAW_DIR itself is never changed."
)]
pub struct PrepareArgs {
    /// Folder of the recordings
    #[arg(value_name = "RAW_DIR")]
    raw: PathBuf,
    /// Folder of the patient to create; its name is the patient's unless prepare.toml sets another
    #[arg(value_name = "PATIENT_DIR", required_unless_present = "dry_run")]
    patient: Option<PathBuf>,
    /// Show what each step would change without writing anything
    #[arg(short = 'n', long)]
    dry_run: bool,
    /// Replace a folder that an earlier `cardiotwin prepare` created
    #[arg(long)]
    replace: bool,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    /// Open the page of the preparation in the desktop's viewer
    #[arg(long, conflicts_with = "dry_run")]
    open: bool,
}

/// Prepares a patient's folder.
///
/// # Errors
/// [`CliError::Recordings`] if the recordings have errors, [`CliError::NoBeats`] if no beats can be made
/// from them, [`CliError::Usage`] if the folder must not be replaced, [`CliError::Export`] if the folder cannot be
/// written.
pub fn execute(args: &PrepareArgs, talk: &Talk) -> Result<Exit, CliError> {
    let mut report = Report::default();
    let raw = read_raw(&args.raw, &mut report);
    problems::say(&report, talk);
    let Some(raw) = raw else {
        return Err(CliError::Recordings {
            errors: count(report.n_errors(), "error"),
        });
    };
    let id = id_of(&raw, args)?;
    if let Some(folder) = &args.patient {
        may_write(folder, &id, args)?;
    }
    let mut made = preparation::make(&raw, &id).map_err(|error| {
        CliError::NoBeats(format!(
            "{}: {error}; adjust [steps] in {PREPARE_TOML}",
            args.raw.display()
        ))
    })?;
    let mut contradictions = Report::default();
    for problem in made.problems.drain(..) {
        contradictions.add(None, problem);
    }
    problems::say(&contradictions, talk);
    if contradictions.n_errors() > 0 {
        return Err(CliError::Recordings {
            errors: count(contradictions.n_errors(), "error"),
        });
    }
    let files = all_files(&raw, &mut made)?;
    let folder = args.patient.as_ref().filter(|_| !args.dry_run);
    if let Some(folder) = folder {
        write(folder, &files).map_err(CliError::Export)?;
    }
    if args.json {
        talk.json(&made.answer)?;
        made.answer
            .warnings
            .iter()
            .for_each(|warning| talk.say(&format!("warning: {warning}")));
    } else {
        talk.data(&text(&made.answer, talk))?;
    }
    match folder {
        Some(folder) => {
            let errors = afterwards(folder, talk);
            if args.open {
                open_in_viewer(folder.join(PREPARED).join(PAGE), talk);
            }
            if errors > 0 {
                return Err(CliError::Recordings {
                    errors: count(errors, "error"),
                });
            }
        }
        None => talk.hint(
            "nothing was written; run without --dry-run to create the patient's \
                           folder",
        ),
    }
    Ok(Exit::Ok)
}

/// Name and content of every file of the patient's folder: tables, pictures, the answer and the page.
/// The answer then lists them.
///
/// # Errors
/// [`CliError::Io`] if the answer is no JSON.
pub fn all_files(raw: &RawFolder, made: &mut Made) -> Result<Vec<(String, String)>, CliError> {
    let mut files = made.files.clone();
    files.extend(draw(raw, made));
    made.answer.written = files.iter().map(|(name, _)| name.clone()).collect();
    made.answer.written.push(format!("{PREPARED}/{PAGE}"));
    made.answer.written.push(format!("{PREPARED}/prepare.json"));
    let text = serde_json::to_string_pretty(&made.answer).map_err(|error| CliError::Io {
        what: "cannot write JSON",
        source: error.into(),
    })?;
    files.push((format!("{PREPARED}/prepare.json"), format!("{text}\n")));
    files.push((format!("{PREPARED}/{PAGE}"), page_of(raw, made)));
    Ok(files)
}

fn id_of(raw: &RawFolder, args: &PrepareArgs) -> Result<String, CliError> {
    let name = |path: &Path| {
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        absolute
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
    };
    let folder = args.patient.as_deref().and_then(name);
    match (&raw.file.id, folder) {
        (Some(id), Some(folder)) if *id != folder => Err(CliError::Usage(format!(
            "{PREPARE_TOML} has id = {id:?}, but the patient's folder is named {folder:?}: give \
             both the same name"
        ))),
        (Some(id), _) => Ok(id.clone()),
        (None, Some(folder)) => Ok(folder),
        (None, None) => Ok(name(&args.raw).unwrap_or_else(|| "patient".to_owned())),
    }
}

/// Checks that the folder does not exist yet, is empty, holds only the unedited template of
/// `cardiotwin init`, or was made by this command and `--replace` was given.
fn may_write(folder: &Path, id: &str, args: &PrepareArgs) -> Result<(), CliError> {
    let usage = |text: String| Err(CliError::Usage(text));
    if id.is_empty() || id == ".." || id == "." {
        return usage(format!(
            "{} is not a valid name of a patient's folder",
            folder.display()
        ));
    }
    let inside = |a: &Path, b: &Path| {
        let real = |p: &Path| {
            p.canonicalize()
                .or_else(|_| std::path::absolute(p))
                .unwrap_or_else(|_| p.to_owned())
        };
        real(b).starts_with(real(a))
    };
    if inside(&args.raw, folder) || inside(folder, &args.raw) {
        return usage(format!(
            "{} and {} contain each other: name a separate folder for the patient",
            folder.display(),
            args.raw.display()
        ));
    }
    let empty = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none());
    if !folder.exists() || empty || is_untouched(folder) || args.dry_run {
        return Ok(());
    }
    let ours = folder.join(PREPARED).join("prepare.json").is_file();
    match (args.replace, ours) {
        (true, true) => Ok(()),
        (false, true) => usage(format!(
            "{} already exists; `--replace` replaces it",
            folder.display()
        )),
        (_, false) => usage(format!(
            "{} already exists and was not created by `cardiotwin prepare`; nothing was written: \
             name another folder",
            folder.display()
        )),
    }
}

fn write(folder: &Path, files: &[(String, String)]) -> Result<(), WriteError> {
    let whole = WholeFolder::begin(folder)?;
    files
        .iter()
        .try_for_each(|(name, content)| whole.write(name, content.as_bytes()))?;
    whole.publish()
}

/// Checks the new folder as `cardiotwin check` does before a run, and prints the findings. Returns the
/// number of errors.
fn afterwards(folder: &Path, talk: &Talk) -> usize {
    let mut report = Report::default();
    load_alone(folder, &mut report);
    problems::say(&report, talk);
    let complaints = report.n_errors() + report.n_warnings();
    let checked = if complaints == 0 {
        "no problems".to_owned()
    } else {
        format!(
            "{}, {}",
            count(report.n_errors(), "error"),
            count(report.n_warnings(), "warning")
        )
    };
    talk.say(&format!(
        "created {}; result of `cardiotwin check`: {checked}",
        folder.display()
    ));
    talk.hint(&format!(
        "see {}",
        folder.join(PREPARED).join(PAGE).display()
    ));
    report.n_errors()
}

fn page_of(raw: &RawFolder, made: &Made) -> String {
    preparation_page(
        &made.answer,
        &drawings::recording(raw, made),
        &drawings::beats(raw, made),
        drawings::volume(raw, made).as_ref(),
    )
}

fn draw(raw: &RawFolder, made: &Made) -> Vec<(String, String)> {
    let beats =
        beats_svg(&drawings::beats(raw, made)).map(|svg| (format!("{PREPARED}/beats.svg"), svg));
    let volume = drawings::volume(raw, made).and_then(|lines| volume_svg(&lines));
    beats
        .into_iter()
        .chain(volume.map(|svg| (format!("{PREPARED}/volume.svg"), svg)))
        .collect()
}

fn text(answer: &Preparation, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["STEP", "STATE", "WHAT"]);
    for step in &answer.steps {
        let tone = match step.state {
            StepState::Done | StepState::Given => Some(Tone::Good),
            StepState::Off | StepState::Unchanged => Some(Tone::Quiet),
            StepState::Lacking => Some(Tone::Doubtful),
        };
        table.toned([
            (step.step.clone(), None),
            (step.state.word().to_owned(), tone),
            (step.what.clone(), None),
        ]);
    }
    let mut text = table.text();
    if !answer.beats.left_out.is_empty() {
        let mut table = Columns::new(talk, &[">BEAT", ">AT (s)", "KIND", "WHY"]);
        for beat in answer.beats.left_out.iter().take(MOST_NAMED) {
            let at = format!("{:.2}", 1e-3 * beat.onset_ms);
            table.row([
                &beat.number.to_string(),
                &at,
                &beat.kind,
                &beat.reasons.join("; "),
            ]);
        }
        text.push_str(&format!("\n{}", table.text()));
        if answer.beats.left_out.len() > MOST_NAMED {
            let rest = answer.beats.left_out.len() - MOST_NAMED;
            text.push_str(&format!("and {rest} more: {PREPARED}/beats.csv\n"));
        }
    }
    for warning in &answer.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}
