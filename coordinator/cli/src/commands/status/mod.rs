//! `cardiotwin status`: the state of a run on one screen, failures first.

mod draw;
mod page;
mod table;
mod unseen;
mod watch;

use std::io::IsTerminal as _;
use std::time::Duration;

use cardiotwin_schemas::status::{PatientState, Status};
use cardiotwin_schemas::sweep::SweepSpec;
use cardiotwin_sweep::folder;
use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::{Folders, Place};
use crate::store::open;
use crate::talk::Talk;
pub use table::screen;

/// Rows shown without `--all`.
const ROWS: usize = 60;
/// Show the state of each patient, failures first
#[derive(Debug, Args)]
pub struct StatusArgs {
    #[command(flatten)]
    place: Place,
    /// Print one JSON object (status.schema.json) instead of a table
    #[arg(long)]
    json: bool,
    /// Show a page that refreshes by itself, with keys to sort, filter, open a patient and read its
    /// log; into a file or pipe, print a table every two seconds until the run is finished
    #[arg(long)]
    watch: bool,
    /// Show only failed patients
    #[arg(long)]
    failed: bool,
    /// Show all patients, even in a large cohort
    #[arg(long)]
    all: bool,
}

/// Prints the status.
///
/// # Errors
/// Errors of the store.
pub async fn execute(args: &StatusArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.place.folders();
    let reader = open(&folders).await?;
    let member = member(&folders)?;
    let print = |status: &Status, rows| {
        talk.data(&screen(status, member, rows, talk))?;
        if let Some(hint) = hint(status, &folders) {
            talk.hint(&hint);
        }
        Ok::<_, CliError>(())
    };
    if args.watch && !args.json && has_terminal() {
        let status = watch::watch(&reader, &folders, member, args.failed, talk).await?;
        print(&status, ROWS)?;
        talk.data(&unseen::words(&status, &folders))?;
        return Ok(Exit::Ok);
    }
    loop {
        let rows = if args.all || args.failed || args.json {
            usize::MAX
        } else {
            ROWS
        };
        let mut status = reader.screen(rows).await?;
        if member == "PATIENT" {
            unseen::add(&mut status, &folders).await?;
        }
        if args.failed {
            status
                .patients
                .retain(|patient| patient.state == PatientState::Failed);
        }
        if args.json {
            talk.json(&status)?;
        } else {
            print(&status, rows)?;
            talk.data(&unseen::words(&status, &folders))?;
        }
        if !args.watch || Talk::reader_left() || (is_over(&status) && !status.coordinator_running) {
            return Ok(Exit::Ok);
        }
        tokio::time::sleep(Duration::from_secs(2)).await;
    }
}

/// Whether a person sits at a terminal that can draw a page.
fn has_terminal() -> bool {
    let is_dumb = std::env::var_os("TERM").is_some_and(|value| value == "dumb");
    std::io::stdin().is_terminal() && std::io::stdout().is_terminal() && !is_dumb
}

/// Heading of the first column: the kind of member that the run has.
fn member(folders: &Folders) -> Result<&'static str, CliError> {
    Ok(match folder::find(&folders.run)?.map(|file| file.sweep) {
        None => "PATIENT",
        Some(SweepSpec::Gsa(_)) => "CHUNK",
        Some(SweepSpec::Robustness(_)) => "MEMBER",
    })
}

fn is_over(status: &Status) -> bool {
    status
        .counts
        .iter()
        .all(|(state, n)| *n == 0 || state.is_over())
}

/// The command to call next, if one is needed.
#[must_use]
pub fn hint(status: &Status, folders: &Folders) -> Option<String> {
    let of = folders.as_argument("--cohort ");
    if let Some(failed) = status
        .patients
        .iter()
        .find(|patient| patient.state == PatientState::Failed)
    {
        let id = &failed.patient;
        return Some(match failed.failure_class {
            Some(cardiotwin_schemas::failure::FailureClass::Site) => {
                format!(
                    "`cardiotwin logs {id}{of}` shows the log, `cardiotwin retry {id}{of}` tries \
                     again"
                )
            }
            _ => format!("`cardiotwin show {id}{of}` shows details"),
        });
    }
    if !status.refused.is_empty() {
        let check = folders.as_argument("");
        return Some(format!(
            "`cardiotwin check{check}` shows the errors of refused patients"
        ));
    }
    let waiting = status
        .patients
        .iter()
        .any(|p| !matches!(p.state, PatientState::Done | PatientState::Cancelled));
    let advance = || format!("`cardiotwin advance{}`", folders.as_argument(""));
    let command = || {
        if status.cluster.is_some() {
            advance()
        } else {
            folders.run_command()
        }
    };
    (waiting && !status.coordinator_running).then(|| format!("continue with {}", command()))
}

#[cfg(test)]
mod page_tests;
#[cfg(test)]
mod table_tests;
