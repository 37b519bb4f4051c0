//! `cardiotwin sweep report`: tables, figure and page of the results so far.

use std::path::PathBuf;

use cardiotwin_schemas::sweep::SweepSpec;
use clap::Args;

use super::outcome::{self, Phases};
use super::robustness;
use crate::cli::error::CliError;
use crate::cli::exit::Exit;
use crate::cli::talk::Talk;
use crate::sweep::folder;
use crate::sweep::gsa::selection;

/// Write tables, figure and page of what is complete so far
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
    /// Use the first N blocks only
    #[arg(long, value_name = "N")]
    blocks: Option<u32>,
    /// Write settings with the N most influential parameters: step 2's, or step 3's of an organ
    #[arg(long, value_name = "N")]
    select: Option<usize>,
}

/// Writes the files and prints their paths.
///
/// # Errors
/// [`SweepError`](crate::sweep::SweepError) if the folder holds no sweep, or too few of its members
/// are complete.
pub async fn execute(args: &ReportArgs, talk: &Talk) -> Result<Exit, CliError> {
    if let SweepSpec::Robustness(spec) = folder::read(&args.folder)?.sweep {
        let (result, record) = robustness::stored(&args.folder, &spec).await?;
        let page = robustness::write(&result, &record, &args.folder)?;
        talk.data(&format!("{}\n", page.display()))?;
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
    Ok(Exit::Ok)
}
