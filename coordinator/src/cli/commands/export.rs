//! `cardiotwin export`: tables and traces for other programs.

use std::path::PathBuf;

use clap::Args;

use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::place::Place;
use crate::cli::store::open;
use crate::cli::talk::Talk;
use crate::export::export;

/// Write the paper's tables for this run as CSV and JSON, and all traces as tidy CSV
#[derive(Debug, Args)]
pub struct ExportArgs {
    #[command(flatten)]
    place: Place,
    /// Folder to write into [default: export in the run's folder]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Writes the files and prints their paths. Traces that could not be read make the exit code 1.
///
/// # Errors
/// The store's and the export's.
pub async fn execute(args: &ExportArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    folders.refuse_sweep("`cardiotwin sweep report DIR` writes its tables")?;
    let record = open(&folders).await?.record().await?;
    let out = args.out.clone().unwrap_or_else(|| folders.run.join("export"));
    let exported = export(&record, &out).map_err(CliError::Export)?;
    exported.files.iter().try_for_each(|file| talk.data(&format!("{}\n", file.display())))?;
    exported.problems.iter().for_each(|problem| talk.say(&format!("warning: {problem}")));
    Ok(if exported.problems.is_empty() { Exit::Ok } else { Exit::Problems })
}
