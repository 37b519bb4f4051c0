//! `cardiotwin version`: the versions of this program and of the worker next to it.

use cardiotwin_engine::{find_worker, first_line};
use clap::Args;
use serde::Serialize;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Print the versions of this program and of its worker
#[derive(Debug, Args)]
pub struct VersionArgs {
    /// Print one JSON object instead of lines
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Answer {
    cardiotwin: &'static str,
    worker: Option<String>,
}

/// Prints the versions. A worker that is not there has none.
///
/// # Errors
/// Stdout cannot be written.
pub fn execute(args: &VersionArgs, talk: &Talk) -> Result<Exit, CliError> {
    let worker = find_worker(None).ok();
    let answer = Answer {
        cardiotwin: env!("CARGO_PKG_VERSION"),
        worker: worker.and_then(|worker| first_line(worker, &["--version"])),
    };
    if args.json {
        talk.json(&answer)?;
        return Ok(Exit::Ok);
    }
    let worker = answer
        .worker
        .as_deref()
        .unwrap_or("no worker beside this program");
    talk.data(&format!("cardiotwin {}\n{worker}\n", answer.cardiotwin))?;
    Ok(Exit::Ok)
}
