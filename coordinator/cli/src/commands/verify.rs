//! `cardiotwin verify`: compares every file of a run with its stored hash.

use std::path::Path;

use cardiotwin_engine::{self as engine, FileState, VerifiedFile};
use clap::Args;
use serde::Serialize;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::Place;
use crate::table::Columns;
use crate::talk::{Talk, count};

/// Check every file of a run against the SHA-256 that was stored when it was written
#[derive(Debug, Args)]
#[command(
    after_help = "Checked are outcomes and artefacts of all finished tasks, and the files of the \
                  cohort that patients' plans name; of a cohort that was copied together with its \
                  run, the files of the copy.\n\
                  Not checked are files that `run`, `report` and `export` can write again, which have \
                  no stored hash: models/PATIENT/model.toml, reports and exported tables.\n\
                  The table lists what is not as it was stored; nothing is changed. The exit code is \
                  1 if there is anything to list."
)]
pub struct VerifyArgs {
    #[command(flatten)]
    place: Place,
    /// Print one JSON object with every file instead of the table
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer<'a> {
    checked: usize,
    as_stored: usize,
    files: &'a [VerifiedFile],
}

/// Compares the files and prints those that differ.
///
/// # Errors
/// Errors of the store.
pub async fn execute(args: &VerifyArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let engine::Verified { files, moved } = engine::verify(&folders.run).await?;
    let differ: Vec<&VerifiedFile> = files
        .iter()
        .filter(|file| file.standing != FileState::AsStored)
        .collect();
    if args.json {
        talk.json(&Answer {
            checked: files.len(),
            as_stored: files.len() - differ.len(),
            files: &files,
        })?;
    } else {
        if !differ.is_empty() {
            talk.data(&table(&differ, &folders.run, talk))?;
        }
        talk.data(&format!("{}\n", counted(&files)))?;
        if let Some(moved) = &moved {
            let (is, was) = (moved.is.display(), moved.was.display());
            talk.say(&format!(
                "the cohort's files are those in {is}; the run read them in {was}"
            ));
        }
        talk.say(
            "not checked, because the program can write them again: models/*/model.toml, reports, \
             exported tables",
        );
    }
    if differ.is_empty() {
        return Ok(Exit::Ok);
    }
    talk.hint(
        "restore these files from a backup or an archive; a finished task whose file is lost is \
         computed again when a later step needs it",
    );
    Ok(Exit::Problems)
}

fn table(files: &[&VerifiedFile], run: &Path, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["PATIENT", "STEP", "FILE", "STATE", "SHA-256"]);
    for file in files {
        let path = file.path.strip_prefix(run).unwrap_or(&file.path);
        let short = |hash: &str| hash.get(..12).unwrap_or(hash).to_owned();
        let expected = short(&file.expected_sha256);
        let hashes = match (&file.found_sha256, &file.why) {
            (Some(found), _) => format!("{}, stored {expected}", short(found)),
            (None, Some(why)) => format!("{why}; stored {expected}"),
            (None, None) => format!("stored {expected}"),
        };
        table.row([
            file.patient.clone(),
            file.step.clone(),
            path.display().to_string(),
            file.standing.as_str().to_owned(),
            hashes,
        ]);
    }
    table.text()
}

/// Numbers in words, such as `3 files checked: 2 as stored, 1 changed`.
fn counted(files: &[VerifiedFile]) -> String {
    let all = [
        FileState::AsStored,
        FileState::Changed,
        FileState::Missing,
        FileState::Unreadable,
    ];
    let parts: Vec<String> = all
        .into_iter()
        .map(|one| {
            (
                one,
                files.iter().filter(|file| file.standing == one).count(),
            )
        })
        .filter(|(one, n)| *n > 0 || *one == FileState::AsStored)
        .map(|(one, n)| format!("{n} {}", one.as_str()))
        .collect();
    format!(
        "{} checked: {}",
        count(files.len(), "file"),
        parts.join(", ")
    )
}
