//! `cardiotwin drive`: the driver inside a job of a cluster. Batch scripts call it; people do not.

use std::path::PathBuf;

use cardiotwin_engine::{self as engine, DriverPlace};
use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::Talk;

/// Run the tasks of a job's patients on its nodes
#[derive(Debug, Args)]
pub struct DriveArgs {
    /// Folder of the job
    folder: PathBuf,
}

/// Runs the driver.
///
/// # Errors
/// Errors of the engine.
pub async fn execute(args: &DriveArgs, talk: &Talk) -> Result<Exit, CliError> {
    let told = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let number = |name: &str| told(name).and_then(|value| value.parse().ok());
    let element: Option<u32> = number("SLURM_ARRAY_TASK_ID");
    let id = match (told("SLURM_ARRAY_JOB_ID"), element) {
        (Some(array), Some(element)) => Some(format!("{array}_{element}")),
        _ => told("SLURM_JOB_ID"),
    };
    let leave_at_s: Option<i64> = told("CARDIOTWIN_LEAVE_AT").and_then(|value| value.parse().ok());
    let place = DriverPlace {
        folder: args.folder.clone(),
        element: element.unwrap_or(0),
        node: number("SLURM_NODEID").unwrap_or(0),
        id,
        hosts: told(engine::HOSTS)
            .unwrap_or_default()
            .split_ascii_whitespace()
            .map(str::to_owned)
            .collect(),
        leave_at_ms: leave_at_s.map(|s| s * 1000),
    };
    match engine::drive_here(&place).await? {
        Some(end) => {
            talk.say(&format!(
                "driver ended: {:?}, {} patients unfinished",
                end.because,
                end.left.len()
            ));
            for (patient, why) in &end.left {
                talk.say(&format!("{patient} unfinished: {why}"));
            }
            Ok(Exit::Ok)
        }
        None => {
            talk.say("another driver has already claimed this part of the job; nothing to do");
            Ok(Exit::Locked)
        }
    }
}
