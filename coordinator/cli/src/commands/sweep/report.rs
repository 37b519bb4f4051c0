//! `cardiotwin sweep report`: tables, figure and page of the results so far.

use std::path::PathBuf;

use cardiotwin_schemas::sweep::SweepSpec;
use cardiotwin_sweep::folder;
use cardiotwin_sweep::gsa::selection;
use clap::Args;

use super::outcome::{self, Phases};
use super::robustness;
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::talk::Talk;

/// Write tables, figure and page from the part of a sweep that is complete
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
    /// Use only the first N blocks
    #[arg(long, value_name = "N")]
    blocks: Option<u32>,
    /// Write settings that fit the N most influential parameters: of step 2, or of step 3 for an
    /// organ
    #[arg(long, value_name = "N")]
    select: Option<usize>,
    /// Open the page in the desktop's viewer
    #[arg(long)]
    open: bool,
}

/// Writes the files and prints their paths.
///
/// # Errors
/// [`SweepError`](cardiotwin_sweep::SweepError) if the folder holds no sweep, or too few of its members
/// are complete.
pub async fn execute(args: &ReportArgs, talk: &Talk) -> Result<Exit, CliError> {
    if let SweepSpec::Robustness(spec) = folder::read(&args.folder)?.sweep {
        let (result, record) = robustness::stored(&args.folder, &spec).await?;
        let page = robustness::write(&result, &record, &args.folder)?;
        talk.data(&format!("{}\n", page.display()))?;
        if args.open {
            open_in_viewer(&page, talk);
        }
        return Ok(Exit::Ok);
    }
    let record = outcome::analysed(&args.folder, args.blocks, &mut Phases::default()).await?;
    let mut files = outcome::write(&args.folder, &record)?;
    if let Some(n) = args.select {
        files.push(folder::write_result(
            &args.folder,
            selection::file(&record),
            &selection::toml(&record, n)?,
        )?);
    }
    talk.data(
        &files
            .iter()
            .map(|file| format!("{}\n", file.display()))
            .collect::<String>(),
    )?;
    if args.open
        && let Some(page) = outcome::page_among(&files)
    {
        open_in_viewer(page, talk);
    }
    Ok(Exit::Ok)
}
