//! `cardiotwin du`, `clean` and `archive`: disk usage of a run, removal of files that are no longer
//! needed, and a checked copy.

use std::path::PathBuf;

use cardiotwin_engine::clock;
use cardiotwin_engine::{self as engine, Class, Usage};
use cardiotwin_input::{self as input, Options, Report};
use clap::Args;

use crate::access;
use crate::error::CliError;
use crate::exit::Exit;
use crate::place::{Folders, Place};
use crate::table::Columns;
use crate::talk::{Talk, count};

/// Show the disk usage of a run's files by purpose and retention
#[derive(Debug, Args)]
pub struct DuArgs {
    #[command(flatten)]
    place: Place,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Remove checkpoints and working folders of finished tasks; files that a rerun, the report or
/// provenance needs stay
#[derive(Debug, Args)]
#[command(
    after_help = "Refused while a coordinator works on the run. `cardiotwin du` shows what would be \
                  removed."
)]
pub struct CleanArgs {
    #[command(flatten)]
    place: Place,
    /// Show what would be removed without removing anything
    #[arg(long)]
    dry_run: bool,
    /// Remove VTU series, too
    #[arg(long)]
    series: bool,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Copy a run without its scratch files to another folder, check every file, and write their hashes
#[derive(Debug, Args)]
#[command(
    after_help = "The copy is a run: `status`, `show` and `report` read it. `sha256sum --check SHA256SUMS` checks it later."
)]
pub struct ArchiveArgs {
    #[command(flatten)]
    place: Place,
    /// Folder of the copy, which must not exist [default: COHORT-DATE in executor.archive]
    #[arg(long, value_name = "DIR")]
    to: Option<PathBuf>,
    /// Copy VTU series, too
    #[arg(long)]
    series: bool,
    /// Print one JSON object instead of a sentence
    #[arg(long)]
    json: bool,
}

/// Prints the disk usage of a run.
///
/// # Errors
/// Errors of the engine.
pub async fn du(args: &DuArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let usage = engine::disk_usage(&folders.run).await?;
    if args.json {
        talk.json(&usage)?;
        return Ok(Exit::Ok);
    }
    let of = |class: Class| usage.classes.get(&class).copied().unwrap_or_default();
    let rows: Vec<(Class, Usage)> = Class::ALL
        .into_iter()
        .map(|class| (class, of(class)))
        .collect();
    talk.data(&table(talk, &rows))?;
    let (plain, series) = (usage.removable, usage.removable_with_series);
    talk.say(&format!(
        "`cardiotwin clean` would free {}, with --series {}",
        size(plain.bytes),
        size(series.bytes)
    ));
    Ok(Exit::Ok)
}

/// Removes files that can be made again.
///
/// # Errors
/// Errors of the engine.
pub async fn clean(args: &CleanArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let cleaned = engine::clean(&folders.run, args.series, args.dry_run).await?;
    if args.json {
        talk.json(&cleaned)?;
        return Ok(Exit::Ok);
    }
    let rows: Vec<(Class, Usage)> = cleaned
        .classes
        .iter()
        .map(|(class, usage)| (*class, *usage))
        .collect();
    if !rows.is_empty() {
        talk.data(&table(talk, &rows))?;
    }
    let bytes = rows.iter().map(|(_, usage)| usage.bytes).sum();
    let (would, files) = (
        if args.dry_run { "would be " } else { "" },
        count(cleaned.files.len(), "file"),
    );
    talk.say(&format!("{files}, {}: {would}removed", size(bytes)));
    Ok(Exit::Ok)
}

/// Copies a run into an archive folder.
///
/// # Errors
/// Errors of the engine; [`CliError::Usage`] if neither `--to` nor `executor.archive` names a
/// folder.
pub async fn archive(args: &ArchiveArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    access::as_of_run(&folders.run);
    let target = match &args.to {
        Some(target) => target.clone(),
        None => default_archive(&folders)?,
    };
    let done = engine::archive(&folders.run, &target, args.series).await?;
    if args.json {
        talk.json(&done)?;
    } else {
        let (to, files) = (target.display(), count(done.copied.files as usize, "file"));
        let (copied, left) = (size(done.copied.bytes), size(done.left.bytes));
        talk.data(&format!(
            "{to}: {files}, {copied}, each checked; {left} of scratch not copied\n"
        ))?;
    }
    Ok(Exit::Ok)
}

/// Default target of an archive: a folder in `executor.archive` named after the cohort and the day.
fn default_archive(folders: &Folders) -> Result<PathBuf, CliError> {
    let cohort = folders.cohort.as_ref().and_then(|folder| {
        let cohort = input::load(folder, &Options::default(), &mut Report::default())?;
        Some((
            cohort.name,
            cohort.settings.settings.executor.archive.clone()?,
        ))
    });
    let Some((name, folder)) = cohort.filter(|(_, folder)| folder.is_absolute()) else {
        let message = "no folder for the archive: name one with --to, or set executor.archive to an \
                       absolute path";
        return Err(CliError::Usage(message.to_owned()));
    };
    std::fs::create_dir_all(&folder).map_err(CliError::file("create", &folder))?;
    let day = clock::utc_text(clock::now_ms())
        .chars()
        .take(10)
        .collect::<String>();
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() || c == '-' || c == '_' {
            c
        } else {
            '-'
        }
    };
    Ok(folder.join(format!(
        "{}-{day}",
        name.chars().map(plain).collect::<String>()
    )))
}

fn table(talk: &Talk, rows: &[(Class, Usage)]) -> String {
    let mut table = Columns::new(talk, &["CLASS", ">FILES", ">SIZE", "WHAT"]);
    for (class, usage) in rows {
        let cells = [
            class.as_str().to_owned(),
            usage.files.to_string(),
            size(usage.bytes),
        ];
        table.row(cells.into_iter().chain([class.meaning().to_owned()]));
    }
    table.text()
}

/// A number of bytes with a decimal unit.
fn size(bytes: u64) -> String {
    let bytes = bytes as f64;
    match bytes {
        _ if bytes < 1e3 => format!("{bytes:.0} B"),
        _ if bytes < 1e6 => format!("{:.1} kB", 1e-3 * bytes),
        _ if bytes < 1e9 => format!("{:.1} MB", 1e-6 * bytes),
        _ => format!("{:.2} GB", 1e-9 * bytes),
    }
}
