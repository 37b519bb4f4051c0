//! `cardiotwin dashboard`: the run as a web page on this machine.

mod source;

use std::path::PathBuf;

use cardiotwin_dashboard::Server;
use cardiotwin_engine::{StopLevel, StopSignal};
use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::place::{Folders, Place};
use crate::talk::Talk;
use source::RunSource;

/// Show the run as a web page on this machine, live
#[derive(Debug, Args)]
pub struct DashboardArgs {
    #[command(flatten)]
    place: Place,
    /// Port to listen on; 0 takes a free one
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
    /// Folder of another run or cohort that the page compares with; may be given again
    #[arg(long, value_name = "RUN")]
    compare: Vec<PathBuf>,
    /// Open the page in the desktop's browser
    #[arg(long)]
    open: bool,
}

/// Prints the address of the page and serves it until Ctrl-C.
///
/// # Errors
/// Errors of the store; [`CliError::Dashboard`] if the port is taken.
pub async fn execute(args: &DashboardArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    folders.refuse_sweep("`cardiotwin sweep status DIR`")?;
    let others: Vec<Folders> = args
        .compare
        .iter()
        .map(|folder| Folders::of(folder, None))
        .collect();
    for other in &others {
        other.refuse_sweep("--compare needs the run of a cohort")?;
    }
    let source = RunSource::open(folders, others).await?;
    let stop = StopSignal::from_signals().map_err(|source| CliError::Io {
        what: "cannot take Ctrl-C",
        source,
    })?;
    let server = Server::listen(args.port).await?;
    talk.data(&format!("{}\n", server.url()))?;
    if args.open {
        open_in_viewer(server.url(), talk);
    }
    if !source.has_begun().await {
        talk.hint("the run has not begun: the page waits for `cardiotwin run`");
    }
    talk.hint(
        "open this address in a browser on this machine; Ctrl-C ends the dashboard, not the run",
    );
    server
        .run(source, async move {
            stop.raised_above(StopLevel::Run).await;
        })
        .await?;
    Ok(Exit::Ok)
}
