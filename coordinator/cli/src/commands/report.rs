//! `cardiotwin report`: the report as HTML files that need no network.

use std::path::PathBuf;

use cardiotwin_report::html::{Pages, write_report};
use cardiotwin_sweep::discovery;
use clap::Args;

use crate::access;
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::place::Place;
use crate::store::open;
use crate::talk::Talk;

/// File name of the report in the run's folder.
pub const FILE: &str = "report.html";

/// Write the report of a run as HTML that needs no network
#[derive(Debug, Args)]
pub struct ReportArgs {
    #[command(flatten)]
    place: Place,
    /// File to write [default: report.html in the run's folder]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Open the report in the desktop's viewer
    #[arg(long)]
    open: bool,
}

/// Writes the report and prints its path.
///
/// # Errors
/// Errors of the store and the report.
pub async fn execute(args: &ReportArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    access::as_of_run(&folders.run);
    folders.refuse_sweep("`cardiotwin sweep report DIR`")?;
    let record = open(&folders).await?.record().await?;
    let out = args.out.clone().unwrap_or_else(|| folders.run.join(FILE));
    let cases = discovery::beside(folders.cohort.as_deref());
    let paths =
        write_report(&record, cases.as_ref(), Pages::All, &out).map_err(CliError::Report)?;
    talk.data(&format!("{}\n", paths.main.display()))?;
    if args.open {
        open_in_viewer(&paths.main, talk);
    }
    Ok(Exit::Ok)
}
